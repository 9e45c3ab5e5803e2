"""Other forms of a model: exact round trips, states with a meaning, and refusals."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import solve_discrete_lyapunov

import estimable as es

FORMS = ("outputs", "balanced", "modal")


def drawn(seed, n=4, m=2, p=2):
    """A random stable continuous model."""
    g = np.random.default_rng(seed)
    A = g.normal(size=(n, n))
    A = A - (np.linalg.eigvals(A).real.max() + 0.3) * np.eye(n)
    L = g.normal(size=(n, n))
    D = g.normal(size=(p, m))
    return es.StateSpace(A, g.normal(size=(n, m)), g.normal(size=(p, n)), D, Q=L @ L.T, R=np.eye(p), dt=0)


@pytest.mark.parametrize("hold", ["zero_order", "first_order"])
def test_continuous_is_the_inverse_of_discretise(hold):
    for seed in range(20):
        model = drawn(seed)
        again = model.discretise(0.1, hold=hold).continuous(hold=hold)
        for name in "ABCDQ":
            assert_allclose(getattr(again, name), getattr(model, name), atol=1e-9)


def test_a_first_order_hold_in_the_direct_term_is_the_same_plant():
    """Identified models have the effect of u[k+1] in D: ξ = x - B_end u."""
    model = drawn(3)
    sampled = model.discretise(0.1, hold="first_order")
    B, D = sampled.B + sampled.A @ sampled.B_end, sampled.D + sampled.C @ sampled.B_end
    identified = es.StateSpace(sampled.A, B, sampled.C, D, R=np.eye(2), dt=0.1)
    again = identified.continuous(hold="first_order")
    for name in "ABCD":
        assert_allclose(getattr(again, name), getattr(model, name), atol=1e-9)


def test_an_integrator_has_a_continuous_model():
    slow = es.StateSpace([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]], R=[[1.0]], dt=0)
    again = slow.discretise(0.5).continuous()
    assert_allclose(again.A, slow.A, atol=1e-7)
    assert_allclose(again.B, slow.B, atol=1e-7)


@pytest.mark.parametrize("form", FORMS)
def test_coordinates_keep_the_model_and_its_filter(form):
    model = drawn(1).discretise(0.2)
    turned = model.in_coordinates(form)
    record = es.simulate(model, np.random.default_rng(0).normal(size=(30, 2)), seed=0).record
    prior = es.Prior(np.zeros(4), np.zeros((4, 4)))
    runs = [es.estimate(es.Kalman(one), record, prior=prior) for one in (model, turned)]
    assert_allclose(runs[0].innovation, runs[1].innovation, rtol=1e-7, atol=1e-9)
    assert_allclose(runs[0].log_likelihood, runs[1].log_likelihood, rtol=1e-9)


def test_coordinates_mean_what_they_say():
    model = drawn(1).discretise(0.2)
    assert_allclose(model.in_coordinates("outputs").C, np.eye(2, 4), atol=1e-10)
    balanced = model.in_coordinates("balanced")
    A, B, C = balanced.A, balanced.B, balanced.C
    W = [solve_discrete_lyapunov(A, B @ B.T), solve_discrete_lyapunov(A.T, C.T @ C)]
    assert_allclose(W[0], W[1], atol=1e-8 * np.abs(W[0]).max())
    assert_allclose(W[0], np.diag(np.diag(W[0])), atol=1e-8 * np.abs(W[0]).max())
    modal = model.in_coordinates("modal").A
    blocks = np.abs(modal) > 1e-9
    assert np.count_nonzero(blocks.sum(axis=1) > 2) == 0


def test_an_identified_model_is_filtered_as_it_is():
    """The innovations form has R > 0, and the gain of its filter is K."""
    g = np.random.default_rng(0)
    plant = es.ARMAX([-1.2, 0.5], [1.0, 0.4], [0.6], delay=1, noise_variance=0.25, dt=1)
    record = es.simulate(plant.to_state_space(), g.normal(size=600), seed=0).record
    for fit in (es.identify(es.PredictionError(2, 1, 1, delay=1), record), es.identify(es.Subspace(2), record)):
        model = fit.model if isinstance(fit.model, es.StateSpace) else fit.model.to_state_space()
        assert np.all(np.diag(model.R) > 0)
        assert_allclose(es.kalman_gain(model).predictor, model.G, atol=1e-6)
        turned = model.in_coordinates("outputs")
        assert_allclose(es.kalman_gain(turned).predictor, turned.G, atol=1e-6)


def turning(angle):
    """A pole of modulus .5 at an angle."""
    c, s = 0.5 * np.cos(angle), 0.5 * np.sin(angle)
    return es.StateSpace([[c, s], [-s, c]], [[1.0], [0.0]], [[1.0, 0.0]], R=[[1.0]], dt=1)


def half_seen():
    return es.StateSpace(0.5 * np.eye(2), np.ones((2, 1)), [[1.0, 0.0]], R=[[1.0]], dt=1)


@pytest.mark.parametrize(("call", "sentence"), [
    (lambda: es.StateSpace([[-0.5]], [[1.0]], [[1.0]], R=[[1.0]], dt=1).continuous(), "it has a pole at -0.5"),
    (lambda: es.StateSpace([[0.0]], [[1.0]], [[1.0]], R=[[1.0]], dt=1).continuous(), "leave it out of the model"),
    (lambda: turning(2.5).continuous(), "a pole turns by 143 degrees a step.*Sample faster"),
    (lambda: es.StateSpace([[-1.0]], [[1.0]], [[1.0]], R=[[1.0]], dt=0).continuous(), "only a constant discrete model"),
    (lambda: es.StateSpace([[0.5]], [[1.0]], [[1.0]], R=[[1.0]], dt=1).in_coordinates("best"), "`form` must be one of"),
    (lambda: es.StateSpace([[1.5]], [[1.0]], [[1.0]], R=[[1.0]], dt=1).in_coordinates("balanced"), "only a stable model"),
    (lambda: half_seen().in_coordinates("outputs"), "the outputs show 1 of 2 states"),
])  # fmt: skip
def test_what_has_no_such_form_says_so(call, sentence):
    with pytest.raises(es.InputError, match=sentence):
        call()
