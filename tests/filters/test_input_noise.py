"""What is not known of an input between two samples, against exact covariances that share no quadrature."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimable import (
    AlphaBeta,
    ExtendedKalman,
    FixedGain,
    InputError,
    Kalman,
    Prior,
    StateSpace,
    UnknownGain,
    UnknownInput,
    UnscentedKalman,
)
from estimable.models.discretisation import over
from estimable.models.sampled import Clock
from estimable.results import Interval, Sample

A = np.array([[-1.0, 0.95], [-11.4, -1.15]])
B = np.array([[0.05, 0.3], [-17.5, 2.0]])
MODEL = StateSpace(A, B, Q=np.diag([1e-3, 0.1]), R=np.eye(2), dt=0)
EXACT = Prior([0.3, -0.2], np.zeros((2, 2)))
U, END = np.array([0.5, -1.0]), np.array([0.7, 0.2])
COVARIANCE = np.array([[0.2, 0.05], [0.05, 0.1]])
DIFFUSION = np.array([0.4, 1.5])


def wandering(A, B, h, hold):
    """Covariance of ∫ e^{A (h-s)} b w(s) ds of a Brownian motion w, for each column b: (x, w) moved together.

    A bridge is conditioned on w(h) = 0.
    """
    n, found = len(A), []
    for b in B.T:
        both = np.block([[A, b[:, None]], [np.zeros((1, n + 1))]])
        P = over(both, np.zeros((n + 1, 0)), np.diag([0.0] * n + [1.0]), h, hold="zero_order")[3]
        free = hold == "zero_order"
        found.append(P[:n, :n] - (0.0 if free else np.outer(P[:n, n], P[n, :n]) / P[n, n]))
    return found


def predicted(algorithm, interval, prior=EXACT, *, hold, wanders=False):
    """Covariance of the state after one interval, from a state that is known."""
    ready = algorithm.sampled(Clock.every(float(interval.dt), hold, wanders=wanders))
    state = ready.predict(ready.init(prior), interval)
    return np.asarray(state.covariance)[:2, :2]


def added(algorithm, *, hold, h, **unknown):
    """What it adds to the covariance that u is not known."""
    known = Interval(U, END if hold == "first_order" else U, None, np.asarray(h))
    uncertain = Interval(known.u, known.u_end, None, known.dt, **unknown)
    wanders = "u_diffusion" in unknown
    return predicted(algorithm, uncertain, hold=hold, wanders=wanders) - predicted(algorithm, known, hold=hold)


@pytest.mark.parametrize("hold", ["zero_order", "first_order"])
@pytest.mark.parametrize("h", [0.01, 0.4, 2.0])
def test_a_constant_error_moves_the_state_as_the_whole_input_does(hold, h):
    _, Γ, Γ_end, _ = over(A, B, np.zeros((2, 2)), h, hold=hold)
    through = Γ if Γ_end is None else Γ + Γ_end
    exact = through @ COVARIANCE @ through.T
    found = added(Kalman(MODEL), hold=hold, h=h, u_covariance=COVARIANCE)
    assert_allclose(found, exact, rtol=1e-10, atol=1e-13 * exact.max())


@pytest.mark.parametrize("hold", ["zero_order", "first_order"])
@pytest.mark.parametrize("h", [0.01, 0.4, 2.0])
def test_an_error_that_wanders_adds_its_own_integral(hold, h):
    exact = sum(g * P for g, P in zip(DIFFUSION, wandering(A, B, h, hold), strict=True))
    found = added(Kalman(MODEL), hold=hold, h=h, u_diffusion=DIFFUSION)
    assert_allclose(found, exact, rtol=1e-8, atol=1e-10 * exact.max())


def test_chains_of_integrators_keep_every_digit():
    chain, force = np.eye(4, k=1), np.eye(4)[:, -1:]
    model = StateSpace(chain, force, C=np.eye(1, 4), Q=np.zeros((4, 4)), R=[[1.0]], dt=0)
    ready = Kalman(model).sampled(Clock.every(1e-3, wanders=True))
    known = Prior(np.zeros(4), np.zeros((4, 4)))
    state = ready.predict(
        ready.init(known), Interval(np.zeros(1), np.zeros(1), None, np.asarray(1e-3), u_diffusion=np.ones(1))
    )
    exact = wandering(chain, force, 1e-3, "zero_order")[0]
    scale = np.sqrt(np.diag(exact))
    assert_allclose(
        np.asarray(state.covariance) / np.outer(scale, scale), exact / np.outer(scale, scale), rtol=1e-6, atol=1e-9
    )


@pytest.mark.parametrize(("directions", "mean", "P"), [
    (None, [0.8], [[0.04]]),
    ("per_input", [0.8, 1.2], [[0.04, 0.01], [0.01, 0.09]]),
])  # fmt: skip
def test_an_unknown_gain_scales_the_error_by_its_second_moment(directions, mean, P):
    gain = UnknownGain(MODEL, Prior(mean, P), directions=directions)
    moments = np.outer(mean, mean) + np.asarray(P)
    blocks = [np.eye(2)] if directions is None else [np.diag([1.0, 0.0]), np.diag([0.0, 1.0])]
    h = 0.4
    _, Γ, Γ_end, _ = over(A, B, np.zeros((2, 2)), h, hold="first_order")
    through = [(Γ + Γ_end) @ block for block in blocks]
    exact = sum(moments[i, j] * a @ COVARIANCE @ b.T for i, a in enumerate(through) for j, b in enumerate(through))
    assert_allclose(added(gain, hold="first_order", h=h, u_covariance=COVARIANCE), exact, rtol=1e-9, atol=1e-12)
    alone = [wandering(A, B @ block, h, "first_order") for block in blocks]
    if directions is None:
        exact = moments[0, 0] * sum(g * one for g, one in zip(DIFFUSION, alone[0], strict=True))
    else:  # each input moves by itself, so that only squares are left
        exact = sum(moments[i, i] * DIFFUSION[i] * alone[i][i] for i in range(2))
    assert_allclose(added(gain, hold="first_order", h=h, u_diffusion=DIFFUSION), exact, rtol=1e-8, atol=1e-10)


def test_known_inputs_of_an_unknown_one_and_given_gains_take_it_too():
    exact = added(Kalman(MODEL), hold="zero_order", h=0.1, u_covariance=COVARIANCE)
    fixed = FixedGain(MODEL, np.zeros((2, 2)))
    assert_allclose(added(fixed, hold="zero_order", h=0.1, u_covariance=COVARIANCE), exact, rtol=1e-12)
    beside = UnknownInput(MODEL, unknown=["u2"], variance=0.1)
    known = Interval(U[:1], U[:1], None, np.asarray(0.1))
    uncertain = Interval(U[:1], U[:1], None, np.asarray(0.1), u_covariance=np.array([[0.2]]))
    _, Γ, _, _ = over(A, B[:, :1], np.zeros((2, 2)), 0.1, hold="zero_order")
    more = predicted(beside, uncertain, hold="zero_order") - predicted(beside, known, hold="zero_order")
    assert_allclose(more, 0.2 * Γ @ Γ.T, rtol=1e-9)


UNCERTAIN = Interval(U, U, None, np.asarray(0.1), u_covariance=COVARIANCE)


@pytest.mark.parametrize("algorithm", [ExtendedKalman(MODEL), UnscentedKalman(MODEL)])
def test_nonlinear_filters_take_a_constant_error_and_refuse_one_that_wanders(algorithm):
    linear = predicted(Kalman(MODEL), UNCERTAIN, hold="zero_order")
    assert_allclose(predicted(algorithm, UNCERTAIN, hold="zero_order"), linear, rtol=1e-9, atol=1e-14)
    wandering = Interval(U, U, None, np.asarray(0.1), u_diffusion=DIFFUSION)
    with pytest.raises(InputError, match="needs an input that does not wander"):
        predicted(algorithm, wandering, hold="zero_order", wanders=True)


def test_smoothing_a_gain_and_a_discrete_model_refuse():
    gain = UnknownGain(MODEL, Prior([1.0], [[0.1]])).sampled(Clock.every(0.1))
    with pytest.raises(InputError, match="needs an input that is known between samples"):
        gain.instant(Sample(np.zeros(2), np.ones(2, bool), U), UNCERTAIN)
    discrete = Kalman(MODEL.discretise(0.1))
    with pytest.raises(InputError, match="`u_diffusion` needs a continuous model"):
        predicted(
            discrete, Interval(U, U, None, np.asarray(0.1), u_diffusion=DIFFUSION), hold="zero_order", wanders=True
        )


def test_a_tracker_without_inputs_is_untouched():
    tracker = AlphaBeta(0.5, 0.2, sigma_a2=1.0, sigma_s2=1.0).sampled(Clock.every(0.1, wanders=True))
    nothing = np.zeros(0)
    state = tracker.init(Prior([0.0, 0.0], np.eye(2)))
    known = tracker.predict(state, Interval(nothing, nothing, None, np.asarray(0.1)))
    wandering = tracker.predict(state, Interval(nothing, nothing, None, np.asarray(0.1), u_diffusion=nothing))
    assert_allclose(known.belief.covariance, wandering.belief.covariance, rtol=1e-14)
