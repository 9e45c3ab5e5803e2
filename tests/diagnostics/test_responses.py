"""Poles, zeros and responses of fits, and how sure they are: against a textbook, and against many draws."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimable import ARX, HoKalman, LeastSquares, OutputError, Record, diagnostics, identify
from estimable.frozen import replace
from estimable.kernels import tangents
from estimable.kernels.regression import regress
from estimable.results import Fit

PLANT = ARX([-1.2, 0.5], [1.0, 0.4], delay=1, noise_variance=0.04, dt=0.5)
DRAWS = 120


def drawn(rng, rows=400):
    u, y, e = rng.normal(size=rows), np.zeros(rows), 0.2 * rng.normal(size=rows)
    for k in range(2, rows):
        y[k] = 1.2 * y[k - 1] - 0.5 * y[k - 2] + u[k - 1] + 0.4 * u[k - 2] + e[k]
    return Record(y, u, dt=0.5)


def quick(record):
    """The fit without its validation."""
    rows = LeastSquares(2, 1, delay=1).rows([record], 0)
    found = regress(rows.Φ, rows.y)
    model = PLANT.with_parameters(found.θ)
    return Fit(model, found.θ, found.variance * found.inverse, model.parameter_names)


@pytest.fixture(scope="module")
def fits():
    rng = np.random.default_rng(0)
    return [quick(drawn(rng)) for _ in range(DRAWS)]


def within(drawn, claimed):
    """Whether standard deviations agree, to 4 standard errors of theirs."""
    ratio = np.std(drawn, axis=0) / np.mean(claimed, axis=0)
    assert np.all(np.abs(ratio - 1) < 4 / np.sqrt(2 * DRAWS)), ratio


def test_sigmas_are_those_of_many_draws(fits):
    few = fits[:20]
    steps = [diagnostics.step_response(fit, 12) for fit in fits]
    within([one.values.ravel()[1:] for one in steps], [one.sigma.ravel()[1:] for one in steps[:20]])
    found = [diagnostics.frequency_response(fit, [0.05, 0.2, 0.7]) for fit in fits]
    within([np.log(np.abs(one.values.ravel())) for one in found], [one.log_modulus_sigma.ravel() for one in found[:20]])
    within([np.angle(one.values.ravel()) for one in found], [one.phase_sigma.ravel() for one in found[:20]])
    upper = [max(diagnostics.poles(fit).values, key=lambda z: z.imag) for fit in fits]
    roots = [diagnostics.poles(fit) for fit in few]
    sigma = [np.sqrt(np.diag(one.covariance[np.argmax(one.values.imag)])) for one in roots]
    within([[z.real, z.imag] for z in upper], sigma)
    zeros = [diagnostics.zeros(fit) for fit in few]
    within([diagnostics.zeros(fit).values.real for fit in fits], [np.sqrt(one.covariance[:, 0, 0]) for one in zeros])


def test_values_are_those_of_the_polynomials():
    record = drawn(np.random.default_rng(1))
    fit = quick(record)
    a, b = np.append(1, fit.model.a[0]), fit.model.b[0, 0]
    z = np.exp(2j * np.pi * 0.5 * np.array([0.1, 0.8]))
    wanted = np.polyval(b, z) * z**-2 / (np.polyval(a, z) * z**-2)
    G = diagnostics.frequency_response(fit, [0.1, 0.8]).values.ravel()
    assert_allclose(G, wanted, rtol=1e-10)  # one sample of delay is among the two of the second-degree denominator
    assert_allclose(np.sort_complex(diagnostics.poles(fit).values), np.sort_complex(np.roots(a)), atol=1e-9)
    assert_allclose(diagnostics.zeros(fit).values.real, np.roots(b), atol=1e-9)


def test_a_realised_model_has_the_same_bands_as_its_markov_parameters():
    record = drawn(np.random.default_rng(2))
    fit = identify(HoKalman(2, length=16), record)
    found = diagnostics.step_response(fit, 4)
    Σ = np.asarray(fit.covariance)
    sums = np.tril(np.ones((5, 5)))
    assert_allclose(found.values.ravel(), sums @ fit.parameters, rtol=1e-9)
    assert_allclose(found.sigma.ravel(), np.sqrt(np.diag(sums @ Σ @ sums.T)), rtol=1e-6)


def test_what_is_not_known_has_no_band():
    fit = identify(LeastSquares(1, 1), Record(np.random.default_rng(0).normal(size=40), np.ones(40), dt=1))
    assert fit.undetermined.shape[1] == 1
    assert np.isnan(diagnostics.step_response(fit, 5).sigma).all()
    assert np.isnan(diagnostics.poles(fit).covariance).all()
    assert np.isinf(fit.sigma).tolist() == [False, True, True]
    assert "b0 = not known" in repr(fit)


def test_poles_of_a_delay_and_zeros_of_hidden_states_are_left_out():
    plant = OutputError([[-0.5], [0.3]], [[[1.0, 0.4]], [[2.0, 0.0]]], delay=2, noise_variance=0.1, dt=1)
    fit = Fit(plant, plant.parameters, 0.01 * np.eye(6), plant.parameter_names)
    assert_allclose(np.sort(diagnostics.poles(fit).values.real), [-0.3, 0.5], atol=1e-9)
    assert_allclose(diagnostics.zeros(fit, 0, 0).values, [-0.4], atol=1e-7)


def test_states_are_turned_to_those_of_another_realisation():
    rng = np.random.default_rng(0)
    base = tangents.Dynamics(*(np.asarray(getattr(PLANT.to_state_space(), name)) for name in "ABCD"))
    T = rng.normal(size=base.A.shape)
    turned = tangents.Dynamics(np.linalg.solve(T, base.A @ T), np.linalg.solve(T, base.B), base.C @ T, base.D)
    for found, wanted in zip(tangents.aligned(turned, base), base, strict=True):
        assert_allclose(found, wanted, atol=1e-9)


def test_parameters_come_back():
    for plant in (PLANT, replace(PLANT, offset=[2.0])):
        assert_allclose(plant.with_parameters(2 * plant.parameters).parameters, 2 * plant.parameters)
