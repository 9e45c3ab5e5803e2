"""Smoothing of nonlinear models: against the record as one Gaussian vector, and against the optimum that SciPy finds."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import least_squares

import estimable as es
from cases import case
from oracles.dense import smoothed

FILTERS = {
    "extended": es.ExtendedKalman,
    "iterated": lambda model, **s: es.ExtendedKalman(model, iterations=3, **s),
    "second": es.SecondOrderKalman,
    "bias only": lambda model, **s: es.SecondOrderKalman(model, moments="bias_only", iterations=2, **s),
    "unscented": es.UnscentedKalman,
    "cubature": lambda model, **s: es.UnscentedKalman(model, kappa=0.0, **s),
}
EVERY = pytest.mark.parametrize("make", FILTERS.values(), ids=FILTERS)


@EVERY
@pytest.mark.parametrize("varying", [False, True])
def test_of_a_linear_model_each_row_is_what_the_whole_record_says(make, varying):
    c = case(5, (3, 2, 2), varying=varying)
    mean, covariance = smoothed(c.model, c.prior, c.record.y, c.record.u)
    result = es.smooth(make(c.model), c.record, prior=c.prior)
    assert_allclose(result.mean, mean, atol=1e-11)
    assert_allclose(result.covariance, covariance, atol=1e-12)
    assert result.used.tolist() == [11] * 12


@pytest.mark.parametrize("make", [es.ExtendedKalman, es.SecondOrderKalman])  # one by tangents, one by moments
def test_a_fixed_lag_uses_so_many_later_samples_and_no_more(make):
    c = case(6)
    exact = es.smooth(es.Kalman(c.model), c.record, prior=c.prior, lag=3)
    result = es.smooth(make(c.model), c.record, prior=c.prior, lag=3)
    assert result.used.tolist() == exact.used.tolist()
    assert_allclose(result.mean, exact.mean, atol=1e-11)
    assert_allclose(result.covariance, exact.covariance, atol=1e-12)


@pytest.mark.parametrize("features", [{"singular": True}, {"diffuse": True}], ids=str)
def test_outputs_without_noise_and_diffuse_directions_are_ordinary(features):
    c = case(4, singular="singular" in features)
    if "diffuse" in features:
        D = np.random.default_rng(0).normal(size=(3, 2))
        c = c._replace(prior=es.Prior(c.prior.mean, c.prior.covariance, diffuse=D))
    mean, covariance = smoothed(c.model, c.prior, c.record.y, c.record.u)
    result = es.smooth(es.ExtendedKalman(c.model), c.record, prior=c.prior, iterations=9)
    assert_allclose(result.mean, mean, atol=1e-10)
    assert_allclose(result.covariance, covariance, atol=1e-10)


@pytest.mark.parametrize(
    ("make", "substeps"),
    [(es.ExtendedKalman, 12), (es.ExtendedKalman, None), (es.SecondOrderKalman, 12), (es.UnscentedKalman, 12)],
)
def test_between_irregular_samples_a_linear_model_of_functions_is_the_discretised_one(make, substeps):
    rng = np.random.default_rng(3)
    A, B = np.array([[-1.3, 1.0], [3.5, -1.1]]), np.array([[-0.15], [-24.3]])
    linear = es.StateSpace(A, B, Q=np.diag([0.1, 0.2]), R=0.01 * np.eye(2), dt=0)
    y = rng.normal(size=(8, 2))
    y[2] = y[4, 0] = np.nan
    record = es.Record(y, rng.normal(size=(8, 1)), t=np.cumsum(rng.uniform(0.02, 0.06, size=8)), hold="first_order")
    model = es.NonlinearModel(lambda x, u, θ: A @ x + B @ u, lambda x, u, θ: x, Q=linear.Q, R=linear.R, dt=0,
                              inputs=["u1"], substeps=substeps)  # fmt: skip
    prior = es.Prior([0.0, 0.0], np.eye(2))
    exact, result = (es.smooth(a, record, prior=prior) for a in (es.Kalman(linear), make(model)))
    assert_allclose(result.mean, exact.mean, rtol=1e-6, atol=1e-8)
    assert_allclose(result.covariance, exact.covariance, rtol=1e-6)


def test_a_parameter_is_smoothed_with_the_state():
    """A linear gain as a parameter: f is linear in (x, θ) given the input, so the smoother of `UnknownGain` is exact for it."""
    c = case(8, (2, 1, 1), feedthrough=False)
    A, B, C = (jnp.asarray(M) for M in (c.model.A, c.model.B, c.model.C))
    model = es.NonlinearModel(
        lambda x, u, θ: A @ x + θ[0] * (B @ u), lambda x, u, θ: C @ x, Q=c.model.Q, R=c.model.R, G=c.model.G, dt=0.5,
        states=c.model.states, inputs=c.model.inputs, parameters={"gain": 1.0},
    )  # fmt: skip
    gain = es.Prior([0.7], [[0.4]])
    exact = es.smooth(es.UnknownGain(c.model, gain, walk=0.02), c.record, prior=c.prior)
    for make in (es.ExtendedKalman, es.UnscentedKalman):
        result = es.smooth(make(model, parameters=gain, walk=0.02), c.record, prior=c.prior)
        assert_allclose(result.mean, exact.mean, atol=1e-11)
        assert_allclose(result.gain, exact.gain, atol=1e-11)
        assert_allclose(result.gain_covariance, exact.gain_covariance, atol=1e-11)
        assert_allclose(result.extra["state_gain_covariance"], exact.extra["state_gain_covariance"], atol=1e-11)


@pytest.mark.parametrize("make", [es.ExtendedKalman, es.SecondOrderKalman])  # one by tangents, one by moments
def test_both_engines_say_the_same(make):
    model, prior, record = pendulum(12)
    ours, xla = (
        es.smooth(make(model, parameters=es.Prior([4.0], [[1.0]])), record, prior=prior, engine=e)
        for e in ("native", "xla")
    )
    assert (ours.engine, xla.engine) == ("native", "xla")
    assert_allclose(ours.mean, xla.mean, rtol=1e-9, atol=1e-10)
    assert_allclose(ours.gain_covariance, xla.gain_covariance, rtol=1e-9)


def pendulum(T):
    """Angle and rate, with noise on both, measured by a sine; the stiffness is a parameter."""
    model = es.NonlinearModel(
        lambda x, u, θ: jnp.stack([x[0] + 0.1 * x[1], x[1] - 0.1 * θ[0] * jnp.sin(x[0])]),
        lambda x, u, θ: jnp.stack([jnp.sin(x[0]), x[0] * x[1]]),
        Q=np.diag([1e-4, 0.01]), R=np.diag([0.01, 0.2]), dt=0.1, states=("angle", "rate"), parameters={"k": 4.0},
    )  # fmt: skip
    rng, x, y = np.random.default_rng(1), np.array([1.2, 0.3]), []
    for _ in range(T):
        y.append([np.sin(x[0]), x[0] * x[1]] + rng.normal(size=2) * [0.1, 0.45])
        x = np.array([x[0] + 0.1 * x[1], x[1] - 0.5 * np.sin(x[0])]) + rng.normal(size=2) * [0.01, 0.1]
    y = np.array(y)
    y[rng.random(y.shape) < 0.2] = np.nan
    return model, es.Prior([0.8, 0.0], np.diag([0.25, 0.5])), es.Record(y, dt=0.1)


def most_probable(f, h, noise, V, prior, y):
    """The states that maximise the posterior density, from x[0] and the noises of each step as unknowns, by SciPy."""
    T, n, q = len(y), len(prior.mean), noise.shape[1]
    L, W, seen = np.linalg.cholesky(prior.covariance), jnp.asarray(noise), ~np.isnan(y)

    def states(unknowns):
        x = [jnp.asarray(prior.mean) + L @ unknowns[:n]]
        for w in unknowns[n:].reshape(T - 1, q):
            x.append(f(x[-1]) + W @ w)
        return jnp.stack(x)

    def residuals(unknowns):
        misses = [(y[k] - h(x)) / V for k, x in enumerate(states(unknowns))]
        return jnp.concatenate([unknowns, *(miss[np.flatnonzero(seen[k])] for k, miss in enumerate(misses))])

    found = least_squares(jax.jit(residuals), np.zeros(n + q * (T - 1)), jac=jax.jit(jax.jacfwd(residuals)),
                          method="lm", xtol=1e-15, ftol=1e-15, gtol=1e-15)  # fmt: skip
    return np.asarray(states(found.x))


def deviations(result):
    return np.sqrt(np.diagonal(result.covariance, axis1=1, axis2=2))


def test_iterated_it_ends_at_the_most_probable_states_and_parameters():
    model, prior, record = pendulum(25)
    stiffness = es.Prior([4.0], [[1.0]])
    joint = es.Prior(np.append(prior.mean, 4.0), np.diag([*np.diag(prior.covariance), 1.0]))
    best = most_probable(
        lambda z: jnp.append(model.f(z[:2], None, z[2:]), z[2]), lambda z: model.h(z, None, None),
        np.vstack([np.diag([0.01, 0.1]), np.zeros((1, 2))]), np.sqrt([0.01, 0.2]), joint, record.y,
    )  # fmt: skip
    algorithm = es.ExtendedKalman(model, parameters=stiffness)
    result = es.smooth(algorithm, record, prior=prior, iterations=50)
    assert_allclose((result.mean - best[:, :2]) / deviations(result), 0.0, atol=1e-6)
    assert_allclose(result.gain[:, 0], best[:, 2], atol=1e-6 * np.sqrt(result.gain_covariance.min()))
    once = es.smooth(algorithm, record, prior=prior)
    assert np.abs((once.mean - best[:, :2]) / deviations(result)).max() > 0.1


def test_iterated_with_fewer_noises_than_states_it_ends_at_the_most_probable_track():
    F, G = np.kron(np.eye(2), [[1.0, 1.0], [0.0, 1.0]]), np.kron(np.eye(2), [[0.5], [1.0]])

    def h(x):
        return jnp.stack([jnp.arctan2(x[2], x[0]), jnp.hypot(x[0], x[2])])

    model = es.NonlinearModel(lambda x, u, θ: F @ x, lambda x, u, θ: h(x), G=G, Q=0.05 * np.eye(2), R=np.diag([4e-4, 25.0]),
                              dt=1, states=("east", "east_speed", "north", "north_speed"))  # fmt: skip
    prior = es.Prior([300.0, -8.0, 300.0, 4.0], np.diag([2500.0, 9.0, 2500.0, 9.0]))
    record = es.simulate(model, seed=3, steps=30, prior=prior).record
    y = record.y.copy()
    y[np.random.default_rng(0).random(y.shape) < 0.2] = np.nan
    best = most_probable(lambda x: F @ x, h, np.sqrt(0.05) * G, np.array([0.02, 5.0]), prior, y)
    result = es.smooth(es.ExtendedKalman(model), es.Record(y, dt=1), prior=prior, iterations=50)
    assert_allclose((result.mean - best) / deviations(result), 0.0, atol=1e-6)


@pytest.mark.parametrize(("start", "variance"), [(2.0, 4.0), (2.5, 4.0), (5.0, 10.0)])
def test_steps_that_do_not_lessen_the_cost_are_shortened(start, variance):
    """Whole steps towards arctan x = 0.1 from far away end in a cycle."""
    x, points = start, []
    for _ in range(60):
        slope = 1 / (1 + x**2)
        e = 0.1 - np.arctan(x) - slope * (start - x)
        x = start + slope * variance / (slope**2 * variance + 1e-3) * e
        points.append(x)
    assert np.ptp(points[-4:]) > 1

    def residuals(x):
        return [(0.1 - np.arctan(x[0])) / np.sqrt(1e-3), (x[0] - start) / np.sqrt(variance)]

    best = least_squares(residuals, [0.1], xtol=1e-15, ftol=1e-15, gtol=1e-15).x[0]
    model = es.NonlinearModel(lambda x, u, θ: x, lambda x, u, θ: jnp.arctan(x), Q=[[0.0]], R=[[1e-3]], dt=1)
    record, prior = es.Record([0.1, np.nan], dt=1), es.Prior([start], [[variance]])
    result = es.smooth(es.ExtendedKalman(model), record, prior=prior, iterations=60)
    assert_allclose(result.mean.ravel(), best, atol=1e-6 * deviations(result)[0, 0])


def test_too_few_iterations_end_with_a_sentence():
    model, prior, record = pendulum(25)
    result = es.smooth(es.ExtendedKalman(model), record, prior=prior, iterations=2, on_failure="keep")
    assert result.outcome.code == 5
    assert "the iterations of smooth have not converged" in result.outcome.sentence
    with pytest.raises(es.RunError, match="Give more `iterations`"):
        es.smooth(es.ExtendedKalman(model), record, prior=prior, iterations=2)


def test_one_row_and_nothing_seen():
    model, prior, record = pendulum(12)
    for make in (es.ExtendedKalman, es.SecondOrderKalman, es.UnscentedKalman):
        one, filtered = (run(make(model), record[:1], prior=prior) for run in (es.smooth, es.estimate))
        assert_allclose(one.mean, filtered.mean, atol=1e-13)
        blind = es.Record(np.full((12, 2), np.nan), dt=0.1)
        never, predicted = (run(make(model), blind, prior=prior) for run in (es.smooth, es.estimate))
        assert_allclose(never.mean, predicted.mean, atol=1e-13)
        assert_allclose(never.covariance, predicted.covariance, atol=1e-13)
    again = es.smooth(es.ExtendedKalman(model), record[:1], prior=prior, iterations=30)
    assert again.outcome.code == 0


def test_covariances_are_semidefinite_and_smaller_than_those_of_the_filter():
    model, prior, record = pendulum(25)
    for make in (es.ExtendedKalman, es.SecondOrderKalman, es.UnscentedKalman):
        filtered, result = (run(make(model), record, prior=prior) for run in (es.estimate, es.smooth))
        assert np.linalg.eigvalsh(result.covariance).min() >= 0
        assert np.linalg.eigvalsh(filtered.covariance - result.covariance).min() >= -1e-12


def test_wrong_calls_are_refused_in_words():
    model, prior, record = pendulum(12)
    with pytest.raises(es.InputError, match='moments = "truncated" subtracts from it: use moments = "gaussian"'):
        es.smooth(es.SecondOrderKalman(model, moments="truncated"), record, prior=prior)
    with pytest.raises(es.InputError, match="tangents of the model, which UnscentedKalman does not use"):
        es.smooth(es.UnscentedKalman(model), record, prior=prior, iterations=5)
    with pytest.raises(es.InputError, match=r"lag = 3 does not: leave one of them out"):
        es.smooth(es.ExtendedKalman(model), record, prior=prior, iterations=5, lag=3)
    with pytest.raises(es.InputError, match=r"`iterations` must be an integer of at least 1\. Got 0"):
        es.smooth(es.ExtendedKalman(model), record, prior=prior, iterations=0)
    detector = es.ChangeDetection(es.ExtendedKalman(model, parameters=es.Prior([4.0], [[1.0]])), slots=5, levels=1)
    with pytest.raises(es.InputError, match="ChangeDetection has none: smooth the algorithm inside"):
        es.smooth(detector, record, prior=prior)
