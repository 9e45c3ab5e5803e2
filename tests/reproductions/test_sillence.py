"""What the thesis prints, where it reproduces and where it does not."""

import pytest

from estimable import reproductions


@pytest.fixture(scope="module")
def table_4():
    return {row.quantity: row for row in reproductions.reproduce("sillence-table-4", draws=4).rows}


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
def test_a_held_signal_lags_by_half_a_sample(name):
    held, lag = reproductions.reproduce(name).rows
    assert held.mean == pytest.approx(held.published, rel=0.02)
    assert lag.mean == pytest.approx(lag.published, rel=0.15)
