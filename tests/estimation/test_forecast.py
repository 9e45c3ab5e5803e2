"""Forecasts against the filter run on by hand."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cases import case
from estimable import InputError, Kalman, Prior, Record, StateSpace, UnknownGain, estimate, forecast, simulate_bank
from estimable.diagnostics import nees


@pytest.mark.parametrize("cross", [False, True])
def test_rows_to_come_are_the_model_run_on(cross):
    c = case(1, cross=cross)
    model, k = c.model, 12
    u = c.rng.normal(size=(4, 2))
    ahead = forecast(estimate(Kalman(model), c.record, prior=c.prior), u)
    Q = model.G @ model.Q @ model.G.T
    x, P = ahead.mean[0], ahead.covariance[0]  # the first row is what the filter predicts
    blind = Record(np.vstack([c.record.y, np.full((1, 2), np.nan)]), np.vstack([c.record.u, u[:1]]), dt=0.5)
    assert_allclose(x, estimate(Kalman(model), blind, prior=c.prior).mean[k], atol=1e-13)
    for i in range(4):
        assert_allclose(ahead.mean[i], x, atol=1e-12)
        assert_allclose(ahead.covariance[i], P, atol=1e-12)
        assert_allclose(ahead.output[i], model.C @ x + model.D @ u[i], atol=1e-12)
        assert_allclose(ahead.output_covariance[i], model.C @ P @ model.C.T + model.R, atol=1e-12)
        x, P = model.A @ x + model.B @ u[i], model.A @ P @ model.A.T + Q
    assert_allclose(ahead.t, 0.5 * np.arange(12, 16))


def test_a_gain_that_is_not_known_widens_the_forecast():
    model = StateSpace(
        [[0.5]], [[1.0]], Q=[[0.01]], R=[[0.01]], dt=1, operating_point={"states": [5.0], "inputs": [2.0]}
    )
    record = Record([[5.0], [5.1]], [[2.0], [2.0]], dt=1)
    result = estimate(UnknownGain(model, Prior([1.0], [[0.25]])), record, prior=Prior([5.0], [[0.1]]))
    ahead = forecast(result, [[2.0], [4.0], [2.0]])
    assert_allclose(ahead.gain, 1.0, atol=1e-12)
    assert_allclose(ahead.output, ahead.mean, atol=1e-12)
    assert_allclose(ahead.covariance[2] - (0.25 * ahead.covariance[1] + 0.01), 4 * 0.25, atol=1e-9)


def test_outputs_to_come_fall_where_the_forecast_says():
    model = StateSpace([[0.9, 0.2], [-0.1, 0.8]], C=[[1.0, 0.0]], Q=0.1 * np.eye(2), R=[[0.2]], dt=1)
    prior = Prior([0.0, 0.0], np.eye(2))
    runs = simulate_bank(model, seed=1, runs=200, steps=15, prior=prior).items.record.y
    ahead = [forecast(estimate(Kalman(model), Record(y[:10], dt=1), prior=prior), steps=5) for y in runs]
    for i in (0, 4):
        errors = np.array([y[10 + i] - a.output[i] for y, a in zip(runs, ahead, strict=True)])
        assert nees(errors, np.array([a.output_covariance[i] for a in ahead])).consistent


def test_a_wrong_call_is_refused_in_words():
    c = case(1)
    result = estimate(Kalman(c.model), c.record, prior=c.prior)
    with pytest.raises(InputError, match=r"`u` must be \(steps, m\) = \(steps, 2\)"):
        forecast(result, steps=3)
    with pytest.raises(InputError, match=r"`steps` = 3, but `u` has 2 rows"):
        forecast(result, np.zeros((2, 2)), steps=3)
    with pytest.raises(InputError, match="`result` must be a result of estimate"):
        forecast(c.record, np.zeros((2, 2)))
    varying = case(1, varying=True)
    with pytest.raises(InputError, match="the model varies over the 12 rows"):
        forecast(estimate(Kalman(varying.model), varying.record, prior=varying.prior), np.zeros((2, 2)))
