"""The promises about numbers: semidefinite over a million steps, right to many digits where it is hard."""

import mpmath as mp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from cases import case
from estimable import Kalman, Prior, Record, StateSpace, estimate, estimate_bank, simulate


def smallest(P):
    """Smallest eigenvalue over all of them, each relative to its largest."""
    values = np.linalg.eigvalsh(P / np.abs(P).max(axis=(-2, -1), keepdims=True))
    return np.min(values[..., 0] / values[..., -1])


@pytest.mark.parametrize("R", [[1e-9, 1.0], [0.0, 1e-6], [0.0, 0.0]], ids=str)
def test_covariances_stay_positive_semidefinite_over_a_million_steps(R):
    T = 1_000_000
    model = StateSpace(
        [[1.0, 0.01, 0.0], [0.0, 1.0, 0.01], [0.0, -0.05, 0.999]], C=[[1.0, 0.0, 0.0], [1.0, 1.0, 0.0]],
        G=[[0.0], [0.0], [1.0]], Q=[[1e-4]], R=np.diag(R), dt=0.01,
    )  # fmt: skip
    y = simulate(model, seed=0, steps=T, prior=Prior(np.zeros(3), np.eye(3))).record.y.copy()
    y[np.random.default_rng(0).random((T, 2)) < 0.3] = np.nan
    result = estimate(Kalman(model), Record(y, dt=0.01), prior=Prior(np.zeros(3), 1e6 * np.eye(3)))
    P = result.covariance
    assert np.array_equal(P, np.swapaxes(P, 1, 2))
    assert smallest(P) >= -1e-15


def test_covariances_stay_positive_semidefinite_where_joseph_s_form_does_not():
    """A noise-free sensor, one process noise and a large prior: Joseph's form fails on four of five of these models."""
    rng, models = np.random.default_rng(0), []
    for _ in range(300):
        A = rng.normal(size=(4, 4))
        A /= np.abs(np.linalg.eigvals(A)).max()
        C, G = rng.normal(size=(2, 4)), rng.normal(size=(4, 1))
        R = np.diag([0.0, 10.0 ** rng.integers(-9, 0)])
        models.append(Kalman(StateSpace(A, C=C, G=G, Q=[[1e-4]], R=R, dt=1)))
    prior = Prior(np.zeros(4), 1e6 * np.eye(4))
    P = estimate_bank(models, Record(np.zeros((60, 2)), dt=1), prior=prior).covariance
    assert smallest(P) >= -1e-15


def exact(model, prior, y):
    """The conventional filter in 60 digits."""
    mp.mp.dps = 60
    A, C, Q, R = (mp.matrix(np.array(M).tolist()) for M in (model.A, model.C, model.G @ model.Q @ model.G.T, model.R))
    x, P = mp.matrix(prior.mean.tolist()), mp.matrix(prior.covariance.tolist())
    rows = []
    for row in y:
        S = C * P * C.T + R
        K = P * C.T * S**-1
        x, P = x + K * (mp.matrix(row.tolist()) - C * x), P - K * C * P
        rows.append((np.array(x.tolist(), float).ravel(), np.array(P.tolist(), float)))
        x, P = A * x, A * P * A.T + Q
    return rows


def ill_conditioned():
    """Three ways to make a covariance of condition 1e12."""
    rng = np.random.default_rng(3)
    A = np.eye(3) + 0.1 * rng.normal(size=(3, 3))
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    spread = turn @ np.diag([1e6, 1.0, 1e-6]) @ turn.T
    yield (
        "prior",
        StateSpace(A, C=np.eye(3)[:2], Q=1e-8 * np.eye(3), R=np.eye(2), dt=1),
        Prior(np.ones(3), (spread + spread.T) / 2),
    )
    yield (
        "sensor",
        StateSpace(A, C=np.eye(3)[:2] + 0.1, Q=np.eye(3), R=1e-12 * np.eye(2), dt=1),
        Prior(np.ones(3), np.eye(3)),
    )
    yield (
        "alike",
        StateSpace(A, C=[[1.0, 1.0, 1.0], [1.0, 1.0, 1.0 + 1e-6]], Q=1e-6 * np.eye(3), R=1e-12 * np.eye(2), dt=1),
        Prior(np.ones(3), np.eye(3)),
    )


@pytest.mark.parametrize(("model", "prior"), [p[1:] for p in ill_conditioned()], ids=[p[0] for p in ill_conditioned()])
def test_agrees_with_sixty_digits_at_condition_1e12(model, prior):
    y = np.random.default_rng(1).normal(size=(12, 2))
    result = estimate(Kalman(model), Record(y, dt=1), prior=prior)
    for k, (mean, P) in enumerate(exact(model, prior, y)):
        scale = np.sqrt(np.diag(P))
        assert_allclose(result.covariance[k] / np.outer(scale, scale), P / np.outer(scale, scale), rtol=0, atol=1e-6)
        assert_allclose(result.mean[k] / scale, mean / scale, rtol=1e-6, atol=1e-3)


def test_the_units_of_the_states_change_nothing_but_the_units():
    c = case(6, (4, 1, 3))
    units = np.diag([1e8, 1.0, 1e-8, 1e3])
    direct = estimate(Kalman(c.model), c.record, prior=c.prior)
    scaled = estimate(Kalman(c.model.in_basis(units)), c.record, prior=c.prior.in_basis(units))
    assert_allclose(scaled.log_likelihood, direct.log_likelihood, rtol=1e-10)
    assert_allclose(scaled.mean, direct.mean @ units, rtol=1e-8, atol=1e-12)
