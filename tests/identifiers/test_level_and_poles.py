"""Levels, trends and starts away from rest; integrators, and poles at their bounds."""

import numpy as np
import pytest
from benchmarks.figures.level_and_integrators import about_a_level, gains, integrated, integrator
from numpy.testing import assert_allclose
from scipy.signal import lfilter

import estimable as es
from estimable.kernels.levenberg_marquardt import search, within


def stability(fit):
    (check,) = (one for one in fit.validation.checks if one.name == "stability")
    return check


def test_the_static_gain_is_right_from_any_start_and_level():
    errors, z = gains(10, 400)
    assert np.median(errors) < 0.007
    assert np.sqrt(np.mean(z**2)) < 1.3
    wrong, _ = gains(1, 400, level="none", initial="rest")
    assert wrong.min() > 0.05


def test_a_trend_is_fitted_and_its_slope_given_per_second():
    errors, z = gains(4, 400, 0.02, level="trend")
    assert np.median(errors) < 0.01
    assert np.abs(z).max() < 4
    record = about_a_level(0, 400, 0.02)
    fit = es.identify(es.OutputErrorML(2, 1, delay=1, level="trend"), es.Record(record.y, record.u, dt=0.5))
    slope, sigma = fit.extra["slope"][0]
    assert abs(slope - 0.04) < 4 * sigma
    assert_allclose(fit.model.level, 5 + 0.02 * 399, atol=1.5)


def test_the_level_is_that_of_the_model_in_absolute_units():
    record = about_a_level(3, 400)
    fit = es.identify(es.OutputErrorML(2, 1, delay=1), record)
    level, sigma = fit.extra["level"][0]
    assert abs(level - 5) < 4 * sigma
    assert_allclose(fit.model.level, [level])
    assert_allclose(fit.model.to_state_space().operating_point.outputs, [level])
    steady = fit.model.response(np.full((400, 1), 20.0))[-1, 0]
    assert abs(steady - 55) < 0.5


def test_inputs_of_unknown_arrival_have_a_level_too():
    g = np.random.default_rng(0)
    u, came = g.normal(size=500), g.random(500) < 0.7
    y = 4 + lfilter([1.0], [1, -0.5], u * came) + 0.1 * g.normal(size=500)
    fit = es.identify(es.OutputErrorML(1, 0, arrival=0.7), es.Record(y, u, dt=1, arrived=np.full((500, 1), np.nan)))
    assert np.all(np.abs(fit.parameters - [-0.5, 1.0]) < 4 * fit.sigma)
    assert abs(fit.extra["level"][0, 0] - 4) < 4 * fit.extra["level"][0, 1]


def test_an_integrator_is_found_and_its_gain_is_right():
    found = integrated(6, 1000)
    assert np.mean(found[:, 0] == 1) > 0.6
    assert np.sqrt(np.mean(found[:, 1] ** 2)) < 3e-4
    fit = es.identify(es.OutputErrorML(1, 0, delay=1), integrator(0, 1000))
    assert stability(fit).passed
    assert "y1 integrates: its largest pole is" in stability(fit).sentence
    assert fit.sigma[0] == 0
    assert fit.undetermined is None


def test_a_slow_pole_is_no_integrator():
    found = integrated(4, 1000, 0.995)
    assert_allclose(found[:, 0], 0.995, atol=2e-3)


@pytest.mark.parametrize("root", [1.01, -1.01])
def test_an_unstable_plant_fails_with_its_pole(root):
    g = np.random.default_rng(0)
    u = g.normal(size=300)
    y = lfilter([0, 1.0], [1, -root], u) + 0.1 * g.normal(size=300)
    fit = es.identify(es.OutputErrorML(1, 0, delay=1), es.Record(y, u, dt=1))
    assert not stability(fit).passed
    assert "a pole of y1 is at its bound 0.999" in stability(fit).sentence
    assert np.abs(fit.model.poles[0]).max() <= 0.999 + 1e-9


def test_poles_are_mirrored_and_cut():
    assert_allclose(np.abs(np.roots(np.append(1, within(np.array([-2.6, 1.2]), 0.999)))), [0.6, 0.5], rtol=1e-9)
    assert_allclose(within(np.array([1.0]), 0.999), [0.999])
    inner = np.array([-1.2, 0.5])
    assert within(inner, 0.999) is inner


def test_the_search_finds_the_minimum_and_says_so():
    """Rosenbrock's valley; its residuals are linear in the second unknown."""
    found = search(
        lambda x: np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]]), lambda x: np.array([[-20 * x[0], 10.0], [-1.0, 0.0]]),
        np.array([-1.2, 1.0]), lambda x: x,
    )  # fmt: skip
    assert found.converged
    assert_allclose(found.x, 1.0, atol=1e-10)
    bounded = search(lambda x: x - 3.0, lambda x: np.eye(1), np.zeros(1), lambda x: np.minimum(x, 2.0))
    assert_allclose(bounded.x, 2.0, atol=1e-6)


@pytest.mark.parametrize("method", [es.Subspace(2, weighting="n4sid"), es.HoKalman(2)])
def test_one_sinusoid_does_not_determine_two_states(method):
    u = 5 * np.sin(0.3 * np.arange(400))
    y = lfilter([0, 1.0], [1, 0.8, 0.5], u) + 0.05 * np.random.default_rng(0).normal(size=400)
    fit = es.identify(method, es.Record(y, u, dt=1))
    (check,) = (one for one in fit.validation.checks if one.name == "excitation")
    assert not check.passed
    assert "the input has 2 frequencies" in check.sentence
    assert np.all(np.isinf(fit.sigma))
    assert np.isnan(es.diagnostics.step_response(fit).sigma).all()


def test_the_predictor_of_a_plant_without_process_noise_is_stable_and_says_so():
    A = np.array([1, -2 * 0.97 * np.cos(0.22), 0.97**2])
    edges = 0
    for seed in range(5):
        g = np.random.default_rng(seed)
        u = g.normal(size=400)
        y = lfilter([0, 0.1, 0.05], A, u) + 0.05 * g.normal(size=400)
        fit = es.identify(es.PredictionError(2, 1, 2, delay=1), es.Record(y, u, dt=1))
        largest = np.abs(np.roots(np.append(1, fit.parameters[4:]))).max()
        edge = "invertibility" in {one.name for one in fit.validation.checks if not one.passed}
        assert largest <= 0.999 + 1e-9
        assert edge == (largest > 0.9989) == bool(np.isinf(fit.sigma[4:]).all())
        assert np.isfinite(fit.sigma[:4]).all()
        edges += edge
    assert 0 < edges < 5


def test_a_comparison_finds_the_integrator_about_a_level():
    """Its levels are not subtracted first: the mean of the input would leave a ramp."""
    found = es.compare([es.OutputErrorML(1, 0, delay=1), es.LeastSquares(1, 0, delay=1)], integrator(0, 1000))
    assert found.best.name == "OutputErrorML"
    assert found.best.fit_percent > 90
