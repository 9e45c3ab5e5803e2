"""The update for independent noises is the general one: same belief, same likelihood, whatever was seen or is exact."""

import jax
import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimable import Kalman, Prior, Record, StateSpace, estimate
from estimable.kernels import independent, kalman

N, P = 4, 3
general, sequential = jax.jit(kalman.correct), jax.jit(independent.correct)


def belief(seed, rank, exact):
    """A belief of this rank, and a sample in which each output may be unseen, and `exact` of the sensors have no noise."""
    rng = np.random.default_rng(seed)
    Z = np.tril(rng.normal(size=(N, N))) * 10.0 ** rng.integers(-3, 4, size=(N, 1))
    Z[:, rank:] = 0.0
    r = 10.0 ** rng.uniform(-4, 2, size=P) * (np.arange(P) >= exact)
    m, C = rng.normal(size=N), rng.normal(size=(P, N))
    y = C @ (m + Z @ rng.normal(size=N)) + r * rng.normal(size=P)
    prior = kalman.Gaussian(m, Z, np.zeros((N, 0)), np.abs(m), np.zeros(()))
    return prior, kalman.Measurement(C, np.zeros(P), np.diag(r)), y, rng.random(P) < 0.8


@pytest.mark.parametrize("exact", [0, 1, 3])
@pytest.mark.parametrize("rank", [0, 1, 3, 4])
def test_independent_noises_are_a_case_of_the_general_update(rank, exact):
    for seed in range(20):
        case = belief(seed, rank, exact)
        a, b = general(*case), sequential(*case)
        P_a, P_b, prior = (state.Z @ state.Z.T for state in (a.state, b.state, case[0]))
        scale = np.sqrt(np.diag(prior)) + 1e-300
        assert_allclose(P_b / np.outer(scale, scale), P_a / np.outer(scale, scale), atol=1e-13)
        assert_allclose(b.state.m, a.state.m, rtol=1e-9, atol=1e-11 * scale.max())
        assert_allclose(b.innovation_covariance, a.innovation_covariance, rtol=1e-12, atol=1e-300)
        assert_allclose(b.log_likelihood, a.log_likelihood, rtol=1e-7, atol=1e-7)
        assert bool(b.contradicted) == bool(a.contradicted)
        assert_allclose(b.variance, a.variance, rtol=1e-7)
        assert np.array_equal(b.innovation, a.innovation, equal_nan=True)


def test_a_triangular_factor_stays_triangular_and_no_column_is_added():
    case = belief(0, N, 0)
    Z = sequential(*case).state.Z
    assert Z.shape == (N, N)
    assert np.array_equal(Z, np.tril(Z))


def test_a_diagonal_covariance_of_the_noise_is_found_to_be_one():
    """To rounding it is no matter whether R is known to be diagonal: with a correlation of nothing, the general form runs."""
    y = np.random.default_rng(0).normal(size=(30, 2))
    y[3, 0] = y[7] = np.nan
    prior = Prior([0.0, 0.0], np.eye(2))
    diagonal, almost = (
        StateSpace([[0.9, 0.2], [0.0, 0.7]], C=[[1.0, 0.0], [1.0, 1.0]], Q=np.eye(2), R=[[0.5, c], [c, 2.0]], dt=1)
        for c in (0.0, 1e-18)
    )
    results = [estimate(Kalman(model), Record(y, dt=1), prior=prior, engine="xla") for model in (diagonal, almost)]
    assert_allclose(results[0].covariance, results[1].covariance, rtol=1e-12)
    assert_allclose(results[0].log_likelihood, results[1].log_likelihood, rtol=1e-12)
