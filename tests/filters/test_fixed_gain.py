"""A filter whose gain is given, against its estimate written out on every noise, and against the Kalman filter."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cases import SIZES, case
from estimable import (
    AssumptionError,
    FixedGain,
    InputError,
    Kalman,
    Prior,
    Record,
    StateSpace,
    estimate,
    filter_covariance,
    kalman_gain,
)
from oracles import fixed_gain

FEATURES = ({}, {"cross": True}, {"varying": True}, {"missing": 0.8}, {"singular": True})


def gain(c):
    return 0.3 * np.random.default_rng(9).normal(size=(c.model.n, c.model.p))


@pytest.mark.parametrize("sizes", SIZES, ids=str)
@pytest.mark.parametrize("features", FEATURES, ids=str)
def test_its_covariance_is_that_of_its_error(sizes, features):
    c = case(1, sizes, **features)
    ours = estimate(FixedGain(c.model, gain(c)), c.record, prior=c.prior)
    means, covariances = fixed_gain.run(c.model, c.prior, c.record.y, c.record.u, gain(c))
    assert_allclose(ours.mean, means, rtol=1e-9, atol=1e-9)
    assert_allclose(ours.covariance, covariances, rtol=1e-9, atol=1e-9)


def steady(c):
    """The case from the Kalman filter's own stationary covariance, every sample seen."""
    best = kalman_gain(c.model)
    record = Record(np.nan_to_num(c.record.y), c.record.u, dt=0.5)
    return best, record, Prior(c.prior.mean, best.predicted_covariance)


def test_with_the_kalman_gain_it_is_the_kalman_filter():
    c = case(2)
    best, record, prior = steady(c)
    ours, optimal = (estimate(f, record, prior=prior) for f in (FixedGain(c.model, best.filter), Kalman(c.model)))
    for name in ("mean", "covariance", "innovation", "innovation_covariance", "log_likelihood_steps"):
        assert_allclose(getattr(ours, name), getattr(optimal, name), rtol=1e-8, atol=1e-9)


def test_no_gain_has_a_smaller_covariance():
    c = case(3, missing=0.5)
    ours, optimal = (estimate(f, c.record, prior=c.prior) for f in (FixedGain(c.model, gain(c)), Kalman(c.model)))
    assert np.linalg.eigvalsh(ours.covariance - optimal.covariance).min() > -1e-12
    assert_allclose(ours.covariance, np.swapaxes(ours.covariance, 1, 2), atol=0)


@pytest.mark.parametrize("cross", [False, True])
def test_it_settles_to_the_stationary_covariance(cross):
    model = case(4, cross=cross).model
    K = 0.5 * kalman_gain(model).filter
    P = filter_covariance(model, K)
    J, GS = np.eye(3) - K @ model.C, model.G @ model.S if cross else np.zeros((3, 2))
    L = np.hstack([-model.A @ K, np.eye(3)])
    noise = L @ np.block([[model.R, GS.T], [GS, model.G @ model.Q @ model.G.T]]) @ L.T
    M = np.linalg.solve(np.eye(9) - np.kron(model.A @ J, model.A @ J), noise.ravel()).reshape(3, 3)
    assert_allclose(P, J @ M @ J.T + K @ model.R @ K.T, rtol=1e-10, atol=1e-12)
    seen = Record(np.zeros((400, 2)), np.zeros((400, 2)), dt=0.5)
    last = estimate(FixedGain(model, K), seen, prior=Prior(np.zeros(3), np.eye(3)), keep="last")
    assert_allclose(last.covariance[-1], P, rtol=1e-9, atol=1e-12)


def test_what_is_diffuse_is_learnt_as_the_kalman_filter_learns_it():
    c = case(5, missing=0.0)
    prior = Prior(c.prior.mean, 0 * c.prior.covariance, diffuse=np.eye(3))
    ours, optimal = (estimate(f, c.record, prior=prior) for f in (FixedGain(c.model, gain(c)), Kalman(c.model)))
    assert_allclose(ours.mean[:2], optimal.mean[:2], rtol=1e-12)
    assert np.all(ours.diffuse_covariance[1:] == 0)
    rest = Record(c.record.y[1:], c.record.u[1:], dt=0.5)
    A, B = c.model.A, c.model.B
    known = Prior(
        A @ ours.mean[1] + B @ c.record.u[1], A @ ours.covariance[1] @ A.T + c.model.G @ c.model.Q @ c.model.G.T
    )
    again = estimate(FixedGain(c.model, gain(c)), rest[1:], prior=known)
    assert_allclose(again.mean, ours.mean[2:], rtol=1e-9)
    assert_allclose(again.covariance, ours.covariance[2:], rtol=1e-9)


def test_ordinary_inputs():
    c = case(6)
    known = Prior(c.prior.mean, np.zeros((3, 3)))
    quiet = replace(c.model, Q=0 * c.model.Q, R=np.zeros((2, 2)))
    exact = np.zeros((3, 2))
    blind = estimate(FixedGain(quiet, gain(c)), Record(np.full((3, 2), np.nan), np.zeros((3, 2)), dt=0.5), prior=known)
    assert np.all(blind.covariance == 0)
    assert blind.log_likelihood == 0
    still = estimate(FixedGain(c.model, exact), c.record, prior=c.prior)  # a gain of zero: nothing is learnt
    assert_allclose(still.mean[1], c.model.A @ c.prior.mean + c.model.B @ c.record.u[0], rtol=1e-12)
    assert estimate(FixedGain(c.model, gain(c)), c.record[:1], prior=c.prior).mean.shape == (1, 3)


def test_what_is_refused():
    model = case(7).model
    with pytest.raises(
        InputError, match=r"`filter` must be \(n, p\) = \(3, 2\).* Got \(2, 3\)\. Did you mean `filter\.T`\?"
    ):
        FixedGain(model, np.zeros((2, 3)))
    with pytest.raises(InputError, match="`model` must be a StateSpace"):
        FixedGain(None, [[1.0]])
    with pytest.raises(
        InputError, match=r"`model` must be discrete, because the gain applies to a sample: give model.discretise\(dt\)"
    ):
        filter_covariance(StateSpace([[-1.0]], R=[[1.0]], dt=0), [[1.0]])
    with pytest.raises(AssumptionError, match="the largest modulus of an eigenvalue is 2, not < 1"):
        filter_covariance(StateSpace([[2.0]], Q=[[1.0]], R=[[1.0]], dt=1), [[0.0]])
