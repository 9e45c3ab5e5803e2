"""Identification from stamps that are multiples of no step: output-error models of continuous systems."""

import numpy as np
import pytest
from benchmarks.figures import stamps as figures
from numpy.testing import assert_allclose
from scipy.linalg import expm

import estimable as es
from estimable.frozen import replace
from estimable.kernels import output_error_response, response_at_stamps

A, B, D, DELAY = np.array([-1.2, 0.5]), np.array([[0.5, 0.3]]), 0.2, 1
RNG = np.random.default_rng(2)
U, STEPS = RNG.normal(size=(40, 1)), RNG.uniform(0.1, 3.0, 39)
ORDER = es.OutputErrorML(1, 0, delay=1)


def test_equal_steps_give_the_discrete_response():
    found = response_at_stamps.response(A, B, DELAY, U, np.ones(39), None)
    assert_allclose(found, output_error_response.response(A, B, DELAY, U), atol=1e-12)
    ψ = response_at_stamps.slopes(A, B, DELAY, U, np.ones(39), None)
    assert_allclose(ψ, output_error_response.slopes(A, B, DELAY, U, found), atol=1e-8)


@pytest.mark.parametrize("delay", [0, 1])
def test_other_steps_give_the_response_of_the_continuous_system(delay):
    """Against the matrix exponential of each interval; a direct term where there is no delay."""
    a, b, x = np.array([-1.2, 0.5]), B, np.array([0.4, -1.0])
    F, G, D, _ = response_at_stamps.companion(a, b, delay, 0.0)
    n = len(F)
    generator = np.real(_log(np.block([[F, G], [np.zeros((1, n)), np.eye(1)]])))
    z, y = x.copy(), []
    for k, u in enumerate(U[:, 0]):
        y.append(z[0] + D[0] * u)
        if k < len(STEPS):
            z = expm(generator * STEPS[k])[:n] @ np.append(z, u)
    assert_allclose(response_at_stamps.response(a, b, delay, U, STEPS, x), y, atol=1e-9)
    rest = response_at_stamps.response(a, b, delay, U, STEPS, None)
    assert_allclose(rest + response_at_stamps.free(a, b, delay, STEPS) @ x, y, atol=1e-9)


def _log(M):
    from scipy.linalg import logm

    return logm(M)


def test_a_damped_oscillation_at_random_stamps():
    for seed in range(3):
        record, truth = figures.second_order(seed)
        fit = es.identify(es.OutputErrorML(2, 1, delay=1), record)
        assert np.all(np.abs(fit.parameters - truth) < 4 * fit.sigma)
        (check,) = [one for one in fit.validation.checks if one.name == "stamps"]
        assert check.passed
        assert "fitted to them as they are" in check.sentence


def test_standard_deviations_hold_at_any_scatter():
    """12 draws (100 in the figure: 0.97 and 1.02): and on a grid the errors are three times as large."""
    for scatter in (0.08, 0.5):
        z = figures.errors(12, scatter, False, first=50)
        assert 0.6 < np.sqrt(np.mean(z**2)) < 1.5
    record = figures.drawn(0, 0.5)
    fits = [
        es.identify(ORDER, one) for one in (record, replace(record, t=figures.STEP * np.arange(len(record)), dt=0.1))
    ]
    assert 3 * fits[0].sigma[0] < fits[1].sigma[0]


def test_stamps_on_a_grid_are_used_where_their_scatter_shows():
    fit = es.identify(ORDER, figures.drawn(0, 0.08))
    assert [one.passed for one in fit.validation.checks if one.name == "stamps"] == [True]
    assert any("fitted to them as they are" in one.sentence for one in fit.validation.checks)
    little = es.identify(ORDER, figures.drawn(0, 1e-4))
    assert not any("fitted to them as they are" in one.sentence for one in little.validation.checks)


def test_breaks_missing_outputs_and_weights_at_stamps():
    record = figures.drawn(3, 0.4)
    rng = np.random.default_rng(1)
    y = np.where(rng.random((len(record), 1)) < 0.2, np.nan, record.y)
    sigma = np.full(y.shape, figures.NOISE)
    y[100:110] += 5.0 * rng.normal(size=(10, 1))
    sigma[100:110] = 5.0
    u = record.u.copy()
    u[300] = np.nan
    fit = es.identify(ORDER, es.Record(y, u, t=record.t, sigma=sigma, breaks=[500]))
    pole = np.exp(-fit.model.dt / figures.TIME)
    assert np.all(np.abs(fit.parameters - [-pole, figures.GAIN * (1 - pole)]) < 4 * fit.sigma)
    assert np.all(fit.sigma < 0.01)


@pytest.mark.parametrize(("method", "sentence"), [
    (es.RecursiveOutputError(1, 0, delay=1, noise_variance=1.0), "OutputErrorML can be fitted to the stamps themselves."),
    (es.Subspace(1), "OutputErrorML can be fitted to the stamps themselves."),
    (es.OutputErrorML(1, 1, delay=1), "`nb` + `delay` must be at most na = 1: no continuous system responds otherwise. Got 2."),
])  # fmt: skip
def test_what_cannot_be_fitted_to_stamps_is_refused(method, sentence):
    with pytest.raises(es.InputError) as raised:
        es.identify(method, figures.drawn(0, 0.5))
    assert sentence in str(raised.value)


def test_inputs_that_move_between_stamps_are_refused():
    with pytest.raises(es.InputError, match="the input must be constant between them"):
        es.identify(es.OutputErrorML(1, 0, delay=1), replace(figures.drawn(0, 0.5), hold="first_order"))
