"""Held-out simulations: what explains, what is as good, and what ran away."""

import numpy as np
import pytest
from scipy.signal import lfilter

from estimable import LeastSquares, OutputErrorML, Record, compare
from estimable.identification import judge
from estimable.results import Ranked


def outputs(seed, rows=600, noise=0.5):
    rng = np.random.default_rng(seed)
    u = rng.normal(size=rows)
    x = lfilter([0, 0.3, 0.2], [1, -1.2, 0.5], u)
    return rng, x[:, None], (x + noise * np.std(x) * rng.normal(size=rows))[:, None]


def test_an_explosion_is_equal_to_nothing():
    """Its own size must not inflate the error bar of the comparison: in units of that it was within the noise."""
    for seed in range(20):
        _, x, y = outputs(seed)
        wild = y - x + np.exp(0.1 * np.arange(len(x)))[:, None]
        found = judge.behind(wild, y - x, y)
        assert found.t > 2.262 or found.ratio > 2
        assert judge.diverged(wild, y)
    overflow = np.where(np.arange(600)[:, None] > 300, np.inf, y - x)
    assert judge.fit_percent(overflow, y)[0] == -np.inf
    assert judge.behind(overflow, y - x, y).ratio == np.inf


def test_equal_simulations_are_alike_and_one_of_twice_the_error_is_not():
    alike, twice = 0, 0
    for seed in range(100):
        rng, x, y = outputs(seed)
        one, other = (
            (x + 0.1 * np.std(x) * lfilter([1], [1, -0.9], rng.normal(size=(len(x), 1)), axis=0)) for _ in "ab"
        )
        t, ratio = judge.behind(y - one, y - other, y)
        alike += t < 2.262 and ratio < 2
        t, ratio = judge.behind(2 * (y - x), y - x, y)
        twice += t < 2.262 and ratio < 2
    assert alike >= 90
    assert twice == 0


@pytest.mark.parametrize("held", [1, 25])
def test_a_model_of_something_else_explains_nothing(held):
    """Another input's response, fitted in size: accepted in at most 2 % of records of 600 rows, 7 % of six steps."""
    accepted = right = 0
    for seed in range(60):
        rng = np.random.default_rng(1000 + seed)
        u, v = (np.repeat(rng.normal(size=600 // held), held) for _ in "ab")
        x, other = (lfilter([0, 0.3, 0.2], [1, -1.2, 0.5], one) for one in (u, v))
        y = x + 0.5 * np.std(x) * rng.normal(size=600)
        g = (other[:300] @ y[:300]) / (other[:300] @ other[:300])
        accepted += judge.explained((y - g * other)[300:, None], y[300:, None])[0]
        right += judge.explained((y - x)[300:, None], y[300:, None])[0]
    assert accepted <= (2 if held == 1 else 6)
    assert right == 60


def test_a_short_manoeuvre_in_a_long_quiet_record_is_explained():
    u, rng = np.zeros(1200), np.random.default_rng(0)
    for k in (200, 900):
        u[k : k + 20], u[k + 20 : k + 34], u[k + 34 : k + 41] = 1, -1, 1
    y = lfilter([0, 0.3, 0.2], [1, -1.2, 0.5], u) + 0.05 * rng.normal(size=1200)
    assert compare([OutputErrorML(2, 1, delay=1), LeastSquares(2, 1, delay=1)], Record(y, u, dt=1)).best is not None


def test_missing_rows_count_for_nothing():
    _, x, y = outputs(3)
    gone = y.copy()
    gone[::3] = np.nan
    t, ratio = judge.behind(np.where(np.isnan(gone), 1e9, y - 1.5 * x), y - x, gone)
    kept = judge.behind(
        (y - 1.5 * x)[~np.isnan(gone[:, 0])], (y - x)[~np.isnan(gone[:, 0])], gone[~np.isnan(gone[:, 0])]
    )
    np.testing.assert_allclose(ratio, kept.ratio, rtol=1e-12)
    assert t > 2.262


def test_no_page_shows_a_number_that_nobody_can_read():
    wild = Ranked(OutputErrorML(1, 0), None, None, np.array([-5.7e15]), np.array([50.0]), 7.4e5, diverged=True)
    assert (wild.shown_fit, wild.shown_behind) == ("diverged", "> 1000")
    assert not wild.alike
