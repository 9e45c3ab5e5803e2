"""α-β trackers over steps of any length: against a loop that deletes what was not seen, with the error written on every noise."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimable import (
    AlphaBeta,
    InputError,
    Prior,
    Record,
    StateSpace,
    alpha_beta_covariance,
    alpha_beta_gains,
    alpha_beta_gamma_gains,
    estimate,
    filter_covariance,
)

T = np.array([0.0, 1.0, 1.5, 4.0, 4.2, 5.0, 8.0, 8.1, 9.0, 9.5, 11.0, 12.0])
Y = np.random.default_rng(0).normal(size=12).cumsum()
Y[[2, 5, 6]] = np.nan
GONE = np.isnan(Y)
PRIOR = Prior([0.3, -0.2], [[0.5, 0.1], [0.1, 0.4]])


def track(σ_a2, R, dt=0.0, order=2):
    return StateSpace(np.eye(order, k=1), C=np.eye(1, order), G=np.eye(order)[:, -1:], Q=[[σ_a2]], R=[[R]], dt=dt)


def loop(gains, prior, t, y, σ_a2, variance):
    """Means, and covariances of the error x - x^ from its own map on (x0 - mean, noises): no recursion of covariances.

    `gains(T)`, `variance(T)`: of a sample T seconds after the last, (α, β) and R, or None where it is not used.
    """
    n, size = 2, 2 + 3 * len(t)
    x, error, scale = np.array(prior.mean), np.zeros((n, size)), np.zeros((size, size))
    error[:, :2], scale[:2, :2] = np.eye(2), prior.covariance
    means, covariances, last = [], [], t[0]
    for k, (now, datum) in enumerate(zip(t, y, strict=True)):
        if k:
            h = now - t[k - 1]
            Φ, w = np.array([[1.0, h], [0.0, 1.0]]), slice(2 + 3 * k, 4 + 3 * k)
            x, error = Φ @ x, Φ @ error
            error[:, w] += np.eye(2)
            scale[w, w] = σ_a2 * np.array([[h**3 / 3, h**2 / 2], [h**2 / 2, h]])
        since = now - last
        R = variance(since)
        if not np.isnan(datum) and R is not None:
            α, β = gains(since)
            K = np.array([α, β / since if since > 0 else 0.0])
            x, error = x + K * (datum - x[0]), error - np.outer(K, error[0])
            error[:, 4 + 3 * k] -= K
            scale[4 + 3 * k, 4 + 3 * k] = R
        last = last if np.isnan(datum) else now
        means.append(x)
        covariances.append(error @ scale @ error.T)
    return np.array(means), np.array(covariances)


def given(_):
    return 0.6, 0.3


def averaged(since):
    return 0.7 / since if since > 0 else None


def indexed(since, variance):
    if since == 0:
        return 0.0, 0.0
    return alpha_beta_gains("kalata", index=float(np.sqrt(0.4 * since**3 / variance(since))))


CASES = {
    "averaging": (AlphaBeta(0.6, 0.3, sigma_a2=0.4, sigma_s2=0.7), given, averaged),
    "each sample alike": (AlphaBeta(0.6, 0.3, model=track(0.4, 0.7)), given, lambda _: 0.7),
    "index, averaging": (AlphaBeta("kalata", sigma_a2=0.4, sigma_s2=0.7), lambda s: indexed(s, averaged), averaged),
    "index": (AlphaBeta("kalata", model=track(0.4, 0.7)), lambda s: indexed(s, lambda _: 0.7), lambda _: 0.7),
}


@pytest.mark.parametrize("name", CASES)
def test_over_irregular_steps_with_gaps_it_is_the_loop(name):
    tracker, gains, variance = CASES[name]
    ours = estimate(tracker, Record(Y, t=T), prior=PRIOR)
    means, covariances = loop(gains, PRIOR, T, Y, 0.4, variance)
    assert_allclose(ours.mean, means, rtol=1e-11, atol=1e-12)
    assert_allclose(ours.covariance, covariances, rtol=1e-10, atol=1e-12)


def test_without_variances_it_says_the_means_alone():
    beside = Record(np.stack([0 * Y, Y], axis=1), t=T, outputs=["height", "range"])
    ours = estimate(AlphaBeta(0.6, 0.3, output="range"), beside, prior=PRIOR)
    assert_allclose(ours.mean, loop(given, PRIOR, T, Y, 0.0, lambda _: 1.0)[0], rtol=1e-11)
    assert ours.covariance is None
    assert ours.innovation_covariance is None


@pytest.mark.parametrize("name", ["averaging", "index"])
def test_a_missing_sample_is_a_deleted_row(name):
    tracker = CASES[name][0]
    whole = estimate(tracker, Record(Y, t=T), prior=PRIOR)
    rest = estimate(tracker, Record(Y[~GONE], t=T[~GONE]), prior=PRIOR)
    assert_allclose(whole.mean[~GONE], rest.mean, rtol=1e-12)
    assert_allclose(whole.covariance[~GONE], rest.covariance, rtol=1e-10)
    assert_allclose(whole.log_likelihood, rest.log_likelihood, rtol=1e-11)


@pytest.mark.parametrize("gains", [(0.5, 0.25), alpha_beta_gains("least_worst"), (1.5, 0.4)], ids=str)
def test_at_a_constant_step_it_settles_to_the_closed_form(gains):
    ours = estimate(
        AlphaBeta(*gains, sigma_a2=0.4, sigma_s2=0.7), Record(np.zeros(300), dt=0.3), prior=PRIOR, keep="last"
    )
    expected = alpha_beta_covariance(*gains, dt=0.3, sigma_a2=0.4, sigma_s2=0.7)
    assert_allclose(ours.covariance[-1], expected, rtol=1e-9)


def test_with_an_acceleration_it_settles_to_the_covariance_of_its_gain():
    α, β, γ = alpha_beta_gamma_gains("critically_damped", alpha=0.7)
    tracker = AlphaBeta(α, β, gamma=γ, sigma_a2=0.4, sigma_s2=0.7)
    prior = Prior([0.0, 0.0, 0.0], np.eye(3))
    ours = estimate(tracker, Record(np.zeros(300), dt=0.3), prior=prior, keep="last")
    steady = track(0.4, 0.7 / 0.3, order=3).discretise(0.3)
    assert_allclose(ours.covariance[-1], filter_covariance(steady, [[α], [β / 0.3], [γ / 0.09]]), rtol=1e-9)
    assert ours.names.states == ("position", "velocity", "acceleration")


def test_bass_s_gains_are_not_stable_at_steps_of_ratio_10_and_the_index_is():
    t = np.cumsum(np.tile([1.0, 10.0], 6) * (1 + 1e-3 * np.arange(12)))
    record = Record(np.zeros(12), t=t)
    bass = estimate(AlphaBeta(*alpha_beta_gains("least_worst"), sigma_a2=0.4, sigma_s2=0.7), record, prior=PRIOR)
    index = estimate(AlphaBeta("kalata", sigma_a2=0.4, sigma_s2=0.7), record, prior=PRIOR)
    growth = (np.linalg.norm(bass.mean[-1]) / np.linalg.norm(bass.mean[-5])) ** (1 / 2)  # in two steps
    assert_allclose(growth, 1.43, atol=0.01)
    assert np.all(np.diff(bass.covariance[4::2, 1, 1]) > 0)
    assert np.ptp(index.covariance[5::2, 0, 0]) < 0.01 * index.covariance[-1, 0, 0]


def test_two_samples_start_it_where_nothing_is_known():
    nothing = Prior([0.0, 0.0], np.zeros((2, 2)), diffuse=np.eye(2))
    ours = estimate(
        AlphaBeta(0.6, 0.3, model=track(0.4, 0.7)), Record([3.0, 5.0, 6.0], t=[0.0, 4.0, 5.0]), prior=nothing
    )
    assert_allclose(ours.mean[:2], [[3.0, 0.0], [5.0, 0.5]])
    assert_allclose(ours.mean[2], [5.5 + 0.6 * 0.5, 0.5 + 0.3 * 0.5])


def test_ordinary_inputs():
    known, line = Prior([1.0, 0.5], np.zeros((2, 2))), 1.0 + 0.5 * T
    quiet = estimate(AlphaBeta(0.5, 0.2, sigma_a2=0.0, sigma_s2=0.0), Record(line + 0 * Y, t=T), prior=known)
    assert_allclose(quiet.mean[:, 0], line, rtol=1e-12)
    assert np.all(quiet.covariance == 0)
    blind = estimate(AlphaBeta("kalata", model=track(1.0, 0.0)), Record(np.full(12, np.nan), t=T), prior=known)
    assert blind.log_likelihood == 0
    one = estimate(AlphaBeta(0.5, 0.2, model=track(1.0, 1.0)), Record([3.0], dt=1), prior=PRIOR)
    assert_allclose(one.mean, [[0.3 + 0.5 * 2.7, -0.2]])


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: AlphaBeta(1.0, 2.0), "an α-β tracker is stable for 0 < α < 2 and 0 < β < 2 (2 - α) only. Got α = 1, β = 2."),
        (lambda: AlphaBeta(0.5), "`beta` must be given with `alpha`: α-β trackers have two gains"),
        (lambda: AlphaBeta(-1, 0.5), "`alpha` must be greater than 0. Got -1."),
        (lambda: AlphaBeta(0.9, 0.9, gamma=3.0), "the error is unstable with these gains: its largest pole has modulus"),
        (lambda: AlphaBeta("best"), "`alpha` must be 'kalata'. Got 'best'."),
        (lambda: AlphaBeta("kalata", 0.5, sigma_a2=1, sigma_s2=1),
         "`beta` must not be given with alpha = 'kalata', which computes the gains."),
        (lambda: AlphaBeta("kalata"), "alpha = 'kalata' needs `sigma_a2` and `sigma_s2`, or a `model`"),
        (lambda: AlphaBeta(0.5, 0.2, sigma_a2=1.0),
         "`sigma_a2` and `sigma_s2` must be given together: the covariance needs both. `sigma_s2` is missing."),
        (lambda: AlphaBeta(0.5, 0.2, sigma_a2=-1.0, sigma_s2=1.0), "`sigma_a2` must be at least 0. Got -1."),
        (lambda: AlphaBeta(0.5, 0.2, sigma_a2=1.0, model=track(1.0, 1.0)), "give `model`, or `sigma_a2`, `sigma_s2` and"),
        (lambda: AlphaBeta(0.5, 0.2, model=track(1.0, 1.0, order=3)),
         "`model` must describe a measured position and its derivatives: for 2 gains A = [[0.0, 1.0], [0.0, 0.0]]"),
        (lambda: AlphaBeta(0.5, 0.2, model=3), "`model` must be a StateSpace. Got 3."),
        (lambda: AlphaBeta("kalata", model=track(1.0, 1.0).discretise(1.0)), "alpha = 'kalata' needs a continuous `model`"),
    ],
)  # fmt: skip
def test_what_is_refused(make, sentence):
    with pytest.raises(InputError) as caught:
        make()
    assert any(fault.startswith(sentence) for fault in caught.value.faults), caught.value.faults
