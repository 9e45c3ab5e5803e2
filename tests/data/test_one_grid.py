"""Topics of several rates on one grid: outputs placed, inputs averaged, clocks, delays, gaps."""

import logging
from datetime import UTC, datetime
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
from benchmarks.figures import merged_topics
from numpy.testing import assert_allclose, assert_array_equal

import estimable as es
from estimable import Log, Topic

NAN = np.nan


def gyro(t, y, name="imu", **given):
    return Topic(name, t, 1.0, {"gx": y}, **given)


def motor(t, u, name="motor", **given):
    return Topic(name, t, 1.0, {"m1": u}, **given)


def record(*topics, grid=1.0, **options):
    return Log(topics).record(**({"outputs": ["gx"], "inputs": ["m1"], "grid": grid} | options))


def test_outputs_are_placed_in_the_nearest_row_and_nowhere_else():
    found = record(gyro([0.0, 1.4, 2.6, 3.2, 5.0], [1.0, 2.0, 3.0, 4.0, 5.0]), inputs=[])
    assert_array_equal(found.y.ravel(), [1.0, 2.0, NAN, 4.0, NAN, 5.0])
    assert_array_equal(found.t, np.arange(6.0))
    assert "1 sample left out where a nearer one had the row" in found.notes[1]
    assert (found.dt, found.grid) == (1.0, 1.0)


def test_two_rates_of_outputs_meet_on_the_grid_of_the_faster():
    slow = Topic("gps", [0.52, 2.49], 1.0, {"v": [7.0, 8.0]})
    found = record(gyro(np.arange(5.0), np.arange(5.0)), slow, outputs=["gx", "v"], inputs=[])
    assert_array_equal(found.y, [[0.0, NAN], [1.0, 7.0], [2.0, 8.0], [3.0, NAN], [4.0, NAN]])
    assert found.sources == (("gx", "imu/gx"), ("v", "gps/v"))


def mean_of_held(s, v, a, b, reach=np.inf):
    """The mean from a to b of v held from s on for at most `reach`, piece by piece; NaN where a part is unknown."""
    total = known = 0.0
    for start, end, value in zip(s, [*s[1:], np.inf], v, strict=True):
        left, right = max(a, start), min(b, end, start + reach)
        total, known = total + max(right - left, 0.0) * value, known + max(right - left, 0.0)
    return total / known if known > (b - a) * (1 - 1e-9) else NAN


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("max_gap", [None, 0.9])
def test_an_input_is_its_mean_over_the_row(seed, max_gap):
    rng = np.random.default_rng(seed)
    s, v = np.cumsum(rng.exponential(0.3, 60)) - 1.0, rng.normal(size=60)
    found = record(gyro(np.arange(12.0), np.zeros(12)), motor(s, v), max_gap=max_gap)
    reach = np.inf if max_gap is None else max_gap
    means = [mean_of_held(s, v, k, k + 1, reach) for k in range(12)]
    assert_allclose(found.u.ravel(), means[int(found.t[0]) :], rtol=1e-12, atol=1e-12)


def test_an_input_with_the_stamps_of_the_grid_is_left_as_it_is():
    u = np.random.default_rng(0).normal(size=50)
    found = record(gyro(np.arange(50) * 0.1, np.zeros(50)), motor(np.arange(50) * 0.1, u), grid=0.1)
    assert_array_equal(found.u.ravel(), u)


def test_a_linear_input_is_linear_between_its_samples():
    s = np.array([0.0, 2.0, 4.0, 6.0])
    found = record(gyro(np.arange(7.0), np.zeros(7)), motor(s, s**2), hold="first_order")
    assert_array_equal(found.u.ravel(), np.interp(np.arange(7.0), s, s**2))
    assert found.hold == "first_order"
    fast = np.arange(0.0, 7.0, 0.25)
    found = record(gyro(np.arange(7.0), np.zeros(7)), motor(fast, 3 * fast), hold="first_order")
    assert_allclose(found.u.ravel()[1:-1], 3 * np.arange(1.0, 6.0), rtol=1e-12)


def test_what_an_input_was_in_a_gap_of_its_clock_is_not_known():
    s = np.delete(np.arange(0.0, 20.0), [7, 8, 9])
    found = record(gyro(np.arange(20.0), np.arange(20.0)), motor(s, s))
    assert_array_equal(np.flatnonzero(np.isnan(found.u.ravel())), [7, 8, 9])
    assert found.breaks == ()
    events = np.array([0.0, 1.0, 5.5, 6.0, 14.0])
    found = record(gyro(np.arange(20.0), np.arange(20.0)), motor(events, events))
    assert not np.isnan(found.u).any()


def test_a_longest_gap_makes_a_break_where_the_input_is_known_again():
    s = np.delete(np.arange(0.0, 20.0), [7, 8, 9])
    found = record(gyro(s, s), motor(s, s), max_gap=1.0)
    assert found.breaks == (10,)
    assert_array_equal(np.flatnonzero(np.isnan(found.u.ravel())), [7, 8, 9])
    assert "1 gap longer than 1 s: nothing connects across." in found.notes
    assert record(gyro(s, s), motor(s, s), max_gap=1.0, start=3.0).breaks == (7,)
    table = pd.DataFrame({"time": s, "gx": s, "m1": s})
    assert es.Record.from_pandas(table, outputs=["gx"], inputs=["m1"], time="time", max_gap=1.5).breaks == (7,)


def test_rows_before_the_first_input_are_left_out():
    found = record(gyro(np.arange(9.0), np.arange(9.0)), motor([2.5, 3.5], [1.0, 2.0]))
    assert found.t[0] == 3.0
    assert "The first 3 rows are left out: no input was logged yet." in found.notes


def test_without_a_grid_the_rows_are_the_stamps_of_the_outputs():
    t = np.array([0.0, 0.7, 2.1, 3.0])
    found = record(gyro(t, [1.0, NAN, 3.0, 4.0]), motor(np.arange(0.0, 5.0, 0.5), np.arange(10.0)), grid=None)
    assert_array_equal(found.t, t)
    assert_array_equal(found.y.ravel(), [1.0, NAN, 3.0, 4.0])
    s = np.arange(0.0, 5.0, 0.5)
    assert_allclose(found.u.ravel()[:-1], [mean_of_held(s, np.arange(10.0), a, b) for a, b in pairwise(t)], rtol=1e-12)


def test_late_stamps_are_moved_back():
    late = record(
        gyro(np.arange(9.0) + 0.4, np.arange(9.0)), motor(np.arange(10.0), np.arange(10.0)), delay={"imu": 0.4}
    )
    assert_allclose(late.t, np.arange(9.0), atol=1e-12)
    found = record(gyro(np.arange(9.0), np.arange(9.0)), motor(np.arange(10.0), np.arange(10.0)), delay={"m1": 0.5})
    assert_allclose(found.u.ravel(), np.arange(9.0) + 0.5)


def test_columns_of_a_table_are_moved_by_their_delay_and_their_offset():
    table = pd.DataFrame({"time": np.arange(9.0), "gx": np.arange(9.0), "m1": np.arange(9.0)})
    named = {"outputs": {"rate": "gx"}, "inputs": ["m1"], "time": "time", "grid": 1.0}
    late = es.Record.from_pandas(table, **named, delay={"gx": 2.0}, offset={"m1": -2.0})
    assert_array_equal(late.y, late.u)
    assert_array_equal(late.t, np.arange(-2.0, 7.0))
    half = es.Record.from_pandas(table, **named, delay={"rate": 2.0, "m1": 2.5})
    assert_allclose(half.u.ravel()[:-1], np.arange(8.0) + 0.5)


def test_topics_of_two_clocks_need_their_offset():
    topics = (
        gyro(np.arange(9.0), np.arange(9.0), clock="boot"),
        motor(np.arange(10.0) + 1e9, np.arange(10.0), clock="utc"),
    )
    with pytest.raises(es.InputError) as raised:
        record(*topics)
    assert str(raised.value) == (
        "the topics have different clocks ('imu' 'boot', 'motor' 'utc'): give offset={'motor': seconds}, which is added to its "
        "stamps."
    )
    found = record(*topics, offset={"motor": -1e9})
    assert_array_equal(found.u.ravel(), np.arange(9.0))


def test_stamps_since_1970_keep_their_microseconds_and_give_the_date():
    zero = 1_772_452_800_000_000
    imu = Topic("imu", zero + np.arange(9) * 4000 + 1, 1e-6, {"gx": np.arange(9.0)}, clock="utc")
    esc = Topic("motor", zero * 1000 + np.arange(20) * 2_000_000, 1e-9, {"m1": np.arange(20.0)}, clock="utc")
    found = record(imu, esc, grid=0.004)
    assert found.origin == datetime(2026, 3, 2, 12, tzinfo=UTC)
    assert_allclose(found.t, 1e-6 + np.arange(9) * 0.004, atol=1e-12)
    assert_allclose(found.u[0], 0.5 + 1e-6 / 0.004 * 2, rtol=1e-6)


def test_tables_of_two_rates_make_a_log():
    imu = pd.DataFrame({"TimeUS": np.arange(9) * 4000, "gx": np.arange(9.0), "mode": "auto"})
    esc = pd.DataFrame({"t [ms]": np.arange(20) * 2, "m1": np.arange(20.0)})
    log = Log(
        [
            Topic.from_pandas("imu", imu, time="TimeUS", units={"gx": "rad/s"}),
            Topic.from_pandas("motor", esc, time="t [ms]"),
        ]
    )
    found = log.record(outputs={"rate": "imu/gx"}, inputs=["m1"], grid=0.004)
    assert (found.outputs, found.units, found.sources[0]) == (("rate",), (("rate", "rad/s"),), ("m1", "motor/m1"))
    assert_allclose(found.u.ravel(), np.arange(9) * 2 + 0.5)
    dated = pd.DataFrame({"time": ["2026-03-02T12:00:00Z", "2026-03-02T12:00:01Z"], "gx": [1.0, 2.0]})
    assert Topic.from_pandas("imu", dated, time="time").clock == "utc"
    assert Topic.from_pandas("imu", dated[["gx"]], dt=0.5).t.tolist() == [0.0, 0.5]


def test_a_log_is_saved_and_loaded(tmp_path):
    log = Log([gyro(np.arange(9.0), np.arange(9.0), units={"gx": "rad/s"})], datetime(2026, 3, 2, tzinfo=UTC))
    es.save(tmp_path / "log.npz", log)
    found = es.load(tmp_path / "log.npz")
    assert (found.origin, found.topics[0].units) == (log.origin, log.topics[0].units)
    assert repr(found) == "Log(imu: 9 rows)"


def test_placing_is_measured_and_compared_with_the_noise(caplog):
    rng = np.random.default_rng(1)
    t = np.arange(2000) * 0.01 + rng.uniform(0, 0.01, 2000)
    y = 0.5 * t + 1e-4 * rng.normal(size=2000)
    imu = gyro(t, y)
    found = record(imu, grid=0.01, inputs=[])
    (size,) = dict(found.placing).values()
    assert size == pytest.approx(0.5 * 0.01 / np.sqrt(12), rel=0.1)
    assert dict(record(gyro(t, 1e-3 * rng.normal(size=2000)), grid=0.01, inputs=[]).placing)["gx"] < 0.3e-3
    caplog.set_level(logging.WARNING, "estimable")
    for sd in (1e-3, 1e-1):
        model = es.StateSpace([[0.0]], C=[[1.0]], Q=[[1.0]], R=[[sd**2]], dt=0, outputs=["gx"])
        es.estimate(es.Kalman(model), found, prior=es.Prior([0.0], [[1.0]]), keep="last")
    (said,) = [entry.getMessage() for entry in caplog.records]
    assert "(rms), more than 0.3 of its noise, 0.001: give a finer grid, or count it in R." in said


def test_a_slow_command_is_pointed_out(caplog):
    caplog.set_level(logging.WARNING, "estimable.data")
    record(gyro(np.arange(90) * 0.1, np.zeros(90)), motor(np.arange(0.0, 10.0), np.arange(10.0)), grid=0.1)
    assert [entry.getMessage() for entry in caplog.records] == [
        "m1 is logged every 1 s, 10 rows: what it was between is unknown."
    ]


IMU, MOTOR = gyro(np.arange(9.0), np.arange(9.0)), motor(np.arange(9.0), np.arange(9.0))
REFUSED = {
    "two topics": (
        [IMU, Topic("gps", np.arange(9.0), 1.0, {"v": np.arange(9.0)})], {"outputs": ["gx", "v"], "inputs": [], "grid": None},
        "the outputs are of the topics 'gps', 'imu', which have different stamps: give `grid` in seconds.",
    ),
    "too fine": (
        [IMU, MOTOR], {"grid": 0.01},
        "grid = 0.01 s is finer than a tenth of the step of 'gx', 1 s, the fastest output: give at least grid=0.1.",
    ),
    "too many rows": (
        [gyro([0.0, 1.0, 2.0, 1e9], np.arange(4.0)), MOTOR], {},
        "grid = 1 s gives 1,000,000,001 rows, more than 100,000,000: give a larger step.",
    ),
    "no grid": ([IMU, MOTOR], {"grid": -1.0}, "`grid` must be greater than 0 seconds. Got -1."),
    "unknown channel": (
        [IMU, MOTOR], {"outputs": ["gz"]}, "there is no channel 'gz'. The channels are 'imu/gx', 'motor/m1'.",
    ),
    "near channel": (
        [IMU, MOTOR], {"outputs": ["imu/gz"]},
        "there is no channel 'imu/gz'. The channels are 'imu/gx', 'motor/m1'. Did you mean 'imu/gx'?",
    ),
    "several": (
        [IMU, gyro(np.arange(9.0), np.arange(9.0), "imu2"), MOTOR], {},
        "several topics have a channel 'gx': say which of 'imu/gx', 'imu2/gx'.",
    ),
    "dead clock": (
        [IMU, motor(np.zeros(9), np.arange(9.0))], {},
        "topic 'motor' has a dead clock: all its stamps are 0 s. Choose channels of another topic.",
    ),
    "back": (
        [gyro([0.0, 1.0, 3.0, 2.0], np.arange(4.0)), MOTOR], {},
        "the stamps of topic 'imu' go back from 3 to 2 s at row 4: cut it there, or sort it by time.",
    ),
    "repeated": (
        [gyro([0.0, 1.0, 1.0, 2.0], np.arange(4.0)), MOTOR], {},
        (
            "topic 'imu' has 1 repeated stamp, the first at 1 s, with several values of 'gx': give repeated='first' or "
            "repeated='last'."
        ),
    ),
    "text": (
        [IMU, motor(np.arange(9.0), list("abcdefghi"))], {}, "channel motor/m1 must hold numbers. It holds text.",
    ),
    "complex": (
        [IMU, motor(np.arange(9.0), 1j * np.arange(9.0))], {}, "channel motor/m1 must hold numbers. It holds complex numbers.",
    ),
    "all NaN": ([gyro(np.arange(9.0), np.full(9, NAN)), MOTOR], {}, "channel 'gx' holds no value: leave it out."),
    "delay of another": (
        [IMU, MOTOR], {"delay": {"imv": 0.1}},
        "`delay` names 'imv', which is none of 'imu', 'motor', 'gx', 'm1'. Did you mean 'imu'?",
    ),
    "delay a number": (
        [IMU, MOTOR], {"delay": 0.1}, "`delay` must be a mapping of topics to seconds, as in {'gps': 0.2}. Got 0.1.",
    ),
    "nothing between": (
        [IMU, MOTOR], {"start": 20.0}, "no row lies between start = 20.0 and stop = None s: the record goes from 0 to 8 s.",
    ),
    "hold": ([IMU, MOTOR], {"hold": "linear"}, "`hold` must be one of 'zero_order', 'first_order'. Got 'linear'."),
    "repeated word": ([IMU, MOTOR], {"repeated": "mean"}, "`repeated` must be one of 'first', 'last'. Got 'mean'."),
    "inputs later": (
        [IMU, motor(np.arange(9.0) + 50, np.arange(9.0))], {},
        (
            "no row has all its inputs: they were logged 'm1' from 50 to 58 s, and the outputs from 0 to 8 s. Do the stamps "
            "count from different zeros? Then give `offset`."
        ),
    ),
    "no output": ([IMU, MOTOR], {"outputs": []}, "`outputs` must name at least one channel."),
}  # fmt: skip


@pytest.mark.parametrize(("topics", "options", "sentence"), REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_merged_is_refused_with_the_option_that_helps(topics, options, sentence):
    with pytest.raises(es.InputError) as raised:
        record(*topics, **options)
    assert str(raised.value) == sentence


def test_a_table_is_refused_with_the_option_that_helps():
    table = pd.DataFrame({"time": np.arange(4.0), "gx": np.arange(4.0), "came": 1.0, "u": 0.0})
    for options, sentence in (
        ({"grid": 1.0}, "`grid` places samples by their times: give `time`, the column that holds them."),
        ({"time": "time", "delay": {"gx": 0.1}}, "`delay` moves samples to other rows: give `grid` in seconds."),
        ({"time": "time", "offset": {"gx": 0.1}}, "`offset` moves samples to other rows: give `grid` in seconds."),
        (
            {"time": "time", "grid": 1.0, "offset": {"gz": 0.1}},
            "`offset` names 'gz', which is none of 'gx'.",
        ),
        ({"dt": 1.0, "max_gap": 1.0}, "`max_gap` needs times: give `time`, the column that holds them."),
        (
            {"time": "time", "grid": 1.0, "inputs": ["u"], "arrived": "came"},
            "`arrived` marks the rows of the table, which `grid` replaces: leave one of them out.",
        ),
    ):
        with pytest.raises(es.InputError) as raised:
            es.Record.from_pandas(table, outputs=["gx"], **options)
        assert str(raised.value) == sentence


def test_wrong_topics_and_logs_are_refused():
    for make, sentence in (
        (lambda: Topic("a", ["x"], 1.0, {}), "`ticks` must be a list of numbers."),
        (lambda: Topic("a", [], 1.0, {"x": []}), "topic 'a' has no row: leave it out."),
        (lambda: Topic("a", [0, 1], 0.0, {"x": [1, 2]}), "`tick` must be greater than 0 seconds."),
        (
            lambda: Topic("a", [0, 1], 1.0, {"x": [1]}),
            "channel 'x' must have a value for each of the 2 ticks. Got (1,).",
        ),
        (lambda: Topic("a", [0, 1], 1.0, {}, clock="gps"), "`clock` must be one of 'boot', 'start', 'utc', 'row'."),
        (lambda: Topic("a", [0, 1], 1.0, [1, 2]), "`channels` must be a mapping of names to values."),
        (lambda: Log([]), "`topics` must be a list of Topic."),
        (lambda: Log([IMU, IMU]), "`topics` must have different names. Several are named 'imu'."),
    ):
        with pytest.raises(es.InputError) as raised:
            make()
        assert str(raised.value).startswith(sentence)


def test_merged_topics_leave_white_innovations_of_the_right_size():
    """NIS .95 to 1.06 and |lag-1| < .05; five draws of the figure give 1.00 and .01."""
    imu, motor, x, _ = merged_topics.drawn(1, 5000)
    merged = Log([imu, motor]).record(outputs=["y"], inputs=["u"], grid=merged_topics.H)
    nis, lag, _ = merged_topics.judged(merged, x)
    assert 0.95 < nis < 1.06
    assert abs(lag) < 0.05
