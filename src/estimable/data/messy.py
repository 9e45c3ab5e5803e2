"""Measurements as recorders leave them: masks, None, several rows at one instant, and values that no sensor gives."""

import logging
from typing import Any

import numpy as np
from jax.core import Tracer

from .. import checks
from ..annotations import Numbers

WILD = 1e150  # larger values overflow when they are squared
log = logging.getLogger("estimable.data")


def measured(value: Numbers) -> Numbers:
    """Measurements with NaN for what is masked, None or pandas' NA; anything else unchanged."""
    if isinstance(value, Tracer):
        return value
    if isinstance(value, np.ma.MaskedArray):
        known = np.ma.getdata(value)
        numbers = known.astype(float) if known.dtype.kind in "fiub" else known
        return np.where(np.ma.getmaskarray(value), np.nan, numbers) if numbers.dtype.kind == "f" else value
    try:
        array = np.asarray(value)
        if array.dtype.kind != "O":
            return value
        entries = [np.nan if _is_missing(entry) else entry for entry in array.ravel()]
        numbers = np.asarray(entries)
    except (TypeError, ValueError):
        return value
    return numbers.astype(float).reshape(array.shape) if numbers.dtype.kind in "fiu" else value


def _is_missing(entry: Any) -> bool:
    return entry is None or type(entry).__name__ in ("NAType", "NaTType")


def without_wild(y: np.ndarray, names: tuple[str, ...]) -> np.ndarray:
    """Outputs with NaN for values that overflow when they are squared; the first one is logged."""
    wild = np.abs(y) > WILD
    if not wild.any():
        return y
    name_wild(y, wild, names)
    return np.where(wild, np.nan, y)


def name_wild(y: np.ndarray, wild: np.ndarray, names: tuple[str, ...], first: int = 0) -> None:
    """Log the first wild value of `y`, whose first row is row `first` of the record, and the number of the others."""
    *run, row, channel = np.argwhere(wild)[0]
    more = int(wild.sum()) - 1
    log.warning(
        "y[%d] of %r%s is %g, too large for a filter: it counts as missing%s.",
        first + row, names[channel], f" in run {run[0]}" if run else "", y[(*run, row, channel)],
        f", and {checks.counted(more, 'more value')} too" if more else "",
    )  # fmt: skip


def one_row_an_instant(
    t: np.ndarray,
    channels: dict[str, np.ndarray | None],
    names: dict[str, tuple[str, ...]],
    faults: checks.Faults,
    repeated: str | None = None,
) -> tuple[np.ndarray, dict[str, np.ndarray | None]]:
    """Times and channels (T, ..) with the rows of one instant merged; a value replaces NaN.

    Of two values of one channel at one instant the one that `repeated` names counts, "first" or "last". Without it they are a
    fault, unless they are equal inputs.
    """
    first = np.concatenate([[True], np.diff(t) > 0])
    if first.all():
        return t, channels
    instant, starts = np.cumsum(first) - 1, np.flatnonzero(first)
    merged: dict[str, np.ndarray | None] = {}
    for name, values in channels.items():
        if values is None:
            merged[name] = None
            continue
        known = ~np.isnan(values)
        if repeated is not None:
            merged[name] = _of_instants(values, known, starts, repeated)
            continue
        count = np.add.reduceat(known, starts, axis=0, dtype=int)
        value = np.maximum.reduceat(np.where(known, values, -np.inf), starts, axis=0)
        twice = known & (count[instant] > 1) & ((name == "y") | (values != value[instant]))
        if twice.any():
            row, channel = np.argwhere(twice)[0]
            which = names[name][channel] if names[name] else str(channel)
            faults.add(
                f"two rows have the time {t[row]:.12g} s, and both have a value of {which!r}. Rows at one instant are merged "
                "into one row only if each channel has one value there: drop one of them, take their mean, or read the file with "
                "repeated='first' or 'last'."
            )
        merged[name] = np.where(count > 0, value, np.nan)
    several = np.flatnonzero(np.diff(np.append(starts, len(t))) > 1)
    log.warning(
        "%s with several rows, the first at t = %.12g s: each is merged into one row.",
        checks.counted(len(several), "instant"), t[starts[several[0]]],
    )  # fmt: skip
    return t[starts], merged


def _of_instants(values: np.ndarray, known: np.ndarray, starts: np.ndarray, repeated: str) -> np.ndarray:
    """The first or the last known value of each instant; NaN where there is none."""
    T = len(values)
    rows = np.where(known, np.arange(T)[:, None], T if repeated == "first" else -1)
    row = (np.minimum if repeated == "first" else np.maximum).reduceat(rows, starts, axis=0)
    return np.where((row >= 0) & (row < T), np.take_along_axis(values, np.clip(row, 0, T - 1), axis=0), np.nan)
