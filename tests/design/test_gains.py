"""Stationary gains against the filters and costs that they are the limits of, and against each other."""

from dataclasses import replace

import numpy as np
import pytest

from cases import case
from estimable import AssumptionError, InputError, StateSpace, kalman_gain, lqr_gain
from oracles import textbook

LEVEL = StateSpace([[1.0]], [[1.0]], Q=[[1.0]], R=[[1.0]], dt=1)
GOLDEN = (1 + 5**0.5) / 2


@pytest.mark.parametrize("features", [{}, {"cross": True}, {"singular": True}], ids=str)
def test_the_filter_settles_to_the_stationary_gain(features):
    c = case(4, (3, 2, 2), T=400, missing=0.0, feedthrough=False, **features)
    _, covariances, _ = textbook.kalman(c.model, c.prior, c.record.y, c.record.u)
    steady = kalman_gain(c.model)
    assert np.allclose(steady.covariance, covariances[-1], rtol=1e-9, atol=1e-12)
    A, C, R, P = c.model.A, c.model.C, c.model.R, steady.predicted_covariance
    J = np.zeros((3, 2)) if c.model.S is None else c.model.G @ c.model.S
    V = C @ P @ C.T + R
    assert np.allclose(steady.innovation_covariance, V, rtol=1e-12)
    assert np.allclose(steady.filter @ V, P @ C.T, rtol=1e-10)
    assert np.allclose(steady.predictor @ V, A @ P @ C.T + J, rtol=1e-10)
    assert np.abs(steady.poles).max() < 1


def test_a_continuous_filter_is_the_limit_of_fast_samples():
    A, C, Q = np.array([[0.0, 1.0], [-1.0, -0.4]]), np.array([[1.0, 0.0]]), np.diag([0.0, 0.5])
    continuous = kalman_gain(StateSpace(A, C=C, Q=Q, R=[[0.2]], dt=0))
    h = 1e-4
    slow = StateSpace(A, C=C, Q=Q, R=[[0.2 / h]], dt=0).discretise(
        h
    )  # a density of .2 is a variance of .2 / h a sample
    assert np.allclose(kalman_gain(slow).covariance, continuous.covariance, rtol=1e-3)
    assert np.allclose(kalman_gain(slow).predictor / h, continuous.predictor, rtol=1e-3)
    assert np.array_equal(continuous.filter, continuous.predictor)
    assert np.all(continuous.poles.real < 0)


@pytest.mark.parametrize("dt", [0.5, 0.0])
def test_regulator_and_filter_are_dual(dt):
    c = case(2, (4, 1, 3), feedthrough=False, cross=bool(dt))
    A = c.model.A - (0 if dt else 1.2 * np.eye(4))
    model = replace(c.model, A=A, dt=dt)
    transposed = StateSpace(A.T, model.C.T, dt=dt)
    N = None if model.S is None else model.G @ model.S
    weights = model.G @ model.Q @ model.G.T, model.R, N
    assert np.allclose(lqr_gain(transposed, *weights).feedback.T, kalman_gain(model).predictor, rtol=1e-10)
    assert np.allclose(lqr_gain(transposed, *weights).cost, kalman_gain(model).predicted_covariance, rtol=1e-10)


def test_the_cost_is_that_of_the_closed_loop_and_no_other_feedback_costs_less():
    rng = np.random.default_rng(0)
    A, B = rng.normal(size=(3, 3)), rng.normal(size=(3, 2))
    joint = rng.normal(size=(5, 5))
    joint = joint @ joint.T
    L, M, N = joint[:3, :3], joint[3:, 3:], joint[:3, 3:]
    best = lqr_gain(StateSpace(A, B, dt=1), L, M, N)

    def cost(K, x):
        total = 0.0
        for _ in range(500):
            u = -K @ x
            total, x = total + x @ L @ x + u @ M @ u + 2 * x @ N @ u, A @ x + B @ u
        return total

    x0 = rng.normal(size=3)
    assert np.isclose(cost(best.feedback, x0), x0 @ best.cost @ x0, rtol=1e-10)
    for _ in range(5):
        assert cost(best.feedback + 1e-3 * rng.normal(size=(2, 3)), x0) > x0 @ best.cost @ x0


def test_known_values():
    steady = kalman_gain(LEVEL)
    assert np.isclose(steady.predicted_covariance, GOLDEN, rtol=1e-14)
    assert np.isclose(steady.covariance, GOLDEN - 1, rtol=1e-14)
    assert np.isclose(lqr_gain(LEVEL, [[1.0]], [[1.0]]).cost, GOLDEN, rtol=1e-14)
    assert np.isclose(lqr_gain(replace(LEVEL, dt=0, A=[[0.0]]), [[4.0]], [[1.0]]).feedback, 2.0, rtol=1e-14)
    quiet = kalman_gain(StateSpace([[0.5]], R=[[1.0]], dt=1))  # no process noise: the state is known in the end
    assert np.all(quiet.covariance == 0)
    assert np.all(quiet.filter == 0)
    exact = kalman_gain(StateSpace([[2.0]], Q=[[1.0]], R=[[0.0]], dt=1))  # a noise-free output
    assert np.allclose(exact.filter, 1.0, rtol=1e-14)
    assert np.allclose(exact.covariance, 0.0, atol=1e-14)


ASSUMPTIONS = {
    "unstable and not seen": lambda: kalman_gain(StateSpace(np.diag([1.2, 0.5]), C=[[0.0, 1.0]], Q=np.eye(2), R=[[1.0]], dt=1)),
    "marginal and not excited": lambda: kalman_gain(StateSpace([[1.0]], Q=[[0.0]], R=[[1.0]], dt=1)),
    "two noise-free outputs that say the same": lambda: kalman_gain(
        StateSpace([[0.5]], C=[[1.0], [1.0]], Q=[[1.0]], R=np.zeros((2, 2)), dt=1)
    ),
    "unstable and not moved": lambda: lqr_gain(StateSpace(np.diag([1.2, 0.5]), [[0.0], [1.0]], dt=1), np.eye(2), [[1.0]]),
    "marginal, continuous, and not excited": lambda: kalman_gain(
        StateSpace([[0.0, 1.0, 0.0], [-1.0, -0.4, 1.0], [0.0, 0.0, 0.0]], C=[[1.0, 0.0, 0.0]], Q=np.diag([0.0, 1e-4, 0.0]),
                   R=[[1e-6]], dt=0)
    ),
    "marginal and free": lambda: lqr_gain(StateSpace([[0.0]], [[1.0]], dt=0), [[0.0]], [[1.0]]),
}  # fmt: skip


@pytest.mark.parametrize("name", ASSUMPTIONS)
def test_what_has_no_stationary_gain_is_refused(name):
    with pytest.raises(AssumptionError, match="no stabilising solution"):
        ASSUMPTIONS[name]()


WRONG = {
    "no model": (lambda: kalman_gain(3), ["`model` must be a StateSpace. Got 3."]),
    "no R": (
        lambda: kalman_gain(StateSpace([[0.5]], dt=1)),
        ["`model` has no R: give the covariance of the measurement noise, StateSpace(..., R=...)."],
    ),
    "varying": (
        lambda: kalman_gain(StateSpace(np.ones((3, 1, 1)), R=[[1.0]], dt=1)),
        ["a steady-state analysis needs a constant model: 'A' of `model` has 3 rows in time."],
    ),
    "continuous, R zero": (
        lambda: kalman_gain(StateSpace([[-1.0]], R=[[0.0]], dt=0)),
        ["`R` must be positive definite: entry 0 of its diagonal is 0."],
    ),
    "continuous, R singular": (
        lambda: kalman_gain(StateSpace([[-1.0]], C=[[1.0], [1.0]], R=[[1.0, 2.0], [2.0, 4.0]], dt=0)),
        ["`R` must be positive definite: with a unit diagonal, its smallest eigenvalue is 0."],
    ),
    "every fault of the weights": (
        lambda: lqr_gain(LEVEL, np.eye(2), [[-1.0]], [[1.0, 2.0]]),
        [
            "`L` must be (n, n) = (1, 1): the model has 1 state. Got (2, 2).",
            "`M` must be positive semidefinite: its smallest eigenvalue is -1.",
            "`N` must be (n, m) = (1, 1): the model has 1 state; the model has 1 input. Got (1, 2).",
        ],
    ),
    "weights indefinite together": (
        lambda: lqr_gain(LEVEL, [[1.0]], [[1.0]], [[2.0]]),
        ["[[L, N], [N.T, M]] must be positive semidefinite: its smallest eigenvalue is -1."],
    ),
    "no input": (
        lambda: lqr_gain(StateSpace([[0.5]], dt=1), [[1.0]], np.zeros((0, 0))),
        ["`model` has no input: give B, StateSpace(A, B, ...)."],
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_call_is_answered_with_every_fault(name):
    call, sentences = WRONG[name]
    with pytest.raises(InputError) as caught:
        call()
    assert list(caught.value.faults) == sentences
