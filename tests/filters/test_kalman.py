"""Kalman against oracles that share nothing with it."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cases import SIZES, case
from estimable import Kalman, Prior, Record, RunError, StateSpace, estimate
from oracles import dense, textbook

FEATURES = (
    {},
    {"cross": True},
    {"varying": True},
    {"cross": True, "varying": True},
    {"missing": 0.0},
    {"missing": 0.8},
    {"singular": True},
)


@pytest.mark.parametrize("sizes", SIZES, ids=str)
@pytest.mark.parametrize("features", FEATURES, ids=str)
def test_equals_the_textbook_filter_that_deletes_rows(sizes, features):
    for seed in range(5):
        c = case(seed, sizes, **features)
        ours = estimate(Kalman(c.model), c.record, prior=c.prior)
        means, covariances, total = textbook.kalman(c.model, c.prior, c.record.y, c.record.u)
        assert_allclose(ours.mean, means, rtol=1e-9, atol=1e-9)
        assert_allclose(ours.covariance, covariances, rtol=1e-9, atol=1e-9)
        assert_allclose(ours.log_likelihood, total, rtol=1e-9)
        assert_allclose(ours.log_likelihood_steps.sum(), total, rtol=1e-9)


@pytest.mark.parametrize("features", FEATURES, ids=str)
def test_equals_one_dense_gaussian(features):
    c = case(7, (3, 2, 2), **features)
    ours = estimate(Kalman(c.model), c.record, prior=c.prior)
    for k in (0, 4, 11):
        mean, covariance, total = dense.conditioned(c.model, c.prior, c.record.y, c.record.u, k)
        assert_allclose(ours.mean[k], mean, rtol=1e-8, atol=1e-9)
        assert_allclose(ours.covariance[k], covariance, rtol=1e-8, atol=1e-9)
    assert_allclose(ours.log_likelihood, total, rtol=1e-9)


def test_innovations_are_raw_and_their_covariances_complete():
    c = case(3, cross=True)
    ours = estimate(Kalman(c.model), c.record, prior=c.prior)
    A, B, C, D, Q, R, GS = textbook.matrices(c.model, 0)
    expected = c.record.y[0] - C @ c.prior.mean - D @ c.record.u[0]
    assert_allclose(ours.innovation[0], expected, rtol=1e-12)  # NaN where not seen, in both
    assert_allclose(ours.innovation_covariance[0], C @ c.prior.covariance @ C.T + R, rtol=1e-12)
    assert np.array_equal(np.isnan(ours.innovation), np.isnan(c.record.y))


DIFFUSE = ((1, 0.0), (2, 0.0), (3, 0.0), (3, 0.5), (2, 0.4))


@pytest.mark.parametrize(("rank", "missing"), DIFFUSE)
@pytest.mark.parametrize("p", [1, 2])
def test_a_diffuse_start_equals_least_squares_with_a_flat_prior(rank, missing, p):
    for seed in range(4):
        c = case(seed, (3, 2, p), missing=missing)
        prior = Prior(c.prior.mean, c.prior.covariance, diffuse=c.rng.normal(size=(3, rank)))
        ours = estimate(Kalman(c.model), c.record, prior=prior)
        for k in range(12):
            if not (~np.isnan(c.record.y[: k + 1])).any():
                continue
            mean, covariance, open_directions = dense.diffuse_conditioned(c.model, prior, c.record.y, c.record.u, k)
            off = np.eye(3) - open_directions @ np.linalg.pinv(open_directions)  # what is determined
            assert_allclose(off @ ours.mean[k], off @ mean, rtol=1e-6, atol=1e-6)
            assert_allclose(off @ ours.covariance[k] @ off, off @ covariance @ off, rtol=1e-6, atol=1e-6)
            assert np.linalg.matrix_rank(ours.diffuse_covariance[k], tol=1e-12) == open_directions.shape[1]
            assert_allclose(
                off @ ours.diffuse_covariance[k] @ off, 0.0, atol=1e-8 * (1 + ours.diffuse_covariance[k].max())
            )
        assert np.all(ours.diffuse_covariance[-1] == 0.0)  # exactly, not to rounding
        assert_allclose(
            ours.log_likelihood, dense.diffuse_log_likelihood(c.model, prior, c.record.y, c.record.u), rtol=1e-7
        )


def test_a_large_variance_tends_to_the_diffuse_one():
    c = case(2, (3, 2, 2), missing=0.0)
    basis = np.eye(3)[:, :2]
    diffuse = estimate(Kalman(c.model), c.record, prior=Prior(c.prior.mean, c.prior.covariance, diffuse=basis))
    large = Prior(c.prior.mean, c.prior.covariance + 1e7 * basis @ basis.T)
    near = estimate(Kalman(c.model), c.record, prior=large)
    assert_allclose(near.mean[-1], diffuse.mean[-1], rtol=1e-5)
    assert_allclose(near.log_likelihood + 0.5 * 2 * np.log(1e7), diffuse.log_likelihood, rtol=1e-5)


def test_a_known_start_stays_known_without_noise():
    model = StateSpace([[0.9, 0.1], [0.0, 0.8]], C=[[1.0, 1.0]], R=[[0.5]], dt=1)
    ours = estimate(Kalman(model), Record([[5.0], [np.nan], [-3.0]], dt=1), prior=Prior([1.0, 2.0], np.zeros((2, 2))))
    assert np.all(ours.covariance == 0.0)
    assert_allclose(ours.mean, [[1, 2], [1.1, 1.6], [1.15, 1.28]])


def test_a_noise_free_channel_is_met_exactly():
    c = case(1, (3, 2, 2), singular=False, missing=0.0)
    model = replace(c.model, R=np.diag([0.0, 1.0]))
    ours = estimate(Kalman(model), c.record, prior=c.prior)
    fitted = ours.mean @ model.C.T + c.record.u @ model.D.T
    assert_allclose(fitted[:, 0], c.record.y[:, 0], rtol=1e-10, atol=1e-10)
    variance = np.einsum("i,tij,j->t", model.C[0], ours.covariance, model.C[0])
    assert np.all(np.abs(variance) < 1e-14)


def test_what_is_known_exactly_and_measured_without_noise_adds_nothing():
    model = StateSpace([[0.5]], C=[[1.0], [2.0]], R=np.zeros((2, 2)), dt=1)
    ours = estimate(Kalman(model), Record([[4.0, 8.0], [2.0, 4.0]], dt=1), prior=Prior([4.0], [[0.0]]))
    assert_allclose(ours.mean.ravel(), [4.0, 2.0])
    assert ours.log_likelihood == 0.0


def test_a_contradiction_of_what_is_known_exactly_is_refused_with_its_sample():
    model = StateSpace([[0.5]], C=[[1.0]], R=[[0.0]], dt=2.0)
    record = Record([[4.0], [2.5]], dt=2.0)
    with pytest.raises(RunError, match=r"At sample 1 \(t = 2 s\).*contradicts a value that is known exactly") as caught:
        estimate(Kalman(model), record, prior=Prior([4.0], [[0.0]]))
    assert caught.value.outcome.code == 2
    kept = estimate(Kalman(model), record, prior=Prior([4.0], [[0.0]]), on_failure="keep")
    assert (kept.outcome.code, kept.outcome.sample, kept.outcome.time) == (2, 1, 2.0)


def test_an_overflow_is_refused_with_its_sample():
    model = StateSpace([[1e200]], C=[[1.0]], R=[[1.0]], dt=1)
    with pytest.raises(RunError, match=r"At sample 1 .*no longer finite"):
        estimate(Kalman(model), Record(np.full((4, 1), np.nan), dt=1), prior=Prior([1.0], [[1.0]]))


def test_one_sample_and_no_sample_seen():
    c = case(5, (2, 1, 1))
    one = estimate(Kalman(c.model), c.record[:1], prior=c.prior)
    assert one.mean.shape == (1, 2)
    blind = estimate(Kalman(c.model), Record(np.full((3, 1), np.nan), c.record.u[:3], dt=0.5), prior=c.prior)
    assert_allclose(blind.mean[0], c.prior.mean)
    assert blind.log_likelihood == 0.0


@pytest.mark.parametrize("n", [9, 12])
def test_larger_models_take_the_looped_path(n):
    c = case(11, (n, 2, 9))
    ours = estimate(Kalman(c.model), c.record, prior=c.prior)
    means, covariances, total = textbook.kalman(c.model, c.prior, c.record.y, c.record.u)
    assert_allclose(ours.mean, means, rtol=1e-7, atol=1e-8)
    assert_allclose(ours.covariance, covariances, rtol=1e-7, atol=1e-8)
    assert_allclose(ours.log_likelihood, total, rtol=1e-9)
