"""The bound, and what is known of it: published figures, a dense Gaussian, no information."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import estimable as es
from estimable import AssumptionError, OutputError, Record, diagnostics
from estimable.frozen import replace

PLANT = OutputError([0.523, 0.349], [0.440, 0.762], noise_variance=0.1, dt=1)


@pytest.mark.parametrize(
    ("rows", "input_arrival", "output_arrival", "percent"),
    [
        (1000, 0.8, 0.7, 2.59),
        (1250, 0.4, 0.2, 6.3),
        (5000, 0.4, 0.2, 3.06),
    ],
)
def test_the_relative_bound_of_the_examples(rows, input_arrival, output_arrival, percent):
    rng = np.random.default_rng(1)
    told = []
    for _ in range(60):
        u = rng.uniform(-np.sqrt(3), np.sqrt(3), rows) * (rng.random(rows) < input_arrival)
        y = np.where(rng.random(rows) < output_arrival, 0.0, np.nan)
        told.append(diagnostics.information(PLANT, Record(y, u, dt=1)))
    bound = np.linalg.inv(np.mean(told, axis=0))
    assert_allclose(100 * np.sqrt(np.trace(bound)) / np.linalg.norm(PLANT.parameters), percent, rtol=0.04)


def test_it_is_the_curvature_of_the_likelihood():
    record = es.simulate(PLANT, np.random.default_rng(0).normal(size=60), seed=1).record
    h, M = 1e-4, np.zeros((4, 4))
    noise_free = replace(record, y=PLANT.response(record.u))
    for i in range(4):
        for j in range(4):
            M[i, j] = sum(
                s * t * deviance(PLANT.parameters + h * (s * np.eye(4)[i] + t * np.eye(4)[j]), noise_free)
                for s in (1, -1)
                for t in (1, -1)
            ) / (4 * h * h)
    assert_allclose(diagnostics.information(PLANT, record), M, rtol=1e-5, atol=1e-3)


def deviance(parameters, record):
    model = OutputError.of_parameters(parameters, na=2, nb=1, noise_variance=0.1, dt=1)
    return np.sum((record.y - model.response(record.u)) ** 2) / 0.1 / 2


def test_without_information_there_is_no_bound():
    with pytest.raises(AssumptionError, match="has no information about 4 directions of the 4 parameters"):
        diagnostics.cramer_rao(PLANT, Record(np.ones(5), np.zeros(5), dt=1))


def test_efficiency_is_one_for_errors_as_large_as_the_bound():
    rng, bound = np.random.default_rng(0), np.array([[2.0, 0.5], [0.5, 1.0]])
    error = rng.normal(size=(3000, 2)) @ np.linalg.cholesky(bound).T
    found = diagnostics.efficiency(error, np.broadcast_to(bound, (3000, 2, 2)))
    assert abs(found.ratio - 1) < 0.08
    assert abs(found.normalised - 1) < 0.08
    assert found.sentence.startswith("3000 runs")


def test_excitation_names_what_is_not_told_of():
    found = es.excitation(PLANT, Record(np.ones(3), np.ones(3), dt=1))
    assert not found.check.passed
    assert found.directions.shape[1] >= 1
    assert found.plot().data


def test_positive_realness_of_a_resonant_plant_fails():
    resonant = OutputError([-1.6, 0.9], [1.0], noise_variance=0.1, dt=1)
    ω = np.linspace(0, np.pi, 100_001)
    A = 1 - 1.6 * np.exp(-1j * ω) + 0.9 * np.exp(-2j * ω)
    assert_allclose(es.positive_real_margin(resonant), np.min((1 / A - 0.5).real), rtol=1e-5)
    assert es.positive_real_margin(PLANT)[0] > 0
