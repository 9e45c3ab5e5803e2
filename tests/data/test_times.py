"""Columns of times: the unit of numbers, dates in every order, zones, repeated stamps."""

import logging
from datetime import UTC, datetime, timedelta, timezone

import numpy as np
import pandas as pd
import pytest

import estimable as es
from estimable import Record, read_record

T = 300
TICKS = np.arange(T) * 5000
NOON = datetime(2026, 3, 2, 12, tzinfo=UTC)


def read(times, name="timestamp", **options):
    table = pd.DataFrame({name: times, "y": np.arange(float(len(times)))})
    return Record.from_pandas(table, outputs=["y"], time=name, **options)


def refusal(times, name="timestamp", **options):
    with pytest.raises(es.InputError) as raised:
        read(times, name, **options)
    return str(raised.value)


def test_microseconds_without_a_name_are_refused_with_what_each_unit_means():
    assert refusal(TICKS) == (
        "the time column 'timestamp' steps by 5000: say time_unit='us', 'ms' or 's' (with 'us' the record lasts 1.495 s at "
        "200 Hz, with 'ms' the record lasts 24.92 min at 0.2 Hz, with 's' the record lasts 17.3 d at 0.0002 Hz)."
    )


@pytest.mark.parametrize("first", [0, 1_000_000_000, 3_000_000_000])
@pytest.mark.parametrize("step", [51, 4000, 2_000_000])
def test_a_boot_clock_in_small_ticks_never_becomes_seconds(first, step):
    """1e9 to 4e9 microseconds after the start of a device are dates in seconds since 1970."""
    assert "say time_unit=" in refusal(first + np.arange(T) * step)


@pytest.mark.parametrize(
    ("unit", "per"), [("s", 1), ("ms", 1e3), ("us", 1e6), ("ns", 1e9), ("min", 1 / 60), ("h", 1 / 3600)]
)
def test_a_given_unit_counts_first(unit, per):
    for name in ("timestamp", "t [ms]", "TimeUS"):
        record = read(TICKS, name, time_unit=unit)
        np.testing.assert_allclose(record.t, TICKS / per, rtol=1e-15)
        assert f"is in {unit} (time_unit='{unit}')" in record.notes[0]


@pytest.mark.parametrize(("name", "unit"), [
    ("t [us]", "us"), ("t (µs)", "us"), ("time_us", "us"), ("TimeUS", "us"), ("TimeMS", "ms"), ("stamp_ms", "ms"),
    ("clock_ns", "ns"), ("t [s]", "s"), ("seconds_s", "s"), ("time [min]", "min"), ("elapsed (hours)", "h"),
])  # fmt: skip
def test_the_name_of_a_column_says_the_unit(name, unit):
    record = read(TICKS, name)
    per = {"s": 1, "ms": 1e3, "us": 1e6, "ns": 1e9, "min": 1 / 60, "h": 1 / 3600}[unit]
    np.testing.assert_allclose(record.t, TICKS / per, rtol=1e-15)
    assert f"is in {unit} (by its name)" in record.notes[0]


@pytest.mark.parametrize(
    ("per", "unit", "step"), [(1, "s", 1), (10**3, "ms", 20), (10**6, "us", 4000), (10**9, "ns", 4_000_000)]
)
@pytest.mark.parametrize("kind", ["int", "text"])
def test_a_date_since_1970_says_the_unit_and_is_the_origin(per, unit, step, kind):
    ticks = int(NOON.timestamp()) * per + np.arange(T) * step
    record = read([str(tick) for tick in ticks] if kind == "text" else ticks)
    np.testing.assert_allclose(record.t, np.arange(T) * step / per, rtol=1e-14)
    assert record.origin == NOON
    assert record.notes[0].startswith(f"The time column 'timestamp' holds dates in {unit} since 1970")


def test_microseconds_since_1970_keep_their_microseconds():
    ticks = 1_772_452_800_000_001 + np.array([0, 3, 7])
    record = read(ticks, "TimeUS")
    np.testing.assert_array_equal(record.t, [0.0, 3e-6, 7e-6])
    assert record.origin == NOON + timedelta(microseconds=1)


def test_short_steps_are_seconds_and_the_note_says_so(caplog):
    record = read(np.arange(T) * 0.02)
    assert record.notes == ("The time column 'timestamp' is in s (its steps of 0.02 are at most 50): 5.98 s at 50 Hz.",)
    caplog.set_level(logging.WARNING, "estimable.data")
    assert read(np.arange(T) * 20).dt == 20
    assert [entry.getMessage() for entry in caplog.records] == [
        "The time column 'timestamp' steps by 20 and names no unit: read as seconds, 99.67 min. If it is in ms or us, give "
        "time_unit."
    ]


def test_numbers_that_are_no_time_in_their_unit_are_refused():
    ticks = 1_700_000_000_000 + np.arange(3) * 10
    assert refusal(ticks, "t [s]") == (
        "the time column 't [s]' holds numbers up to 1.7e+12, which is no time in s (by its name). Did you mean time_unit='ms'?"
    )
    assert refusal(TICKS, time_unit="days").startswith("`time_unit` must be one of 's', 'ms', 'us', 'ns', 'min', 'h'.")


STAMPS = pd.Timestamp("2026-03-14 21:59:58") + pd.to_timedelta(np.arange(6) * 0.5, unit="s")
DATES = {
    "iso": ([stamp.isoformat() for stamp in STAMPS], {}, None),
    "iso with Z": ([f"{stamp.isoformat()}Z" for stamp in STAMPS], {}, UTC),
    "iso with an offset": ([f"{stamp.isoformat()}+02" for stamp in STAMPS], {}, timezone(timedelta(hours=2))),
    "day first": (list(STAMPS.strftime("%d.%m.%Y %H:%M:%S.%f")), {}, None),
    "month first, 12 hours": (list(STAMPS.strftime("%m/%d/%Y %I:%M:%S.%f %p")), {}, None),
    "short year": (list(STAMPS.strftime("%d-%m-%y %H:%M:%S.%f")), {}, None),
    "decimal comma": ([text.replace(".5", ",5") for text in STAMPS.strftime("%d/%m/%Y %H:%M:%S.%f")], {}, None),
    "format": (list(STAMPS.strftime("%Y %j %H:%M:%S.%f")), {"time_format": "%Y %j %H:%M:%S.%f"}, None),
    "zone": ([stamp.isoformat() for stamp in STAMPS], {"zone": "UTC"}, UTC),
    "dates": (STAMPS, {}, None),
    "dates in ms": (STAMPS.as_unit("ms"), {}, None),
}


@pytest.mark.parametrize(("times", "options", "zone"), DATES.values(), ids=DATES)
def test_dates_are_seconds_after_the_first_with_its_date(times, options, zone):
    record = read(times, **options)
    np.testing.assert_allclose(record.t, np.arange(6) * 0.5, atol=1e-12)
    first = datetime(2026, 3, 14, 21, 59, 58)
    assert record.origin == (first if zone is None else first.replace(tzinfo=zone))
    assert ("without a zone, taken as written" in record.notes[0]) == (zone is None)


def test_days_and_months_that_may_change_places_are_asked_for():
    times = ["02.03.2026 12:00:00", "02.03.2026 12:00:01"]
    assert refusal(times) == (
        "the time column 'timestamp' holds '02.03.2026 12:00:00', which is 2 March 2026 or 3 February 2026: say "
        "time_format='day first' or 'month first'."
    )
    assert read(times, time_format="day first").origin == datetime(2026, 3, 2, 12)
    assert read(times, time_format="month first").origin == datetime(2026, 2, 3, 12)
    assert read(times, time_format="%d.%m.%Y %H:%M:%S").origin == datetime(2026, 3, 2, 12)


def test_the_order_that_increases_is_taken():
    days = ["30.01.2026", "31.01.2026", "01.02.2026", "02.02.2026"]
    assert read(days).origin == datetime(2026, 1, 30)
    assert read(["11.01.2026", "12.01.2026", "01.02.2026"]).origin == datetime(2026, 1, 11)
    assert read(["02.02.2026 12:00", "02.02.2026 12:01"]).origin == datetime(2026, 2, 2, 12)
    assert "no order of day and month fits every row and increases" in refusal(["31.01.2026", "30.01.2026"])
    assert "time_format='month first' does not fit every row" in refusal(days, time_format="month first")
    assert "does not fit time_format='%Y': row 1" in refusal(days, time_format="%Y")


def test_a_clock_that_is_put_back_needs_its_zone():
    utc = pd.date_range("2026-10-25 00:30", periods=9, freq="10min", tz="UTC")
    local = [stamp.isoformat() for stamp in utc.tz_convert("Europe/Paris").tz_localize(None)]
    assert refusal(local).endswith("the clock was put back; give zone=, as zone='Europe/Paris'.")
    record = read(local, zone="Europe/Paris")
    np.testing.assert_array_equal(record.t, np.arange(9) * 600.0)
    assert record.origin.astimezone(UTC) == datetime(2026, 10, 25, 0, 30, tzinfo=UTC)
    spring = ["2026-03-29 02:30:00", "2026-03-29 02:31:00"]
    assert refusal(spring, zone="Europe/Paris") == (
        "the time column 'timestamp' does not fit zone='Europe/Paris': 2026-03-29 02:30:00 is a nonexistent time due to daylight "
        "savings time. Give stamps with an offset."
    )
    assert refusal(local, zone="Mars/Olympus").startswith("`zone` must be the name of a time zone")
    assert refusal(["2026-01-01T00:00:00Z", "2026-01-01T00:00:01"]).startswith(
        "the time column 'timestamp' must hold numbers"
    )


def test_times_of_day_and_durations():
    assert read(["23:10:00", "23:10:00.5", "23:10:01"]).dt == 0.5
    assert read(pd.to_timedelta([1, 2, 3], unit="s")).notes == ("The time column 'timestamp' holds durations.",)
    assert "`time_unit` is for numbers" in refusal(["2026-01-01", "2026-01-02"], time_unit="us")


def test_a_clock_that_never_moves_is_dead():
    assert refusal(np.zeros(5)) == (
        "the time column 'timestamp' is a dead clock: every row has the time 0 s. Give another column, or the step `dt`."
    )


@pytest.mark.parametrize(("repeated", "kept"), [("first", [0.0, 1.0, 3.0, 6.0]), ("last", [0.0, 2.0, 5.0, 6.0])])
@pytest.mark.parametrize("grid", [None, 1.0])
def test_one_of_several_rows_at_one_stamp_counts(repeated, kept, grid):
    times = [0.0, 1.0, 1.0, 2.0, 2.0, 2.0, 3.0]
    assert read(times, repeated=repeated, grid=grid).y.ravel().tolist() == kept
    assert "repeated='first' or" in refusal(times, grid=grid)


def test_a_file_is_read_with_every_option(tmp_path):
    pd.DataFrame({"t": TICKS, "q": np.arange(T), "δ": np.ones(T)}).to_csv(tmp_path / "log.csv", index=False)
    record = read_record(
        tmp_path / "log.csv",
        outputs={"rate": "q"},
        inputs=["δ"],
        time="t",
        time_unit="us",
        grid=0.01,
        start=0.2,
        stop=1.0,
    )
    assert (record.dt, record.grid, record.sources) == (0.01, 0.01, (("rate", "q"),))
    assert record.t[0] == pytest.approx(0.2)
    assert record.t[-1] == pytest.approx(1.0)
    with pytest.raises(es.InputError, match="`time_unit` says how a time is read: give `time`"):
        read_record(tmp_path / "log.csv", outputs=["q"], dt=0.1, time_unit="us")
