"""Independent noises: the same outputs in distribution, and a loop that takes the model."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import estimable as es

MODEL = es.ARX([-0.6], [1.0], delay=1, noise_variance=0.2, dt=1, offset=[3.0]).to_state_space()


def autocovariance(model, lags):
    """Of the outputs, stationary: by the Lyapunov series."""
    G = np.asarray(model.G)
    Q, A, C = G @ np.asarray(model.Q) @ G.T, np.asarray(model.A), np.asarray(model.C)
    S = np.zeros((model.n, model.p)) if model.S is None else G @ np.asarray(model.S)
    P = sum(np.linalg.matrix_power(A, k) @ Q @ np.linalg.matrix_power(A, k).T for k in range(200))
    N = A @ P @ C.T + S
    return [C @ P @ C.T + model.R, *(C @ np.linalg.matrix_power(A, k) @ N for k in range(lags))]


def test_outputs_have_the_same_distribution_and_response():
    found = es.uncorrelated(MODEL)
    assert (found.S, found.operating_point, found.n) == (None, None, 2)
    assert_allclose(autocovariance(found, 4), autocovariance(MODEL, 4), atol=1e-12)
    u = np.random.default_rng(0).normal(size=20)
    still = [es.simulate(es.StateSpace(m.A, m.B, m.C, m.D, Q=0 * np.eye(m.n), R=0 * m.R, dt=1), u, seed=0).record.y
             for m in (found, MODEL)]  # fmt: skip
    assert_allclose(still[0], still[1], atol=1e-12)


def test_an_identified_model_goes_into_a_loop():
    plant = es.uncorrelated(MODEL)
    L = np.asarray(es.lqr_gain(plant, np.diag([1.0, 0.0]), [[1.0]]).feedback)
    law = es.StateFeedback(L, reference_gain=[[1.0]])
    closed = es.close_loop(
        plant, law, es.Kalman(plant), reference=np.ones((30, 1)), seed=0, prior=es.Prior([0, 0], np.eye(2))
    )
    assert np.isfinite(closed.applied).all()


def test_without_cross_noise_only_the_operating_point_goes():
    model = es.StateSpace([[0.5]], [[1.0]], Q=[[1.0]], R=[[1.0]], dt=1, operating_point={"inputs": [2.0]})
    found = es.uncorrelated(model)
    assert (found.n, found.operating_point) == (1, None)


def test_models_that_vary_are_refused():
    with pytest.raises(es.InputError, match="`model` must be constant"):
        es.uncorrelated(es.StateSpace(np.full((4, 1, 1), 0.5), Q=[[1.0]], R=[[1.0]], dt=1))
