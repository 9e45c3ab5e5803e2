"""The arguments of a record, read and checked one by one."""

from collections.abc import Mapping, Sequence
from datetime import datetime
from types import UnionType
from typing import Any, TypeAlias

import numpy as np
from jax.core import Tracer

from .. import checks
from ..annotations import Numbers
from .stamps import REMEDY

Texts: TypeAlias = Mapping[str, str] | Sequence[tuple[str, str]]  # {channel: text}
Numeric: TypeAlias = Mapping[str, float] | Sequence[tuple[str, float]]  # {channel: number}
UNIFORM = 1e-6  # largest relative scatter of regular time steps: the rounding of a file


def column(value: Numbers) -> Numbers:
    """A 1-D array of numbers as one channel."""
    if isinstance(value, Tracer):
        return value[:, None] if value.ndim == 1 else value
    try:
        array = np.asarray(value)
    except ValueError:
        return value
    return array[:, None] if array.ndim == 1 and array.dtype.kind in "fiub" else value


def texts_of(name: str, example: str, texts: Texts, channels: tuple[str, ...], faults: checks.Faults):
    """(channel, text) of each channel that has a text, in the order of the names."""
    pairs = _pairs_of(texts, str)
    if pairs is None:
        faults.add(f"`{name}` must be a mapping of names to {name}, as in {example}. Got {checks.short(texts)}.")
        return ()
    faults.printable(name, (text for _, text in pairs))
    return _of_channels(name, pairs, channels, faults)


def numbers_of(name: str, numbers: Numeric, channels: tuple[str, ...], faults: checks.Faults):
    """(channel, number) of each channel that has a number, in the order of the names."""
    pairs = _pairs_of(numbers, int | float)
    if pairs is None:
        faults.add(
            f"`{name}` must be a mapping of names to numbers, as in {{'speed': 0.1}}. Got {checks.short(numbers)}."
        )
        return ()
    return _of_channels(name, pairs, channels, faults)


def _pairs_of(given: Texts | Numeric, kind: type | UnionType) -> tuple[tuple[str, Any], ...] | None:
    """A mapping, or a tuple of pairs, as pairs; None where it is something else."""
    pairs: Any = tuple(given.items()) if isinstance(given, Mapping) else given
    good = isinstance(pairs, tuple) and all(
        isinstance(pair, tuple) and len(pair) == 2 and isinstance(pair[0], str) and isinstance(pair[1], kind)
        for pair in pairs
    )
    return pairs if good else None


def _of_channels(name: str, pairs: tuple, channels: tuple[str, ...], faults: checks.Faults) -> tuple:
    """The pairs in the order of the names, all of which must be channels."""
    unknown = [channel for channel, _ in pairs if channel not in channels]
    if unknown:
        near = checks.suggestion(unknown[0], channels)
        faults.add(f"`{name}` names channels that the record does not have: {checks.listed(unknown)}.{near}")
    return tuple(sorted(pairs))


def notes_of(notes: Sequence[str], faults: checks.Faults) -> tuple[str, ...]:
    """Sentences about how a record was read."""
    if not isinstance(notes, list | tuple) or not all(isinstance(note, str) for note in notes):
        faults.add(f"`notes` must be a list of sentences. Got {checks.short(notes)}.")
        return ()
    return tuple(notes)


def origin_of(origin: datetime | None, faults: checks.Faults) -> datetime | None:
    """The date of t = 0 as a `datetime`; a `pandas.Timestamp` is one."""
    if origin is None or isinstance(origin, datetime):
        plain = getattr(origin, "to_pydatetime", None)
        return origin if plain is None else plain(warn=False)
    faults.add(
        f"`origin` must be the date of t = 0, as in datetime(2026, 1, 31, 12, tzinfo=timezone.utc). Got {checks.short(origin)}."
    )
    return None


def breaks_of(breaks: Sequence[int], rows: int, faults: checks.Faults) -> tuple[int, ...]:
    """Rows before which nothing connects, each once, in order."""
    given = breaks.tolist() if isinstance(breaks, np.ndarray) else breaks
    if not isinstance(given, list | tuple) or not all(
        isinstance(row, int | np.integer) and not isinstance(row, bool) for row in given
    ):
        faults.add(f"`breaks` must be a list of rows, as in [120, 455]. Got {checks.short(breaks)}.")
        return ()
    wrong = [row for row in given if not 0 < row < rows]
    if wrong and rows:
        faults.add(f"`breaks` must be rows after the first and before the end, 1 to {rows - 1}. Got {wrong[0]}.")
        return ()
    return tuple(sorted({int(row) for row in given}))


def arrived_of(arrived: Numbers, hold: str, faults: checks.Faults) -> np.ndarray | None:
    """Which inputs were applied."""
    if faults.sizes.get("m") == 0:
        faults.add("`arrived` marks which inputs were applied, but the record has no input: give `u`.")
        return None
    read = faults.array("arrived", column(arrived), "T m", nan=True)
    if read is not None and not np.all(np.isnan(read) | (read == 0) | (read == 1)):
        faults.add("`arrived` must be 1 (applied), 0 (lost) or NaN (unknown).")
    if isinstance(hold, str) and hold == "first_order":
        faults.add('`arrived` needs hold = "zero_order": an input that arrives in packets is constant between them.')
    return read


def sigma_of(sigma: Numbers, faults: checks.Faults) -> np.ndarray | None:
    """The standard deviations of the noise, (T, p)."""
    found = faults.array("sigma", column(sigma), "T p", nan=True)
    if found is not None and np.any(found < 0):
        row, channel = np.argwhere(found < 0)[0]
        faults.add(
            f"`sigma` must be standard deviations, at least 0. Row {row}, column {channel} is {found[row, channel]:g}."
        )
    return found


def times_of(t: Numbers | None, rows: int, faults: checks.Faults) -> np.ndarray | None:
    """The times, which never go back; None if the record has none, or they are at fault."""
    if t is None:
        return None
    faults.learn("T", rows, f"`y` has {rows} rows")
    if getattr(getattr(t, "dtype", None), "kind", "f") in "mM":
        faults.add("`t` must be seconds, not dates. Did you mean `(t - t[0]) / np.timedelta64(1, 's')`?")
        return None
    times = faults.array("t", t, "T")
    if times is None or rows == 0:
        return None
    if np.any(back := np.diff(times) < 0):
        k = int(np.argmax(back))
        before, after = float(times[k]), float(times[k + 1])
        faults.add(f"`t` must increase. From t[{k}] to t[{k + 1}] it goes from {before} to {after} s: {REMEDY}.")
        return None
    return times


def step_of(
    dt: float | None, times: np.ndarray | None, rows: int, faults: checks.Faults
) -> tuple[float | None, np.ndarray | None]:
    """The regular step (None if there is none) and the times (None if the record has none)."""
    if times is None:
        return dt, None if dt is None else np.arange(rows) * dt
    if rows == 1:
        return dt, times
    mean, regular = float((times[-1] - times[0]) / (rows - 1)), regular_step(times)
    if dt is not None and (regular is None or abs(dt - mean) > scatter(times, mean)):
        scattered = ", not regular" if regular is None else ""
        faults.add(f"`dt` = {dt:g} s and `t` disagree: the mean step of `t` is {mean:g} s{scattered}. Give one.")
    return regular, times


def regular_step(t: np.ndarray) -> float | None:
    """The step of regular times; None if they are not regular, or there is only one."""
    if len(t) == 1:
        return None
    mean = float((t[-1] - t[0]) / (len(t) - 1))
    return float(f"{mean:.12g}") if np.all(np.abs(np.diff(t) - mean) <= scatter(t, mean)) else None


def scatter(t: np.ndarray, step: float) -> float:
    """The largest deviation from `step` by rounding: that of a file, and that of large times in float64."""
    return UNIFORM * step + 4 * np.finfo(float).eps * np.abs(t).max()
