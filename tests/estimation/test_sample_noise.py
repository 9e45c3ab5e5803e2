"""Noise that comes with the sample, against a model whose R varies in time."""

import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose

import estimable as es
from estimable.frozen import replace

T, DT = 60, 0.1
RNG = np.random.default_rng(6)
Y = RNG.normal(size=(T, 2))
U = RNG.normal(size=(T, 1))
SIGMA = RNG.uniform(0.05, 2.0, size=(T, 2))
SIGMA[10, 0] = np.nan  # the model's
SIGMA[20, 1] = 0.0
PRIOR = es.Prior([0.0, 0.0], np.eye(2))
CORRELATED = np.array([[0.5, 0.2], [0.2, 0.3]])
RECORD = es.Record(Y, U, dt=DT, sigma=SIGMA)


def model_of(R):
    return es.StateSpace([[0.9, 0.1], [0.0, 0.8]], [[0.0], [1.0]], Q=0.1 * np.eye(2), R=R, dt=DT)


def varying(R):
    """R of each row, with the correlations of R."""
    own = np.sqrt(np.diag(R))
    sd = np.where(np.isnan(SIGMA), own, SIGMA)
    return (R / np.outer(own, own)) * sd[:, :, None] * sd[:, None, :]


def filters(R):
    gain = es.Prior([1.0], [[0.2]])
    return [es.Kalman(model_of(R)), es.UnknownGain(model_of(R), gain)]


@pytest.mark.parametrize("R", [np.diag([0.5, 0.3]), CORRELATED])
@pytest.mark.parametrize("run", [es.estimate, es.smooth])
@pytest.mark.parametrize("which", [0, 1])
def test_equals_a_model_that_varies_in_time(R, run, which):
    found = run(filters(R)[which], RECORD, prior=PRIOR)
    exact = run(filters(varying(R))[which], replace(RECORD, sigma=None), prior=PRIOR)
    assert_allclose(found.mean, exact.mean, rtol=0, atol=1e-11)
    assert_allclose(found.covariance, exact.covariance, rtol=0, atol=1e-11)
    assert_allclose(found.log_likelihood, exact.log_likelihood, rtol=1e-10)


@pytest.mark.parametrize("kind", [es.ExtendedKalman, es.SecondOrderKalman, es.UnscentedKalman])
def test_nonlinear_filters(kind):
    linear = model_of(np.diag([0.5, 0.3]))
    curved = es.NonlinearModel(
        lambda x, u, θ: jnp.array([0.9 * x[0] + 0.1 * x[1], 0.8 * x[1] + u[0]]), lambda x, u, θ: x, Q=linear.Q, R=linear.R,
        dt=DT, inputs=["u1"],
    )  # fmt: skip
    found = es.estimate(kind(curved), RECORD, prior=PRIOR)
    exact = es.estimate(es.Kalman(linear), RECORD, prior=PRIOR)
    assert_allclose(found.mean, exact.mean, rtol=0, atol=1e-9)
    assert_allclose(found.covariance, exact.covariance, rtol=0, atol=1e-9)
    assert_allclose(found.innovation_covariance, exact.innovation_covariance, rtol=0, atol=1e-9)


def test_checks_and_fits_count_it():
    R, plain = np.diag([0.5, 0.3]), replace(RECORD, sigma=None)
    (one, other) = ((filters(R)[1], RECORD), (filters(varying(R))[1], plain))
    found, exact = (es.trust(*pair, prior=PRIOR) for pair in (one, other))
    for name in ("size", "whiteness", "scores"):
        assert found.families[name] == pytest.approx(exact.families[name], rel=1e-6)
    found, exact = (es.fit_noise(es.Kalman(f.model), record, prior=PRIOR, free=("Q",)) for f, record in (one, other))
    assert_allclose(found.parameters, exact.parameters, rtol=1e-8)
    found, exact = (es.diagnostics.check_innovations(es.estimate(*pair, prior=PRIOR), plain) for pair in (one, other))
    assert_allclose(found.nis.mean, exact.nis.mean, rtol=1e-9)


def test_online_and_a_bank():
    algorithm = es.Kalman(model_of(CORRELATED))
    found = es.estimate(algorithm, RECORD, prior=PRIOR)
    running = es.online(algorithm, prior=PRIOR)
    for k in range(T):
        assert_allclose(running.correct(Y[k], sigma=SIGMA[k]).mean, found.mean[k], atol=1e-11)
        running.predict(U[k])
    bank = es.estimate_bank(algorithm, [RECORD, RECORD], prior=PRIOR)
    assert_allclose(bank.mean[1], found.mean, atol=1e-12)


def test_columns_of_a_table():
    frame = pd.DataFrame({"y1": Y[:, 0], "y2": Y[:, 1], "sd": SIGMA[:, 0]})
    record = es.Record.from_pandas(frame, outputs=["y1", "y2"], dt=DT, sigma={"y1": "sd"})
    assert_allclose(record.sigma[:, 0], SIGMA[:, 0])
    assert np.isnan(record.sigma[:, 1]).all()
    assert_allclose(record[5:9].sigma, record.sigma[5:9])
    with pytest.raises(es.InputError, match="`sigma` names 'y3'"):
        es.Record.from_pandas(frame, outputs=["y1", "y2"], dt=DT, sigma={"y3": "sd"})


def test_refusals():
    with pytest.raises(es.InputError, match="`sigma` must be standard deviations, at least 0"):
        es.Record(Y, U, dt=DT, sigma=-np.ones((T, 2)))
    with pytest.raises(es.InputError, match="`sigma` must be"):
        es.Record(Y, U, dt=DT, sigma=np.ones((T, 3)))
    with pytest.raises(es.InputError, match="`sigma` must be standard deviations"):
        es.online(es.Kalman(model_of(CORRELATED)), prior=PRIOR).correct(Y[0], sigma=[-1.0, 1.0])


def wrapped(R):
    """Every wrapper, around a gain filter or a Kalman filter whose noise is R."""
    gain = es.UnknownGain(model_of(R), es.Prior([1.0], [[0.2]]))
    kalman = es.Kalman(model_of(R))
    return {
        "window": es.MovingWindow(gain, 10),
        "detector": es.ChangeDetection(gain, jump=0.2, seconds_between_false_alarms=600.0),
        "mixture": es.Mixture([kalman, es.Kalman(replace(model_of(R), Q=np.eye(2)))]),
        "gated": es.Gated(kalman, 0.99),
        "fixed": es.FixedGain(model_of(R), np.array([[0.3, 0.0], [0.1, 0.2]])),
        "unknown input": es.UnknownInput(model_of(R), unknown=["u1"]),
        "considered": es.UnknownGain(
            model_of(R), es.Prior([1.0], [[0.2]]), uncertainty=es.ModelUncertainty(A=0.05 * np.eye(2))
        ),
    }


@pytest.mark.parametrize("name", wrapped(np.eye(2)))
def test_every_filter_equals_a_model_that_varies_in_time(name):
    R = np.diag([0.5, 0.3])
    found = es.estimate(wrapped(R)[name], RECORD, prior=PRIOR)
    exact = es.estimate(wrapped(varying(R))[name], replace(RECORD, sigma=None), prior=PRIOR)
    assert_allclose(found.mean, exact.mean, rtol=0, atol=1e-10)
    assert_allclose(found.covariance, exact.covariance, rtol=0, atol=1e-10)
    assert_allclose(found.innovation_covariance, exact.innovation_covariance, rtol=0, atol=1e-10)
    if found.gain is not None:
        assert_allclose(found.gain, exact.gain, rtol=0, atol=1e-10)
