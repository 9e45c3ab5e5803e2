"""Instrumental variables and prediction errors: consistent, as sure as they say, exact derivatives, gaps, sentences."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.signal import lfilter

from estimable import (
    ARMAX,
    InputError,
    InstrumentalVariables,
    LeastSquares,
    OutputError,
    PredictionError,
    Record,
    identify,
    load,
    save,
)
from estimable.identifiers.one_output import marginal
from estimable.identifiers.output_error_ml import by_output

DRAWS = 60
STILL = OutputError([-1.2, 0.5], [1.0, 0.4], delay=1, noise_variance=0.25, dt=0.5)
MOVING = ARMAX([-1.2, 0.5], [1.0, 0.4], [0.6], delay=1, noise_variance=0.25, dt=0.5)


def coloured(seed, rows=600):
    """Output noise with a slow pole, of which nobody knows."""
    rng = np.random.default_rng(seed)
    u = rng.normal(size=rows)
    return Record(STILL.response(u)[:, 0] + lfilter([0.5], [1, -0.8], rng.normal(size=rows)), u, dt=0.5)


def armax(seed, rows=400):
    rng = np.random.default_rng(seed)
    u, e = rng.normal(size=rows), 0.5 * rng.normal(size=rows)
    B, A = [0.0, 1.0, 0.4], [1.0, -1.2, 0.5]
    return Record(lfilter(B, A, u) + lfilter([1.0, 0.6], A, e), u, dt=0.5)


def within(errors, claimed):
    ratio = np.mean(claimed, axis=0) / np.mean(np.square(errors), axis=0)
    assert np.all(np.abs(ratio - 1) < 4.5 * np.sqrt(2 / len(errors))), ratio
    assert np.all(np.abs(np.mean(errors, axis=0)) < 4 * np.sqrt(np.mean(claimed, axis=0) / len(errors)))


def test_instruments_are_unbiased_and_as_sure_as_they_say_in_noise_of_any_colour():
    method, errors, claimed = InstrumentalVariables(2, 1, delay=1), [], []
    for seed in range(DRAWS):
        record = [coloured(seed)]
        found = method.parameters(record, method.ordinary.complete_rows(record))[0]
        errors.append(found.θ - STILL.parameters)
        claimed.append(np.diag(found.covariance))
    within(errors, claimed)
    least = identify(LeastSquares(2, 1, delay=1), coloured(0))
    assert np.abs((least.parameters - STILL.parameters) / least.sigma).max() > 4.5


def test_instruments_are_exact_without_noise_with_gaps_levels_and_several_records():
    plant = OutputError(
        [[-0.7], [0.4]], [[[1.0, 0.3], [0.2, -0.5]], [[0.0, 1.0], [0.6, 0.1]]], noise_variance=0.0, dt=0.5
    )
    records = []
    for seed in (0, 1):
        u = np.random.default_rng(seed).normal(size=(80, 2))
        y = plant.response(u) + [3.0, -2.0]
        y[[5, 20, 21], 0] = np.nan
        records.append(Record(y, u, dt=0.5))
    fit = identify(InstrumentalVariables(1, 1, offset=True), records)
    wanted = np.column_stack([plant.parameters.reshape(2, -1), [3.0 * 0.3, -2.0 * 1.4]]).ravel()
    assert_allclose(fit.parameters, wanted, atol=1e-7)
    assert fit.names[5] == "c_y1"


def test_prediction_errors_are_unbiased_and_as_sure_as_they_say():
    method, errors, claimed = PredictionError(2, 1, 1, delay=1), [], []
    for seed in range(DRAWS):
        end = method.search(by_output([armax(seed)])[0])
        r = 2 * end.cost / (len(end.e) - len(end.x))
        errors.append(end.x[:5] - MOVING.parameters)
        claimed.append(np.diag(np.linalg.inv(marginal(end.J.T @ end.J / r, 5))))
    within(errors, claimed)


def test_the_derivatives_of_prediction_errors_are_those_of_differences():
    method, data = PredictionError(2, 1, 1, delay=1), by_output([armax(0, 50)])[0]
    x = np.array([-1.1, 0.4, 0.9, 0.5, 0.3, 0.1, 0.2])
    moved = [[method._errors(data, x + side * 1e-6 * unit) for side in (1, -1)] for unit in np.eye(7)]
    assert_allclose(method._slopes(data, x).T, [(up - down) / 2e-6 for up, down in moved], atol=1e-7)


def test_gaps_are_filtered_over_and_the_rest_counts_as_the_dense_gaussian_says():
    """The likelihood of what was seen, from the joint covariance of a short record."""
    record = armax(3, 60)
    y = record.y.copy()
    y[[7, 8, 20, 41, 42, 43]] = np.nan
    fit = identify(PredictionError(2, 1, 1, delay=1), Record(y, record.u, dt=0.5))
    a, b, c = np.append(1, fit.model.a[0]), np.concatenate([[0.0], fit.model.b[0, 0]]), np.append(1, fit.model.c[0])
    seen = ~np.isnan(y[:, 0])
    H = np.stack([lfilter(c, a, unit) for unit in np.eye(60)], axis=1)[seen]
    Z = np.stack([lfilter([1.0], a, unit) for unit in np.eye(60)[:2]], axis=1)[seen]
    left = y[seen, 0] - lfilter(b, a, record.u[:, 0])[seen]
    L = np.linalg.cholesky(H @ H.T)
    e = np.linalg.solve(L, left)
    Φ = np.linalg.solve(L, Z)
    e = e - Φ @ np.linalg.lstsq(Φ, e, rcond=None)[0]
    N, V = seen.sum(), 2 * np.log(np.diag(L)).sum()
    wanted = -0.5 * (N * (np.log(2 * np.pi * (e @ e) / N) + 1) + V)
    assert_allclose(fit.log_likelihood, wanted, rtol=1e-6)


def test_a_fit_goes_into_a_file_and_into_a_filter(tmp_path):
    fit = identify(PredictionError(2, 1, 1, delay=1), armax(0))
    save(tmp_path / "fit.npz", fit)
    again = load(tmp_path / "fit.npz").model
    assert again.parameters.tolist() == fit.model.parameters.tolist()
    assert again.parameter_names == ("a1", "a2", "b0", "b1", "c1")
    assert fit.validation.passed, fit.validation.sentences
    assert_allclose(fit.model.with_parameters(MOVING.parameters).c, [[0.6]])


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: InstrumentalVariables(-1, 0), "`na` must be an integer of at least 0. Got -1."),
        (lambda: PredictionError(1, 0, 0.5), "`nc` must be an integer of at least 0. Got 0.5."),
        (
            lambda: identify(PredictionError(1, 0, 1), Record([1.0, 2.0], [1.0, 0.0], dt=1)),
            "output y1 was seen 2 times: 5 are needed for 3 parameters and the past before row 0. Lower the orders.",
        ),
        (
            lambda: identify(InstrumentalVariables(1, 0), Record(np.ones(9), np.full(9, np.nan), dt=1)),
            "record 0: an input is unknown at index (0, 0)",
        ),
        (lambda: ARMAX([0.5], [1.0], [[1.0], [2.0]], noise_variance=1.0, dt=1), "`c` must be (p, nc)"),
    ],
)
def test_what_is_wrong_is_said(call, sentence):
    with pytest.raises(InputError) as caught:
        call()
    assert sentence in str(caught.value)
