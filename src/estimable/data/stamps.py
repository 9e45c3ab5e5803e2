"""Columns of times: numbers with a unit, dates with or without a zone, times of day and durations."""

import re
from typing import TYPE_CHECKING, Any, NamedTuple
from zoneinfo import ZoneInfo

import numpy as np

from .. import checks
from .time_units import Seconds, known_unit, seconds_of

if TYPE_CHECKING:
    import pandas as pd

REMEDY = "sort the rows by time"
WANTED = "numbers, or timestamps like 2026-01-31 12:00:00.5"
OFFSET = r":\d\d(?:[.,]\d+)?\s*(?:Z|[+-]\d\d(?::?\d\d)?)$"  # of a zone, at the end of a text
DATE = re.compile(  # 02.03.2026 12:00:00.5 or 3/2/26 9:00 PM: day, mark, month (or month, mark, day), year, and the time of day
    r"^(\d{1,2})([./-])(\d{1,2})\2(\d{4}|\d\d)(?:[ T,]+(\d{1,2}):(\d\d)(?::(\d\d(?:[.,]\d+)?))?\s*([AaPp][Mm])?)?$"
)
ORDERS = ("day first", "month first")
HOUR, DAY = 3600.0, 86_400.0


class TimeOptions(NamedTuple):
    """How a column of times is read: `unit` of numbers; `format` of texts ("day first", "month first" or a format of strptime);
    `zone` of dates without an offset."""

    unit: str | None = None
    format: str | None = None
    zone: str | None = None


def read_stamps(column: "pd.Series", label: str, options: TimeOptions, faults: checks.Faults) -> Seconds | None:
    """The times of a column in seconds, the date of t = 0 and the rule that decided; None if something is at fault."""
    unit, zone = known_unit(options.unit, faults), _zone(options.zone, faults)
    if len(column) == 0:
        return None
    if column.isna().any():
        faults.add(f"{label} must not be empty or NaN. Row {int(np.argmax(column.isna())) + 1} below the header is.")
        return None
    stamps, how = _parsed(column, label, options.format, faults)
    if stamps is None:
        return None
    if stamps.dtype.kind in "mM":
        read = (
            _of_dates(stamps, label, how, zone, faults)
            if stamps.dtype.kind == "M"
            else _of_durations(stamps, label, how)
        )
        if unit is not None and read is not None:
            faults.add(f"`time_unit` is for numbers, but {label} holds {how}: leave it out.")
    else:
        read = seconds_of(stamps.to_numpy(), label, str(column.name), unit, faults)
    if read is not None:
        _check_order(read.t, label, how, zone is None and read.origin is not None, faults)
    return read


def _zone(zone: str | None, faults: checks.Faults) -> ZoneInfo | None:
    if zone is None:
        return None
    try:
        return ZoneInfo(zone)
    except Exception:  # ZoneInfo raises different exceptions for names, paths and other types
        faults.add(f"`zone` must be the name of a time zone, as 'Europe/Paris' or 'UTC'. Got {checks.short(zone)}.")
        return None


def _parsed(column: "pd.Series", label: str, form: str | None, faults: checks.Faults) -> "tuple[pd.Series | None, str]":
    """Numbers, dates or durations, and a word for what they were."""
    import pandas as pd

    if isinstance(column.dtype, pd.PeriodDtype):
        return column.dt.to_timestamp(), "periods"
    if form is not None and form not in ORDERS:
        return _by_format(column, label, form, faults), f"dates in the format {form!r}"
    if column.dtype.kind in "mM":
        return column, "dates" if column.dtype.kind == "M" else "durations"
    numbers = _numbers(column)
    if numbers is not None:
        return numbers, "numbers"
    texts = column.astype(str).str.strip()
    if form is not None or DATE.match(texts.iloc[0]):
        return _by_order(texts, label, form, faults)
    for parse, how in ((_iso, "dates (ISO 8601)"), (_time_of_day, "times of day")):
        if (found := parse(texts)) is not None:
            return found, how
    wrong = pd.Series(pd.to_numeric(column, errors="coerce")).isna().to_numpy()
    row = int(np.argmax(wrong))
    faults.add(f"{label} must hold {WANTED}. Row {row + 1} below the header holds {checks.short(column.iloc[row])}.")
    return None, ""


def _numbers(column: "pd.Series") -> "pd.Series | None":
    """The column as int64 or float64; None where an entry is no finite number."""
    import pandas as pd

    if getattr(column.dtype, "kind", "O") in "cb":
        return None
    try:
        found = pd.Series(pd.to_numeric(column))
    except (OverflowError, TypeError, ValueError):
        return None
    found = found.astype("int64" if getattr(found.dtype, "kind", "f") in "iu" else float)
    return found if np.isfinite(found.to_numpy()).all() else None


def _iso(texts: "pd.Series") -> "pd.Series | None":
    """Dates of ISO 8601, all with an offset or all without one."""
    import pandas as pd

    offset = texts.str.contains(OFFSET)
    found = pd.to_datetime(texts, format="ISO8601", utc=True, errors="coerce")
    if found.isna().any() or offset.nunique() > 1:
        return None
    return found if offset.iloc[0] else found.dt.tz_localize(None)


def _time_of_day(texts: "pd.Series") -> "pd.Series | None":
    import pandas as pd

    found = pd.to_timedelta(texts.where(texts.str.fullmatch(r"\d{1,2}:\d\d(?::\d\d(?:\.\d+)?)?")), errors="coerce")
    return None if found.isna().any() else found


def _by_format(column: "pd.Series", label: str, form: str, faults: checks.Faults) -> "pd.Series | None":
    """Dates of a given format."""
    import pandas as pd

    try:
        found = pd.to_datetime(column.astype(str).str.strip(), format=form, errors="coerce", utc="%z" in form)
    except (TypeError, ValueError) as error:
        faults.add(f"`time_format` must be a format of strptime, as '%d.%m.%Y %H:%M:%S'. Got {form!r}: {error}.")
        return None
    if not found.isna().any():
        return found
    row = int(np.argmax(found.isna()))
    held = checks.short(column.iloc[row])
    faults.add(f"{label} does not fit time_format={form!r}: row {row + 1} below the header holds {held}.")
    return None


def _by_order(
    texts: "pd.Series", label: str, form: str | None, faults: checks.Faults
) -> "tuple[pd.Series | None, str]":
    """Dates such as 02.03.2026 12:00: in the given order, or in the one that fits every row and increases."""
    fitting = {order: found for order in ORDERS if (found := _in_order(texts, order)) is not None}
    if form is None:
        fitting = {order: found for order, found in fitting.items() if found.is_monotonic_increasing}
    else:
        fitting = {order: found for order, found in fitting.items() if order == form}
    first, orders = texts.iloc[0], list(fitting)
    if len(orders) == 2 and not fitting[orders[0]].equals(fitting[orders[1]]):
        meanings = " or ".join(f"{found.iloc[0]:%-d %B %Y}" for found in fitting.values())
        faults.add(f"{label} holds {first!r}, which is {meanings}: say time_format='day first' or 'month first'.")
        return None, ""
    if not orders:
        wanted = "no order of day and month" if form is None else f"time_format={form!r} does not"
        fits = f"{wanted} fits every row and increases" if form is None else f"{wanted} fit every row"
        faults.add(f"{label} holds dates such as {first!r}, but {fits}: give time_format=, as '%d.%m.%Y %H:%M:%S'.")
        return None, ""
    return fitting[orders[0]], f"dates, {orders[0]}"


def _in_order(texts: "pd.Series", order: str) -> "pd.Series | None":
    """Dates with the day or the month first; None where a row does not fit."""
    import pandas as pd

    parts = texts.str.extract(DATE)
    day, month = (parts[0], parts[2]) if order == ORDERS[0] else (parts[2], parts[0])
    year = parts[3].where(parts[3].str.len() == 4, "20" + parts[3])
    dates = pd.to_datetime(year + "-" + month + "-" + day, format="%Y-%m-%d", errors="coerce")
    hours, minutes, seconds = (
        np.nan_to_num(parts[i].str.replace(",", ".").astype(float).to_numpy()) for i in (4, 5, 6)
    )
    half = parts[7].str.upper()
    hours = np.where(half.isna(), hours, hours % 12 + 12 * (half == "PM"))
    found = pd.Series(dates + pd.to_timedelta(3600 * hours + 60 * minutes + seconds, unit="s"))
    return None if found.isna().any() or np.any(hours > 23) else found


def _of_durations(stamps: "pd.Series", label: str, how: str) -> Seconds:
    return Seconds(stamps.dt.total_seconds().to_numpy(float), None, f"{label} holds {how}.")


def _of_dates(
    stamps: "pd.Series", label: str, how: str, zone: ZoneInfo | None, faults: checks.Faults
) -> Seconds | None:
    """Seconds after the first date. A date without an offset is in `zone`; without one it is taken as written."""
    words = f"{label} holds {how}"
    if stamps.dt.tz is None and zone is not None:
        try:
            stamps = stamps.dt.tz_localize(zone, ambiguous="infer")
        except (
            Exception
        ) as error:  # pandas and zoneinfo raise ValueError and its like for times that do not exist or occur twice
            why = str(error).split(". Try")[0].split(", try")[0].rstrip(".")
            faults.add(f"{label} does not fit zone={zone.key!r}: {why}. Give stamps with an offset.")
            return None
    elif stamps.dt.tz is None:
        words += " without a zone, taken as written"
    elif zone is not None:
        stamps = stamps.dt.tz_convert(zone)
    origin: Any = stamps.iloc[0]
    t = (stamps - stamps.iloc[0]).dt.total_seconds().to_numpy(float)
    return Seconds(t, origin.to_pydatetime(warn=False), f"{words}.")


def _check_order(t: np.ndarray, label: str, how: str, local: bool, faults: checks.Faults) -> None:
    """Times that go back, or never move, are at fault. `local`: dates without a zone, which a clock that is put back repeats."""
    steps = np.diff(t)
    if len(t) > 2 and not np.any(steps):
        faults.add(
            f"{label} is a dead clock: every row has the time {t[0]:g} s. Give another column, or the step `dt`."
        )
    if not np.any(steps < 0):
        return
    row = int(np.argmax(steps < 0)) + 1
    typical = float(np.median(steps[steps > 0])) if np.any(steps > 0) else 0.0
    remedy = REMEDY
    if local and abs(steps[row - 1] + HOUR - typical) <= max(typical, 1.0):
        remedy = "the clock was put back; give zone=, as zone='Europe/Paris'"
    elif how == "times of day" and steps[row - 1] < -DAY / 2:
        remedy = "the times pass midnight; give a column with dates"
    faults.add(
        f"{label} must increase. From row {row} to row {row + 1} below the header it goes from {float(t[row - 1])} "
        f"to {float(t[row])} s: {remedy}."
    )
