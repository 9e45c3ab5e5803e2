"""What the thesis prints, where it reproduces and where it does not."""

import numpy as np
import pytest

from estimable import Bounded, Prior, Smoothed, estimate
from estimable.plants import f16
from estimable.reproductions.sillence import window


@pytest.fixture
def table_4(results):
    return {row.quantity: row for row in results("sillence-table-4").rows}


@pytest.fixture
def table_5(results):
    return {row.quantity: row for row in results("sillence-table-5").rows}


@pytest.mark.parametrize(
    ("gain", "final", "settling"),
    [(0.8, 0.8388, 0.87), (0.6, 0.6447, 3.1), (0.4, 0.4283, 3.2), (0.2, 0.2072, 1.7), (0.1, 0.0995, 1.51)],
)
def test_the_expanding_filter_ends_where_an_independent_simulation_did(table_4, gain, final, settling):
    assert table_4[f"final gain, K1 = {gain}"].mean == pytest.approx(final, abs=5e-4)
    assert table_4[f"settling time, K1 = {gain}"].mean == pytest.approx(settling, abs=0.05)


def test_which_published_settling_times_reproduce(table_4):
    apart = {}
    for gain in (0.8, 0.6, 0.4, 0.2, 0.1):
        row = table_4[f"settling time, K1 = {gain}"]
        apart[gain] = abs(row.mean - row.published)
    assert [gain for gain, difference in apart.items() if difference > 0.15] == [0.6, 0.4]


def test_a_moving_elevator_that_the_filter_knows_of_changes_little(table_4):
    for gain in (0.8, 0.1):
        moving = table_4[f"final gain, K1 = {gain}, continuous actuator"]
        assert moving.published is None
        assert moving.mean == pytest.approx(table_4[f"final gain, K1 = {gain}"].mean, abs=5e-4)


@pytest.mark.parametrize("name", ["sillence-fig-11", "sillence-fig-12"])
def test_a_held_signal_lags_by_half_a_sample(name, results):
    held, lag = results(name).rows
    assert held.mean == pytest.approx(held.published, rel=0.02)
    assert lag.mean == pytest.approx(lag.published, rel=0.15)


@pytest.mark.parametrize(
    ("gain", "windowed", "smoothed"),
    [(0.8, 0.07, 0.11), (0.6, 0.13, 0.22), (0.4, 0.16, 0.30), (0.2, 0.195, 0.39), (0.1, 0.215, 0.47)],
)
def test_the_window_is_as_late_as_an_independent_simulation_found(table_5, gain, windowed, smoothed):
    assert table_5[f"within 20 %, window, K1 = {gain}"].mean == pytest.approx(windowed, abs=0.03)
    assert table_5[f"within 20 %, smoothed, K1 = {gain}"].mean == pytest.approx(smoothed, abs=0.03)


def test_change_detection_is_no_later_than_the_window(table_5):
    for gain in (0.6, 0.4, 0.2, 0.1):
        ours = table_5[f"within 20 % for good, change detection, K1 = {gain}"]
        assert ours.mean <= table_5[f"within 20 %, window, K1 = {gain}"].mean
        assert table_5[f"decision, change detection, K1 = {gain}"].mean <= 0.1


@pytest.mark.parametrize("bounded", [False, True])
def test_a_treated_window_is_what_the_wrappers_make_of_it(bounded):
    flight = f16.flight(0.2, seed=3, simulation="held_elevator")
    record, start = flight.record[:60], Prior([-1.4414, -2.4314], np.diag([0.1, 1.0]))
    inner = window.window()
    wrapped = Smoothed(Bounded(inner, 0.0, 1.0) if bounded else inner, 0.9)
    gains = estimate(inner, record, prior=start).gain[:, 0]
    treated = window.smoothed(0.9, bounded=bounded)(gains)
    np.testing.assert_allclose(treated, estimate(wrapped, record, prior=start).gain[:, 0], rtol=1e-12)


def test_the_windows_own_sigma_is_right(results):
    [inside] = results("sillence-fig-34").rows
    assert 85 < inside.mean < 99  # of 95
