"""Standard deviations from the spectrum of the residuals: exact sums, any colour of the noise, and what the checks say."""

import numpy as np
import pytest
from benchmarks.figures.sigma_in_colour import CASES, drawn, scores
from numpy.testing import assert_allclose
from scipy.linalg import toeplitz
from scipy.signal import lfilter

import estimable as es
from estimable.kernels.coloured_noise import Colour, beyond, colour, moments, times

ROWS = 400


def test_the_moments_are_those_of_the_dense_covariance_with_rows_missing():
    g = np.random.default_rng(0)
    at = np.flatnonzero(g.random(80) < 0.6) + 3
    a = np.array([-1.2, 0.5])
    r = np.correlate(h := lfilter([1], np.append(1, a), np.eye(1, 4000)[0]), h, mode="full")[len(h) - 1 :]
    J = g.normal(size=(len(at), 3))
    dense = J.T @ toeplitz(r / r[0])[:100, :100][np.ix_(at, at)] @ J
    assert_allclose(moments(J, at, Colour(a, r[:3] / r[0])), dense, rtol=1e-12, atol=1e-12)


def test_the_autoregression_of_residuals_is_found_with_its_order_also_with_rows_missing():
    w = lfilter([1], [1, -1.2, 0.5], np.random.default_rng(0).normal(size=5000))
    assert_allclose(colour(w, np.arange(5000)).a, [-1.2, 0.5], atol=0.05)
    at = np.flatnonzero(np.random.default_rng(2).random(5000) < 0.6)
    right = Colour(np.array([-1.2, 0.5]), np.array([1.0, 0.8]))
    assert_allclose(colour(w[at], at).correlation(6), right.correlation(6), atol=0.05)
    assert len(colour(np.random.default_rng(1).normal(size=5000), np.arange(5000)).a) <= 1
    assert len(colour(np.ones(5), np.arange(5)).a) == len(colour(np.zeros(500), np.arange(500)).a) == 0


def test_rows_of_two_records_do_not_correlate():
    masks = [np.array([True, False, True]), np.ones(2, bool)]
    at = times(masks)
    assert at.tolist()[:2] == [0, 2]
    assert at[2] - at[1] > 3


def test_what_is_estimated_too_is_taken_out():
    g = np.random.default_rng(0)
    J, others = g.normal(size=(50, 2)), np.column_stack([g.normal(size=(50, 2)), np.zeros(50)])
    assert_allclose(others.T @ beyond(J, others), 0.0, atol=1e-12)


@pytest.mark.parametrize("name", ["AR(.95), u held 10", "AR(-.8), 30 % missing"])
def test_output_errors_are_as_sure_as_they_say_in_noise_of_any_colour(name):
    z, white = (np.sqrt(np.mean(one**2, axis=0)) for one in scores(CASES[name], 40))
    assert np.all((z > 0.75) & (z < 1.3)), z
    assert np.abs(np.log(white)).max() > 0.4, white


def test_the_validation_says_by_how_much_sigma_differs_from_that_for_white_residuals():
    fit = es.identify(es.OutputErrorML(2, 1, delay=1), drawn(CASES["AR(.8)"], 0))
    (check,) = (one for one in fit.validation.checks if one.name == "sigma")
    ratio = np.sqrt(np.diag(fit.covariance) / np.diag(fit.covariance_white))
    assert check.passed
    assert_allclose(check.value, ratio[np.argmax(np.abs(np.log(ratio)))])
    assert "times those for white residuals" in check.sentence


def test_white_residuals_leave_the_usual_covariance():
    fit = es.identify(es.OutputErrorML(2, 1, delay=1), drawn(CASES["white"], 2))
    assert_allclose(fit.covariance, fit.covariance_white, rtol=1e-9)
    assert "which are white" in " ".join(fit.validation.sentences)


@pytest.mark.parametrize(
    "method", [es.PredictionError(1, 0, 0), es.MarkovParameters(20), es.InstrumentalVariables(1, 0)]
)
def test_every_fit_by_prediction_errors_allows_for_the_colour(method):
    """A slow input under slow noise: the usual variance of the sum of the coefficients of u is several times too small."""
    g = np.random.default_rng(0)
    u, v = (lfilter([1], [1, -0.9], g.normal(size=1500)) for _ in range(2))
    fit = es.identify(method, es.Record(lfilter([0.5], [1, -0.5], u) + v, u, dt=1))
    if fit.covariance_white is not None:
        gain = np.array([not name.startswith("a") for name in fit.names], float)
        assert gain @ fit.covariance @ gain > 1.3 * gain @ fit.covariance_white @ gain
    assert np.all(np.linalg.eigvalsh(fit.covariance) > -1e-15)


def test_least_squares_says_that_its_sigma_is_not_of_the_plant():
    g = np.random.default_rng(0)
    u = g.normal(size=ROWS)
    y = lfilter([0, 1.0, 0.4], [1, -1.2, 0.5], u) + 0.3 * g.normal(size=ROWS)
    fit = es.identify(es.LeastSquares(2, 1, delay=1), es.Record(y, u, dt=1))
    (check,) = (one for one in fit.validation.checks if one.name == "whiteness")
    assert not check.passed
    assert "not of the plant. Use OutputErrorML" in check.sentence
