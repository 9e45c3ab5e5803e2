"""Levels and drifts: what is taken away is said, and missing samples do not move it."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimable import InputError, Record, Trend

k = np.arange(30.0)
RECORD = Record(np.stack([2 + 0.5 * k, 3 - k], axis=1), 1 + 0 * k, dt=0.1, arrived=np.ones(30))


def test_lines_are_found_and_taken_away_whatever_is_missing():
    y = RECORD.y.copy()
    y[3:9, 0], y[20, 1] = np.nan, np.nan
    record = Record(y, RECORD.u, dt=0.1)
    trend = Trend.of(record, 1)
    assert_allclose(trend.outputs, [[2, 3], [0.5, -1]], atol=1e-9)
    left = trend.taken_from(record)
    assert_allclose(left.y[~np.isnan(y)], 0, atol=1e-9)
    assert np.array_equal(np.isnan(left.y), np.isnan(y))
    assert_allclose(trend.at(10)[1], [7, -7])


def test_levels_are_means_of_what_is_known_and_of_what_was_applied():
    record = Record([1.0, np.nan, 3.0], [4.0, 4.0, 1.0], dt=1, arrived=[1.0, 0.0, 1.0])
    trend = Trend.of([record, record])
    assert_allclose(trend.outputs, [[2], [0]])
    assert_allclose(trend.inputs, [[5 / 3], [0]])
    assert trend.taken_from(record).arrived is None


def test_a_channel_of_which_nothing_is_known_stays():
    trend = Trend.of(Record([np.nan, np.nan], [1.0, 1.0], dt=1), 1)
    assert trend.outputs.tolist() == [[0.0], [0.0]]


def test_other_degrees_are_refused():
    with pytest.raises(InputError, match="`degree` must be 0"):
        Trend.of(RECORD, 2)
