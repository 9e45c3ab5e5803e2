"""Rows, time, the mask, what the actuator applied, and cuts."""

import dataclasses

import numpy as np
import pandas as pd
import pytest

from estimable import Record, StateSpace, simulate

NAN = np.nan


def test_a_list_of_numbers_is_one_channel():
    record = Record([1.0, 2.0, 3.0], [4.0, 5.0, 6.0])
    assert (record.y.shape, record.u.shape) == ((3, 1), (3, 1))
    assert (record.outputs, record.inputs) == (("y1",), ("u1",))
    np.testing.assert_array_equal(record.y[:, 0], [1.0, 2.0, 3.0])


def test_a_series_and_a_frame_are_arrays():
    frame = pd.DataFrame({"a": [1.0, 2.0], "b": [3.0, 4.0]})
    np.testing.assert_array_equal(Record(frame).y, frame.to_numpy())
    np.testing.assert_array_equal(Record(frame["b"]).y, [[3.0], [4.0]])


def test_without_inputs_there_are_none():
    record = Record([1.0, 2.0])
    assert record.u.shape == (2, 0)
    assert (record.inputs, record.arrived, record.dt, record.t, record.seconds) == ((), None, None, None, None)


def test_nothing_of_a_record_can_be_set():
    with pytest.raises(dataclasses.FrozenInstanceError):
        Record([1.0]).y = 3.0


def test_a_record_does_not_change_with_the_array_it_was_made_of():
    y = np.ones((3, 1))
    record = Record(y)
    y[0] = NAN
    assert record.seen.all()


def test_booleans_count_as_one_and_zero():
    np.testing.assert_array_equal(Record([1.0, 2.0], [True, False]).u, [[1.0], [0.0]])
    np.testing.assert_array_equal(Record([1.0, 2.0], [1.0, 1.0], arrived=[True, False]).arrived, [[1.0], [0.0]])


def test_what_was_seen_is_told_channel_by_channel():
    np.testing.assert_array_equal(Record([[1.0, NAN], [NAN, NAN]]).seen, [[True, False], [False, False]])


def test_units_are_kept_with_their_channels():
    record = Record([1.0], [2.0], outputs=["q"], inputs=["de"], units={"q": "deg/s", "de": "deg"})
    assert dict(record.units) == {"q": "deg/s", "de": "deg"}


def test_a_step_makes_times():
    record = Record(np.zeros(4), dt=0.5)
    np.testing.assert_array_equal(record.t, [0.0, 0.5, 1.0, 1.5])
    assert (record.dt, record.seconds) == (0.5, 1.5)


REGULAR = {
    "exact": (np.arange(5) * 0.25, 0.25),
    "from elsewhere": (100.0 + np.arange(5) * 0.25, 0.25),
    "rounded in a file": (np.round(np.arange(2000) * 0.01, 8), 0.01),
    "seconds since 1970": (1.7e9 + np.arange(2000) * 0.01, 0.01),
    "two rows": ([3.0, 5.0], 2.0),
}


@pytest.mark.parametrize(("t", "dt"), REGULAR.values(), ids=REGULAR)
def test_regular_times_have_a_step(t, dt):
    record = Record(np.zeros(len(t)), t=t)
    assert record.dt == pytest.approx(dt, rel=1e-6)
    np.testing.assert_array_equal(record.t, t)
    clock = record.clock()
    assert clock.rows is None
    assert float(clock.lengths) == record.dt


@pytest.mark.parametrize("t", [[0.0, 1.0, 3.0], [0.0, 1.0, 2.0, 3.00001], 1.7e9 + np.array([0.0, 0.01, 0.021])])
def test_irregular_times_have_none(t):
    record = Record(np.zeros(len(t)), t=t)
    assert record.dt is None
    assert record.seconds == t[-1] - t[0]


def test_times_and_a_step_that_agree_may_both_be_given():
    assert Record(np.zeros(3), t=[0.0, 0.1, 0.2], dt=0.1).dt == pytest.approx(0.1, rel=1e-15)


def test_one_row_has_the_step_it_is_given():
    assert Record([1.0], t=[7.0]).dt is None
    assert Record([1.0], t=[7.0], dt=0.1).dt == 0.1
    assert float(Record([1.0], t=[7.0]).clock(0.2).lengths) == 0.2


def test_the_clock_of_a_record_without_time_is_that_of_the_model():
    clock = Record(np.zeros(3), hold="first_order").clock(0.3)
    assert (float(clock.lengths), clock.rows, clock.hold) == (0.3, None, "first_order")


def test_the_clock_tells_which_length_each_row_has_and_fills_up_to_a_power_of_two():
    steps = np.array([0.1, 0.2, 0.1, 0.1, 0.4])
    t = np.concatenate([[0.0], np.cumsum(steps)])
    clock = Record(np.zeros(6), t=t, hold="first_order").clock()
    np.testing.assert_allclose(clock.lengths, [0.1, 0.2, 0.4, 0.4], rtol=1e-12)
    np.testing.assert_allclose(clock.lengths[clock.rows[:-1]], steps, rtol=1e-12)
    assert clock.rows[-1] == clock.rows[-2]
    assert clock.hold == "first_order"


def test_a_gap_in_a_long_regular_record_makes_two_lengths():
    t = np.delete(1.7e9 + np.arange(1000) * 0.01, slice(500, 510))
    clock = Record(np.zeros(len(t)), t=t).clock()
    assert len(clock.lengths) == 2
    np.testing.assert_allclose(sorted(clock.lengths), [0.01, 0.11], rtol=1e-4)


U = np.array([[1.0, 10.0], [2.0, 20.0], [3.0, 30.0], [4.0, 40.0]])
ARRIVED = np.array([[0, 1], [1, 0], [0, 0], [1, 1]])


def test_without_a_network_what_was_sent_is_applied():
    u = np.where(U == 3.0, NAN, U)
    np.testing.assert_array_equal(Record(np.zeros(4), u).applied(), u)


def test_an_actuator_may_fall_to_zero_without_a_packet():
    applied = Record(np.zeros(4), U, arrived=ARRIVED).applied()
    np.testing.assert_array_equal(applied, [[0, 10], [2, 0], [0, 0], [4, 40]])


def test_an_actuator_may_hold_the_last_packet_that_arrived():
    applied = Record(np.zeros(4), U, arrived=ARRIVED, lost="hold").applied()
    np.testing.assert_array_equal(applied, [[0, 10], [2, 10], [2, 10], [4, 40]])


def test_a_fate_that_nobody_knows_is_an_input_that_nobody_knows():
    arrived = [1, NAN, 0, 1, 0]
    zero = Record(np.zeros(5), [1.0, 2.0, 3.0, 4.0, 5.0], arrived=arrived).applied()
    hold = Record(np.zeros(5), [1.0, 2.0, 3.0, 4.0, 5.0], arrived=arrived, lost="hold").applied()
    np.testing.assert_array_equal(zero[:, 0], [1, NAN, 0, 4, 0])
    np.testing.assert_array_equal(hold[:, 0], [1, NAN, NAN, 4, 4])


def test_what_was_not_logged_is_not_known_unless_it_was_lost():
    record = Record(np.zeros(3), [NAN, NAN, 1.0], arrived=[1, 0, 1])
    np.testing.assert_array_equal(record.applied()[:, 0], [NAN, 0.0, 1.0])


def test_what_was_sent_stays_what_was_sent():
    record = Record(np.zeros(4), U, arrived=ARRIVED, lost="hold")
    record.applied()
    np.testing.assert_array_equal(record.u, U)


ROWS = [slice(2, 5), slice(None, 3), slice(-2, None), slice(1, -1), slice(0, 100), slice(np.int64(1), np.int64(3))]


@pytest.mark.parametrize("rows", ROWS, ids=str)
@pytest.mark.parametrize(
    "time", [{}, {"dt": 0.1}, {"t": [0.0, 1.0, 2.0, 4.0, 5.0, 6.5]}], ids=["none", "regular", "irregular"]
)
def test_a_cut_has_the_rows_it_says(rows, time):
    y, u, arrived = np.random.default_rng(1).normal(size=(6, 2)), np.arange(6.0), np.array([1, 0, 1, 1, 0, 0])
    record = Record(y, u, arrived=arrived, outputs=["a", "b"], units={"a": "m"}, **time)
    cut = record[rows]
    np.testing.assert_array_equal(cut.y, y[rows])
    np.testing.assert_array_equal(cut.u[:, 0], u[rows])
    np.testing.assert_array_equal(cut.arrived[:, 0], arrived[rows])
    assert (cut.outputs, cut.inputs, cut.units, cut.lost) == (record.outputs, record.inputs, record.units, record.lost)
    if record.t is None:
        assert cut.t is None
    else:
        np.testing.assert_array_equal(cut.t, record.t[rows])


def test_a_regular_part_of_an_irregular_record_is_regular():
    record = Record(np.zeros(5), t=[0.0, 1.0, 2.0, 2.5, 3.0])
    assert (record.dt, record[:3].dt, record[2:].dt, record[1:4].dt, record[:1].dt) == (None, 1.0, 0.5, None, None)


@pytest.mark.parametrize("lost", ["zero", "hold"])
@pytest.mark.parametrize("first", range(8))
def test_a_cut_applies_what_the_whole_record_applies(lost, first):
    arrived = [[0, 1], [1, 0], [0, NAN], [0, 0], [1, 0], [0, 1], [0, 0], [0, 0]]
    u = np.arange(16.0).reshape(8, 2) + 1
    record = Record(np.zeros(8), u, arrived=arrived, lost=lost)
    np.testing.assert_array_equal(record[first:].applied(), record.applied()[first:])
    np.testing.assert_array_equal(record[first:][: 8 - first].applied(), record.applied()[first:])
    if first < 7:
        np.testing.assert_array_equal(record[first:][1:].applied(), record.applied()[first + 1 :])


@pytest.mark.parametrize(("fraction", "rows"), [(0.5, 5), (0.1, 1), (0.94, 9), (np.float32(0.25), 2)])
def test_a_split_keeps_every_row_once(fraction, rows):
    record = Record(np.arange(10.0), np.arange(10.0), dt=0.1)
    first, rest = record.split(fraction)
    assert len(first) == rows
    np.testing.assert_array_equal(np.concatenate([first.y, rest.y]), record.y)
    np.testing.assert_array_equal(np.concatenate([first.t, rest.t]), record.t)


def test_a_simulated_record_is_like_any_other():
    model = StateSpace([[0.9]], [[1.0]], R=[[0.1]], dt=0.5, inputs=["u"], outputs=["y"])
    record = simulate(model, np.ones(6), seed=1).record
    assert (len(record), record.dt, record.inputs, record.outputs) == (6, 0.5, ("u",), ("y",))
    assert len(record[2:]) == 4
