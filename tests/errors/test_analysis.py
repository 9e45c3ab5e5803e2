"""What is said of a question that has no answer."""

import numpy as np
import pytest

from estimable import (
    AssumptionError,
    Prior,
    StateSpace,
    estimability,
    observability,
    reachability,
    reduce,
    regulability,
)

I2 = np.eye(2)
STABLE = StateSpace(0.5 * I2, I2, Q=I2, R=I2, dt=1)
CONTINUOUS = StateSpace(-I2, I2, Q=I2, R=I2, dt=0)
VARYING = StateSpace(0.5 * np.ones((3, 1, 1)), np.ones((1, 1)), Q=[[1.0]], R=[[1.0]], dt=1)
LARGE = StateSpace(np.zeros((1000, 1000)), Q=np.eye(1000), R=np.eye(1000), dt=1)

WRONG = {
    "no model": (lambda: estimability("F"), ["`model` must be a StateSpace. Got 'F'."]),
    "no model to control": (lambda: regulability(None, I2, I2), ["`model` must be a StateSpace. Got None."]),
    "no model to observe": (lambda: observability(1), ["`model` must be a StateSpace. Got 1."]),
    "no R": (
        lambda: estimability(StateSpace([[0.5]], dt=1)),
        ["`model` has no R: give the covariance of the measurement noise, StateSpace(..., R=...)."],
    ),
    "R indefinite": (
        lambda: estimability(StateSpace([[0.5]], R=[[-1.0]], dt=1)),
        ["`R` must be positive semidefinite: its smallest eigenvalue is -1."],
    ),
    "R zero, in continuous time": (
        lambda: estimability(StateSpace([[-0.5]], R=[[0.0]], dt=0)),
        ["`R` must be positive definite: entry 0 of its diagonal is 0."],
    ),
    "every fault at once": (
        lambda: estimability(StateSpace([[0.5]], dt=1), horizon=0, prior=Prior([0.0, 0.0], I2, diffuse=[[1.0], [0.0]])),
        [
            "`model` has no R: give the covariance of the measurement noise, StateSpace(..., R=...).",
            "`horizon` must be an integer of at least 1. Got 0.",
            "`prior` must have a finite covariance: the reduction of an infinite variance is not defined.",
            "`prior` must describe n = 1 states: the model has as many. Got 2.",
        ],
    ),
    "prior a matrix": (
        lambda: estimability(STABLE, horizon=2, prior=[[1.0]]),
        ["`prior` must be a Prior. Got [[1.0]]."],
    ),
    "horizon in part": (
        lambda: estimability(STABLE, horizon=2.5),
        ["`horizon` must be an integer of at least 1. Got 2.5."],
    ),
    "horizon of no time": (
        lambda: estimability(CONTINUOUS, horizon=0.0),
        ["`horizon` must be greater than 0 seconds. Got 0."],
    ),
    "horizon beyond the rows": (
        lambda: estimability(VARYING, horizon=4),
        ["`horizon` may be at most 3, the number of rows of the model in time. Got 4."],
    ),
    "rows without a time": (
        lambda: estimability(StateSpace(-np.ones((3, 1, 1)), R=[[1.0]], dt=0)),
        ["`horizon` must be given: the total duration, in seconds, of the rows of this continuous model."],
    ),
    "a thousand states": (
        lambda: estimability(LARGE),
        ["`model` must have at most 500 states. Got 1000. Reduce it first, or analyse a part of it."],
    ),
    "a thousand states observed": (
        lambda: observability(LARGE),
        ["`model` must have at most 500 states. Got 1000. Reduce it first, or analyse a part of it."],
    ),
    "a horizon that takes minutes": (
        lambda: estimability(StateSpace(0.5 * np.eye(100), R=np.eye(100), dt=1), horizon=100_000),
        ["`horizon` may be at most 10000 steps with 100 states. Got 100000."],
    ),
    "weights of another size": (
        lambda: regulability(STABLE, [[1.0]], -I2),
        [
            "`L` must be (n, n) = (2, 2): the model has 2 states. Got (1, 1).",
            "`M` must be positive semidefinite: its smallest eigenvalue is -1.",
        ],
    ),
    "a weight of inputs that is singular": (
        lambda: regulability(STABLE, I2, np.diag([1.0, 0.0])),
        ["`M` must be positive definite: entry 1 of its diagonal is 0."],
    ),
    "nothing to control with": (
        lambda: regulability(StateSpace([[0.5]], dt=1), [[1.0]], [[1.0]]),
        ["`model` has no input: give B, StateSpace(A, B, ...)."],
    ),
    "weights of other rows": (
        lambda: regulability(VARYING, np.ones((2, 1, 1)), [[1.0]]),
        ["`L` must have 3 rows in time: the model has 3 rows in time. Got 2."],
    ),
    "moved by what": (
        lambda: reachability(STABLE, by="wind"),
        ["`by` must be one of 'inputs', 'noise'. Got 'wind'."],
    ),
    "an unknown method": (
        lambda: reduce(STABLE, method="modal"),
        ["`method` must be one of 'output_process', 'minimal', 'balanced'. Got 'modal'."],
    ),
    "an order that is not asked for": (
        lambda: reduce(STABLE, order=1),
        ["`order` is only for method='balanced': 'output_process' determines the order. Got 1."],
    ),
    "no order": (
        lambda: reduce(STABLE, method="balanced"),
        ["`order` must be an integer of at least 1. Got None."],
    ),
    "an order too large": (
        lambda: reduce(STABLE, method="balanced", order=3),
        ["`order` may be at most n = 2, the states of the model. Got 3."],
    ),
    "an order beyond the rank": (
        lambda: reduce(StateSpace(0.5 * I2, [[1.0], [0.0]], [[1.0, 0.0]], dt=1), method="balanced", order=2),
        ["`order` may be at most 1: the other Hankel singular values are zero to rounding. Got 2."],
    ),
    "innovations form in continuous time": (
        lambda: reduce(CONTINUOUS),
        [
            "the innovations form of a continuous model has cross noise, which `StateSpace` does not support: discretise it."
        ],
    ),
    "a model that varies": (
        lambda: reduce(VARYING, method="minimal"),
        ["a steady-state analysis needs a constant model: 'A' of `model` has 3 rows in time."],
    ),
    "nothing left": (
        lambda: reduce(StateSpace([[0.5]], R=[[1.0]], dt=1)),
        ["the reduced model is empty: neither inputs nor noise move a state that an output shows."],
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_question_is_answered_with_every_fault(refused, name):
    call, sentences = WRONG[name]
    assert refused(call) == sentences


UNMET = {
    "unstable": (
        lambda: estimability(StateSpace(np.diag([1.1, 0.5]), R=I2, dt=1)),
        "a steady state needs eigenvalues of A with moduli below 1, but one is 1.1: give a horizon, such as horizon=4.",
    ),
    "unstable in continuous time": (
        lambda: estimability(StateSpace([[0.1, 1.0], [-1.0, 0.1]], R=I2, dt=0)),
        "a steady state needs eigenvalues of A with real parts below 0, but one is 0.1 ± 1i: give a horizon, such as "
        "horizon=10.0 (seconds).",
    ),
    "at the limit of stability": (
        lambda: regulability(StateSpace([[1.0]], [[1.0]], dt=1), [[1.0]], [[1.0]]),
        "a steady state needs eigenvalues of A with moduli below 1, but one is 1: give a horizon, such as horizon=2.",
    ),
    "unstable and to be reduced": (
        lambda: reduce(StateSpace([[2.0]], [[1.0]], dt=1), method="balanced", order=1),
        "a steady state needs eigenvalues of A with moduli below 1, but one is 2: method='minimal' needs none.",
    ),
    "beyond any number": (
        lambda: estimability(StateSpace([[1e3]], Q=[[1.0]], R=[[1.0]], dt=1), horizon=100),
        "the covariance of the model overflows within 25 steps: use a shorter horizon.",
    ),
    "beyond any number in time": (
        lambda: estimability(StateSpace([[100.0]], Q=[[1.0]], R=[[1.0]], dt=0), horizon=10.0),
        "the covariance of the model overflows within 10 s: use a shorter horizon.",
    ),
    "too many steps": (
        lambda: estimability(StateSpace([[-1e6]], Q=[[1.0]], R=[[1.0]], dt=0), horizon=1.0),
        "a horizon of 1 s takes 1000001 steps of the fastest mode, more than 20000: use a shorter horizon, or a model "
        "without its fast modes.",
    ),
}


@pytest.mark.parametrize("name", UNMET)
def test_an_assumption_that_is_not_met_comes_with_its_number(name):
    call, sentence = UNMET[name]
    with pytest.raises(AssumptionError) as caught:
        call()
    assert str(caught.value) == sentence
