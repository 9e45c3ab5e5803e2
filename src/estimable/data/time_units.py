"""The unit of a column of numbers that are times: which rule decides it, and the seconds that follow."""

import logging
import re
from datetime import UTC, datetime, timedelta
from typing import NamedTuple

import numpy as np

from .. import checks

PER_SECOND = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}
SECONDS = {"min": 60, "h": 3600}
DURATIONS = {"s": "seconds", "ms": "milliseconds", "us": "microseconds", "min": "minutes", "h": "hours"}  # of timedelta
WORDS = {
    "s": ("s", "sec", "secs", "second", "seconds"),
    "ms": ("ms", "msec", "millisecond", "milliseconds", "millis"),
    "us": ("us", "µs", "μs", "usec", "microsecond", "microseconds", "micros"),
    "ns": ("ns", "nsec", "nanosecond", "nanoseconds", "nanos"),
    "min": ("min", "mins", "minute", "minutes"),
    "h": ("h", "hr", "hour", "hours"),
}
UNIT_OF = {word: unit for unit, words in WORDS.items() for word in words}
BRACKETS = re.compile(r"[\[(]\s*([^\])]+?)\s*[\])]\s*$")  # "t [us]", "time (ms)"
ENDING = re.compile(r"_([a-zµμ]+)$|(?<=[a-z])([UMN]S)$")  # "time_us", "TimeUS"
MOST_SECONDS = 50.0  # longer steps of a column without a unit may be milliseconds or microseconds
YEARS = (946_684_800, 4_102_444_800)  # [s] since 1970: 2000 to 2100
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
LATEST = 1e11  # [s] of a record: 3,000 years
RATES = (1e-4, 2e4)  # [Hz] of the records that a refusal proposes
log = logging.getLogger("estimable.data")


class Seconds(NamedTuple):
    """Times in seconds, the date of t = 0 if it is known, and the rule by which they were read."""

    t: np.ndarray
    origin: datetime | None
    rule: str


def known_unit(unit: str | None, faults: checks.Faults) -> str | None:
    """A given unit by its short name."""
    if unit is None:
        return None
    if isinstance(unit, str) and unit in UNIT_OF:
        return UNIT_OF[unit]
    faults.add(f"`time_unit` must be one of {checks.listed(WORDS)}. Got {checks.short(unit)}.")
    return None


def seconds_of(ticks: np.ndarray, label: str, name: str, unit: str | None, faults: checks.Faults) -> Seconds | None:
    """The seconds of numbers. `name`: of their column; `unit`: the given one, or None.

    A date counted since 1970 gives times since the first stamp, and the date as `origin`. Other times keep their zero.
    """
    unit, why = (unit, f"time_unit={unit!r}") if unit is not None else _unit_of(ticks, name)
    if unit is None:
        faults.add(_refusal(ticks, label))
        return None
    if not np.abs(_in_seconds(ticks, unit)).max(initial=0.0) < LATEST:
        faults.add(_too_late(ticks, label, unit, why))
        return None
    first = _in_seconds(ticks[:1], unit)[0]
    if YEARS[0] <= first < YEARS[1]:
        origin = EPOCH + _timedelta(ticks[0], unit)
        t = _in_seconds(ticks - ticks[0], unit)
        return Seconds(t, origin, f"{label} holds dates in {unit} since 1970 ({why}){_lasting(t)}")
    t = _in_seconds(ticks, unit)
    return Seconds(t, None, f"{label} is in {unit} ({why}){_lasting(t)}")


def _unit_of(ticks: np.ndarray, name: str) -> tuple[str | None, str]:
    """The unit and the rule that decided it: the name, a date since 1970, or short steps."""
    if (unit := unit_in_name(name)) is not None:
        return unit, "by its name"
    step = _step(ticks)
    for unit, per in PER_SECOND.items():
        if YEARS[0] <= ticks[0] / per < YEARS[1] and step / per <= MOST_SECONDS:
            return unit, f"its first stamp is then in the year {1970 + ticks[0] / per / 31_556_952:.0f}"
    if not step <= MOST_SECONDS:
        return None, ""
    if step >= 2 and np.all(ticks == np.round(ticks)):
        log.warning(
            "The time column %r steps by %g and names no unit: read as seconds, %s. If it is in ms or us, give time_unit.",
            name, step, _duration((ticks[-1] - ticks[0]) / 1.0),
        )  # fmt: skip
    return "s", f"its steps of {step:.4g} are at most {MOST_SECONDS:g}" if step else "it has one stamp"


def unit_in_name(name: str) -> str | None:
    """The unit that a column's name gives in brackets or as its ending.

    >>> [unit_in_name(name) for name in ("t [us]", "time (ms)", "stamp_ns", "TimeUS", "time_s", "status", "timestamp")]
    ['us', 'ms', 'ns', 'us', 's', None, None]
    """
    if (found := BRACKETS.search(name)) is not None:
        return UNIT_OF.get(found[1])
    if (found := ENDING.search(name)) is None:
        return None
    unit = UNIT_OF.get((found[1] or found[2]).lower())
    return unit if unit in PER_SECOND else None  # "t_min" may be a minimum


def _in_seconds(ticks: np.ndarray, unit: str) -> np.ndarray:
    return ticks * float(SECONDS[unit]) if unit in SECONDS else ticks / PER_SECOND[unit]


def _timedelta(tick: float, unit: str) -> timedelta:
    """Exact for an integer."""
    exact = int(tick) if tick == int(tick) else float(tick)
    if unit == "ns":
        return timedelta(microseconds=exact // 1000)
    return timedelta(
        **{{"s": "seconds", "ms": "milliseconds", "us": "microseconds", "min": "minutes", "h": "hours"}[unit]: exact}
    )


def _step(ticks: np.ndarray) -> float:
    """The median of the steps that are not zero."""
    steps = np.abs(np.diff(ticks))
    return float(np.median(steps[steps > 0])) if np.any(steps > 0) else 0.0


def _refusal(ticks: np.ndarray, label: str) -> str:
    """The question about a unit, with what each likely one would mean."""
    step = _step(ticks)
    likely = [unit for unit, per in PER_SECOND.items() if RATES[0] <= per / step <= RATES[1]][::-1] or list(PER_SECOND)
    *others, last = map(repr, likely)
    names = f"{', '.join(others)} or {last}" if others else last
    ways = ", ".join(f"with {unit!r} {_extent(ticks, unit)}" for unit in likely)
    return f"{label} steps by {step:.6g}: say time_unit={names} ({ways})."


def _too_late(ticks: np.ndarray, label: str, unit: str, why: str) -> str:
    later = np.abs(ticks).max()
    fits = [one for one, per in PER_SECOND.items() if YEARS[0] <= later / per < YEARS[1]]
    hint = f" Did you mean time_unit={fits[0]!r}?" if fits else ""
    return f"{label} holds numbers up to {later:.6g}, which is no time in {unit} ({why}).{hint}"


def _extent(ticks: np.ndarray, unit: str) -> str:
    t = _in_seconds(ticks - ticks[0], unit)
    return f"the record lasts {_duration(t[-1])} at {1 / _step(t):.4g} Hz"


def _lasting(t: np.ndarray) -> str:
    """The duration and the rate, in which a wrong unit shows."""
    step = _step(t)
    return f": {_duration(t[-1] - t[0])} at {1 / step:.4g} Hz." if step > 0 else "."


def _duration(seconds: float) -> str:
    """A duration in the unit in which it is read at sight."""
    for size, unit in ((86_400 * 3, "d"), (3600 * 3, "h"), (60 * 10, "min")):
        if abs(seconds) >= size:
            return f"{seconds / {'d': 86_400, 'h': 3600, 'min': 60}[unit]:.4g} {unit}"
    return f"{seconds:.4g} s"
