"""Least squares weighted for coloured noise: consistent where ordinary is biased, and as sure as it says."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimable import InputError, LeastSquares, MinimumVariance, OutputError, Record, identify

PLANT = OutputError([-1.2, 0.5], [1.0, 0.4], delay=1, noise_variance=0.25, dt=0.5)
DRAWS = 60


def drawn(seed, rows=400, noise=0.5, plant=PLANT):
    rng = np.random.default_rng(seed)
    u = rng.normal(size=(rows, plant.m))
    return Record(plant.response(u) + noise * rng.normal(size=(rows, plant.p)), u, dt=0.5)


def test_it_is_unbiased_and_its_covariance_is_that_of_its_errors():
    fits = [identify(MinimumVariance(2, 1, delay=1), drawn(seed)) for seed in range(DRAWS)]
    errors = np.array([fit.parameters - PLANT.parameters for fit in fits])
    claimed = np.mean([np.diag(fit.covariance) for fit in fits], axis=0)
    assert np.all(np.abs(errors.mean(axis=0)) < 4 * np.sqrt(claimed / DRAWS))
    assert np.all(np.abs(claimed / np.mean(errors**2, axis=0) - 1) < 4.5 * np.sqrt(2 / DRAWS))
    ordinary = identify(LeastSquares(2, 1, delay=1), drawn(0))
    assert np.abs((ordinary.parameters - PLANT.parameters) / ordinary.sigma).max() > 6


def test_without_noise_it_is_exact_with_several_channels_and_gaps():
    plant = OutputError(
        [[-0.7], [0.4]], [[[1.0, 0.3], [0.2, -0.5]], [[0.0, 1.0], [0.6, 0.1]]], noise_variance=0.0, dt=0.5
    )
    record = drawn(0, 80, 0.0, plant)
    y = record.y.copy()
    y[[5, 20, 21], 0] = np.nan
    fit = identify(MinimumVariance(1, 1), Record(y, record.u, dt=0.5))
    assert_allclose(fit.parameters, plant.parameters, atol=1e-9)
    assert fit.names == plant.parameter_names


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: MinimumVariance(1.5, 0), "`na` must be an integer of at least 0. Got 1.5."),
        (
            lambda: identify(MinimumVariance(1, 0), Record(np.ones(9), np.full(9, np.nan), dt=1)),
            "record 0: an input is unknown at index (0, 0)",
        ),
    ],
)
def test_what_is_wrong_is_said(call, sentence):
    with pytest.raises(InputError) as caught:
        call()
    assert sentence in str(caught.value)


def test_weights_that_do_not_settle_are_said(monkeypatch):
    monkeypatch.setattr("estimable.identifiers.minimum_variance.ROUNDS", 1)
    with pytest.raises(InputError, match="the weights do not converge"):
        identify(MinimumVariance(2, 1, delay=1), drawn(0))
