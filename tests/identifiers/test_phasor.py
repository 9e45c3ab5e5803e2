"""Sinusoids: exact without noise, in closed form, as sure as it says, from several records with gaps."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimable import InputError, OutputError, Phasor, Record, StateSpace, identify, load, save
from estimable.kernels import phasors as kernel

PLANT = OutputError([-1.2, 0.5], [1.0, 0.4], delay=1, noise_variance=0.04, dt=0.1)
T = 0.1 * np.arange(400)
FREQUENCIES = [0.3, 0.9, 2.1]


def sines(*frequencies):
    return sum(np.sin(2 * np.pi * f * T) for f in frequencies)


def record_of(u, noise=0.0, seed=0):
    rng = np.random.default_rng(seed)
    return Record(PLANT.response(u) + noise * rng.normal(size=(len(u), 1)) + 3.0, u, dt=0.1)


@pytest.mark.parametrize(("ζ", "ω_n"), [(0.3, 2.0), (1.4, 0.5), (0.05, 9.0)])
def test_a_second_order_lag_comes_back_in_closed_form(ζ, ω_n):
    ω = 3.1
    H = ω_n**2 / (-(ω**2) + 2j * ζ * ω_n * ω + ω_n**2)
    found = Phasor.second_order(H.real, H.imag, ω / (2 * np.pi))
    assert_allclose(found, [ω_n / (2 * np.pi), ζ], rtol=1e-10)


def test_the_equations_are_those_of_sillence():
    """(14), written out for n = 3, with his signs of a."""
    rng = np.random.default_rng(0)
    a, b, ω = rng.normal(size=3), rng.normal(size=3), np.array([0.7, 1.3, 2.9])
    s = 1j * ω
    H = (b[0] * s**2 + b[1] * s + b[2]) / (s**3 - a[0] * s**2 - a[1] * s - a[2])
    A, B = H.real, H.imag
    assert_allclose(-B, A * (a[0] / ω - a[2] / ω**3) + B * a[1] / ω**2 + b[0] / ω - b[2] / ω**3, atol=1e-12)
    assert_allclose(A, B * (a[0] / ω - a[2] / ω**3) - A * a[1] / ω**2 - b[1] / ω**2, atol=1e-12)
    found = kernel.coefficients(H, np.eye(6), 1 / s, 3)
    assert_allclose(found.θ, [*-a, *b], rtol=1e-8)


def test_without_noise_it_is_exact_with_gaps_a_level_and_several_records():
    records = [record_of(sines(0.3)), record_of(sines(0.9, 2.1))]
    y = records[0].y.copy()
    y[50:90] = np.nan
    fit = identify(Phasor(2, FREQUENCIES, settle=15), [Record(y, records[0].u, dt=0.1), records[1]])
    assert_allclose(fit.parameters, PLANT.parameters, atol=1e-5)
    assert fit.extra["frequencies"].round(9).tolist() == FREQUENCIES
    assert_allclose(fit.extra["coherence"], 1, atol=1e-6)


def test_a_continuous_plant_comes_back_whatever_moves_between_the_samples():
    ω, ζ = 2.0, 0.3
    model = StateSpace(
        [[-2 * ζ * ω, 1], [-(ω**2), 0]], [[0.0], [ω**2]], [[1.0, 0.0]], Q=np.zeros((2, 2)), R=[[0.0]], dt=0
    )
    fine = model.discretise(0.1, hold="first_order")
    u, x, y = sines(0.2, 0.4), np.zeros(2), []
    for now, end in zip(u, [*u[1:], 0.0], strict=True):
        y.append(x[0])
        x = fine.A @ x + fine.B[:, 0] * now + fine.B_end[:, 0] * end
    record = Record(y, u, dt=0.1, hold="first_order")
    fit = identify(Phasor(2, [0.2, 0.4], settle=20, domain="continuous"), record)
    assert_allclose(fit.parameters, [2 * ζ * ω, ω**2, 0, ω**2], atol=0.03)
    assert fit.model.is_continuous
    assert fit.names == ("a1", "a2", "b1", "b2")
    assert fit.validation.fit[0] > 98


def test_its_covariance_is_that_of_its_errors():
    method, u = Phasor(2, FREQUENCIES, settle=10), sines(*FREQUENCIES)
    errors, claimed = [], []
    for seed in range(200):
        seen = method._seen([record_of(u, 0.2, seed)], 0, 0.1)
        found = kernel.coefficients(seen.H, seen.covariance, np.exp(-1j * seen.ω * 0.1), 2)
        errors.append(found.θ - PLANT.parameters)
        claimed.append(np.diag(found.covariance))
    ratio = np.mean(claimed, axis=0) / np.var(errors, axis=0)
    assert np.all(np.abs(ratio - 1) < 4 * np.sqrt(2 / 200)), ratio


def test_a_transient_lowers_the_coherence_and_is_said(tmp_path):
    noisy = record_of(sines(*FREQUENCIES), 4.0)
    fit = identify(Phasor(2, FREQUENCIES), noisy)
    [said] = [check for check in fit.validation.checks if check.name == "coherence"]
    assert not said.passed
    assert "the rest is noise, a transient" in said.sentence
    save(tmp_path / "fit.npz", fit)
    assert load(tmp_path / "fit.npz").extra["quadrature"].tolist() == fit.extra["quadrature"].tolist()


GOOD = record_of(sines(0.3))


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: Phasor(0, [1.0]), "`order` must be an integer of at least 1. Got 0."),
        (lambda: Phasor(1, [0.0]), "`frequencies` must be greater than 0 hertz."),
        (lambda: Phasor(1, [1.0, 1.0]), "`frequencies` must differ from each other."),
        (lambda: Phasor(1, [1.0], domain="z"), "`domain` must be one of 'discrete', 'continuous'. Got 'z'."),
        (lambda: Phasor(1, [1.0], settle=-1), "`settle` must be at least 0 seconds. Got -1."),
        (lambda: identify(Phasor(1, [5.0]), GOOD), "`frequencies` must be below half the sampling rate, 5 Hz."),
        (
            lambda: identify(Phasor(1, [0.3], settle=40), GOOD),
            "record 0 has 0 rows after 40 s, but 4 are needed. Lower `settle`.",
        ),
        (lambda: identify(Phasor(2, [0.3]), GOOD), "order 2 needs 2 frequencies in the input. Got 1"),
        (lambda: identify(Phasor(1, [0.3]), Record(T, np.stack([T, T], axis=1), dt=0.1)), "Phasor takes one input"),
        (
            lambda: Phasor.second_order(0.5, 0.1, 1.0),
            "no stable second-order lag with unit gain has the response 0.5 +0.1j",
        ),
    ],
)
def test_what_is_wrong_is_said(call, sentence):
    with pytest.raises(InputError) as caught:
        call()
    assert sentence in str(caught.value)
