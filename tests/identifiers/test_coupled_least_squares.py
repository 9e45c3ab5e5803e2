"""ARX with full matrices, and OKID on it: exact without noise, as sure as they say, gaps, levels, sentences."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimable import CoupledLeastSquares, InputError, LeastSquares, MarkovParameters, Record, identify
from estimable.identifiers.coupled_least_squares import _covariance, _noise

A1, B1 = np.array([[-0.7, 0.2], [0.1, -0.5]]), np.array([[1.0, 0.2], [0.5, -1.0]])
TRUE = np.column_stack([A1, B1]).ravel()
SHARED = np.array([[0.2, 0.1], [0.1, 0.3]])


def drawn(seed, rows=300, noise=SHARED, level=0.0):
    rng = np.random.default_rng(seed)
    u, y, L = rng.normal(size=(rows, 2)), np.zeros((rows, 2)), np.linalg.cholesky(noise + 1e-300 * np.eye(2))
    for k in range(1, rows):
        y[k] = -A1 @ y[k - 1] + B1 @ u[k - 1] + L @ rng.normal(size=2)
    return Record(y + level, u, dt=1)


def test_without_noise_it_is_exact_with_gaps_levels_and_several_records():
    records = [drawn(seed, 40, 0 * SHARED, level=[3.0, -1.0]) for seed in (0, 1)]
    y = records[0].y.copy()
    y[7, 0], y[12, 1] = np.nan, np.nan
    fit = identify(CoupledLeastSquares(1, 0, delay=1, offset=True), [Record(y, records[0].u, dt=1), records[1]])
    θ = np.reshape(fit.parameters, (2, 5))
    assert_allclose(θ[:, :4].ravel(), TRUE, atol=1e-9)
    assert_allclose(fit.model.operating_point.outputs, [3.0, -1.0], atol=1e-9)
    assert fit.names[:5] == ("a1_y1_y1", "a1_y1_y2", "b0_y1_u1", "b0_y1_u2", "c_y1")
    assert_allclose(fit.validation.fit, 100, atol=1e-5)


def test_its_covariance_is_that_of_its_errors_across_outputs_too():
    method, errors, claimed = CoupledLeastSquares(1, 0, delay=1), [], []
    for seed in range(150):
        record = drawn(seed)
        rows = method._rows([record])
        found = method._regressions(rows, record)
        θ = np.stack([one.θ for one in found])
        errors.append(θ.ravel() - TRUE)
        claimed.append(_covariance(rows, found, _noise(rows, θ)))
    Σ, empirical = np.mean(claimed, axis=0), np.cov(np.transpose(errors))
    assert_allclose(np.diag(Σ) / np.diag(empirical), 1, atol=4 * np.sqrt(2 / 150))
    scale = np.sqrt(np.diag(Σ))
    assert_allclose(Σ / np.outer(scale, scale), empirical / np.outer(scale, scale), atol=4 / np.sqrt(150))


def test_of_one_output_it_is_ordinary_least_squares():
    record = drawn(0)
    one = Record(record.y[:, :1], record.u, dt=1)
    coupled, ordinary = (identify(method, one) for method in (CoupledLeastSquares(2, 1), LeastSquares(2, 1)))
    assert_allclose(coupled.parameters, ordinary.parameters, rtol=1e-9)
    assert_allclose(coupled.covariance, ordinary.covariance_white, rtol=1e-9)
    assert_allclose(coupled.validation.one_step_fit, ordinary.validation.one_step_fit, rtol=1e-6)


def test_okid_is_exact_without_noise_and_needs_no_response_that_dies_out():
    record = drawn(0, 60, 0 * SHARED)
    fit = identify(MarkovParameters(8, weighting="observer", observer=1), record)
    assert_allclose(fit.parameters, _wanted(8), atol=1e-8)


def _wanted(length):
    """M_0 = 0, M_1 = B, M_2 = -A B, .."""
    M = [np.zeros((2, 2)), B1]
    for _ in range(length - 1):
        M.append(-A1 @ M[-1])
    return np.stack(M).transpose(1, 2, 0).ravel()


def test_the_covariance_of_okid_is_that_of_its_errors():
    method = MarkovParameters(3, weighting="observer", observer=1)
    fits = [method.fit([drawn(seed, 200)]) for seed in range(60)]
    ratio = np.mean([np.diag(fit.covariance) for fit in fits], axis=0) / np.mean(
        np.square([fit.parameters - _wanted(3) for fit in fits]), axis=0
    )
    assert np.all(np.abs(ratio - 1) < 4.5 * np.sqrt(2 / 60)), ratio


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: CoupledLeastSquares(1, -1), "`nb` must be an integer of at least 0. Got -1."),
        (
            lambda: identify(CoupledLeastSquares(1, 0), Record(np.full((9, 1), np.nan), np.ones(9), dt=1)),
            "output y1 has no equation without missing values: it needs 2 rows without a gap in any output and input.",
        ),
        (lambda: MarkovParameters(4, observer=2), '`observer` belongs to weighting = "observer".'),
        (
            lambda: MarkovParameters(4, weighting="observer", observer=0),
            "`observer` must be an integer of at least 1. Got 0.",
        ),
    ],
)
def test_what_is_wrong_is_said(call, sentence):
    with pytest.raises(InputError) as caught:
        call()
    assert sentence in str(caught.value)
