"""Samples of several rates on the rows of one record: outputs are placed in a row, inputs averaged over it.

PlacedRows are t_k = t_0 + k h. An output sample goes to the nearest row, every other row is NaN: an output that is interpolated
uses later samples and is smoother than its noise. An input that is held between its samples acts by its mean over the row.
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from .. import checks

GAP = 1.5  # a longer step than this times the median is a gap
PERIODIC = 0.1  # a step within this of the median belongs to a clock
FINEST = 0.1  # of the fastest output's step: a finer grid is nearly all NaN
PLACED = 0.3  # most placing error relative to the sensor noise, without a warning
log = logging.getLogger("estimable.data")


@dataclass(frozen=True, eq=False)
class Signal:
    """The samples of a channel: its name, its times (s) in order, and its values, NaN where nothing was logged."""

    name: str
    t: np.ndarray
    values: np.ndarray

    @property
    def known(self) -> "Signal":
        """The samples that hold a value."""
        missing = np.isnan(self.values)
        return self if not missing.any() else Signal(self.name, self.t[~missing], self.values[~missing])

    @cached_property
    def steps(self) -> np.ndarray:
        """The steps between samples."""
        return np.diff(self.t)

    @cached_property
    def step(self) -> float:
        """The median step; infinite for a single sample."""
        return float(np.median(self.steps)) if len(self.steps) else np.inf

    def reach(self, h: float, max_gap: float | None) -> float:
        """How long the last sample of an input holds: without `max_gap` to a gap of a clock, forever for events."""
        if max_gap is not None:
            return max_gap
        regular = len(self.steps) > 0 and np.mean(np.abs(self.steps - self.step) <= PERIODIC * self.step) >= 0.5
        return max(GAP * self.step, h) if regular else np.inf


class PlacedRows(NamedTuple):
    """The rows of a record, made from signals."""

    t: np.ndarray
    y: np.ndarray
    u: np.ndarray
    breaks: tuple[int, ...]
    placing: tuple[tuple[str, float], ...]
    notes: tuple[str, ...]


def on_one_grid(
    outputs: Sequence[Signal],
    inputs: Sequence[Signal],
    h: float,
    *,
    hold: str,
    max_gap: float | None,
    faults: checks.Faults,
) -> PlacedRows | None:
    """The rows of a grid of `h` seconds; None if something is at fault."""
    for one in (*outputs, *inputs):
        if not len(one.t):
            faults.add(f"channel {one.name!r} holds no value: leave it out.")
    if faults.sentences:
        return None
    t = _grid(outputs, h, faults)
    if t is None:
        return None
    placed = [_placed(one, t[0], h, len(t)) for one in outputs]
    y = np.stack([column for column, _, _ in placed], axis=1)
    u = _inputs(inputs, t, np.append(t, t[-1] + h), hold, max_gap)
    notes = [_placing_note(one, dropped, error) for one, (_, dropped, error) in zip(outputs, placed, strict=True)]
    rows = PlacedRows(
        t, y, u, (), tuple((one.name, error) for one, (_, _, error) in zip(outputs, placed, strict=True)), ()
    )
    first = f"The rows are a grid of {h:g} s: {len(t)} rows. Outputs are placed in the nearest row."
    return _finished(rows._replace(notes=(first, *notes)), inputs, hold, max_gap)


def on_given_rows(
    t: np.ndarray, outputs: Sequence[Signal], inputs: Sequence[Signal], *, hold: str, max_gap: float | None
) -> PlacedRows:
    """The rows are the times `t`, and every output has its stamps among them."""
    steps = np.diff(t)
    edges = np.append(t, t[-1] + (float(np.median(steps)) if len(steps) else 1.0))
    y = np.full((len(t), len(outputs)), np.nan)
    for i, one in enumerate(outputs):
        y[np.searchsorted(t, one.t), i] = one.values
    u = _inputs(inputs, t, edges, hold, max_gap)
    return _finished(PlacedRows(t, y, u, (), (), ()), inputs, hold, max_gap)


def _grid(outputs: Sequence[Signal], h: float, faults: checks.Faults) -> np.ndarray | None:
    """The rows from the first output sample to the last, through the first stamp of the output with most samples."""
    fastest = min(outputs, key=lambda one: one.step)
    if np.isfinite(fastest.step) and h < FINEST * fastest.step:
        faults.add(
            f"grid = {h:g} s is finer than a tenth of the step of {fastest.name!r}, {fastest.step:.6g} s, the fastest output: "
            f"give at least grid={FINEST * fastest.step:.6g}."
        )
        return None
    zero = max(outputs, key=lambda one: len(one.t)).t[0]
    before = round((zero - min(one.t[0] for one in outputs)) / h)
    after = round((max(one.t[-1] for one in outputs) - zero) / h)
    if before + after + 1 > checks.MOST_ROWS:
        faults.add(
            f"grid = {h:g} s gives {before + after + 1:,} rows, more than {checks.MOST_ROWS:,}: give a larger step."
        )
        return None
    return zero + h * np.arange(-before, after + 1)


def _placed(signal: Signal, t0: float, h: float, T: int) -> tuple[np.ndarray, int, float]:
    """The column (T,) of an output, the number of samples for which a nearer one had the row, and the rms placing error."""
    rows = np.rint((signal.t - t0) / h).astype(np.int64)
    offset = signal.t - (t0 + h * rows)
    again = np.diff(rows) == 0  # the row of the sample before
    if again.any():
        shared = np.flatnonzero(np.append(again, False) | np.append(False, again))
        shared = shared[np.lexsort((np.abs(offset[shared]), rows[shared]))]
        farther = shared[np.flatnonzero(np.diff(rows[shared], prepend=-1) == 0)]
        nearest = np.delete(np.arange(len(rows)), farther)
        rows, offset, signal = (
            rows[nearest],
            offset[nearest],
            Signal(signal.name, signal.t[nearest], signal.values[nearest]),
        )
    column = np.full(T, np.nan)
    column[rows] = signal.values
    return column, int(again.sum()), float(np.sqrt(np.mean(offset * offset)) * slope(signal))


def slope(signal: Signal) -> float:
    """The rms rate of change of a signal in noise.

    Successive differences d_j of a slope s over steps of h have E d_j² = s² h² + 2 σ² and E d_j d_{j+1} = s² h² - σ², so that
    (E d_j² + 2 E d_j d_{j+1}) / 3 = s² h²: white noise adds nothing.
    """
    d = np.diff(signal.values)
    if len(d) < 2:
        return 0.0
    usual = signal.steps <= GAP * signal.step
    both = usual[:-1] & usual[1:]
    if not both.any():
        return 0.0
    square = np.mean(d[usual] ** 2) + 2 * np.mean((d[:-1] * d[1:])[both])
    return float(np.sqrt(max(square, 0.0) / 3) / signal.step)


def _placing_note(signal: Signal, dropped: int, error: float) -> str:
    more = f", {checks.counted(dropped, 'sample')} left out where a nearer one had the row" if dropped else ""
    return f"{signal.name}: {checks.counted(len(signal.t), 'sample')}{more}; placing moves it by {error:.3g} (rms)."


def _inputs(inputs: Sequence[Signal], t: np.ndarray, edges: np.ndarray, hold: str, max_gap: float | None) -> np.ndarray:
    h = float(np.median(np.diff(edges)))
    columns = [(_held if hold == "zero_order" else _linear)(one, edges, one.reach(h, max_gap)) for one in inputs]
    return np.stack(columns, axis=1) if columns else np.zeros((len(t), 0))


def _held(signal: Signal, edges: np.ndarray, reach: float) -> np.ndarray:
    """The mean between edges of an input that holds its last sample for at most `reach`; NaN where part of a row is unknown."""
    s, v = signal.t, signal.values
    last = max(edges[-1] - s[-1], 0.0)
    lasting = np.minimum(np.append(signal.steps, last), reach)
    integral, seconds = (np.append(0.0, np.cumsum(held)) for held in (v * lasting, lasting))
    sample = np.searchsorted(s, edges, side="right") - 1
    at = np.maximum(sample, 0)
    since, value = edges - s[at], v[at]
    part = np.where(sample < 0, 0.0, np.minimum(since, lasting[at]))
    whole, known = np.diff(integral[at] + value * part), np.diff(seconds[at] + part)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(known >= (1 - 1e-9) * np.diff(edges), whole / known, np.nan)
    alone = sample[1:] - (since[1:] == 0) == sample[:-1]  # one sample acts over the whole row
    return np.where(alone & ~np.isnan(mean), value[:-1], mean)


def _linear(signal: Signal, edges: np.ndarray, reach: float) -> np.ndarray:
    """The input at the start of each row, linear between its samples; of a faster one the mean over the row about it."""
    s, v, t, h = signal.t, signal.values, edges[:-1], np.diff(edges)
    later = np.minimum(np.searchsorted(s, t, side="right"), len(s) - 1)
    unknown = (
        (t < s[0] - 1e-9 * h)
        | (t > s[-1] + reach)
        | ((s[later] - s[later - 1] > reach) & (t > s[later - 1]) & (t < s[-1]))
    )
    if signal.step < np.median(h):
        integral = np.concatenate([[0.0], np.cumsum(np.diff(s) * (v[:-1] + v[1:]) / 2)])
        ends = [np.clip(t + side * h / 2, s[0], s[-1]) for side in (-1, 1)]
        sums = [_integral(one, s, v, integral) for one in ends]
        width = ends[1] - ends[0]
        value = np.where(width > 0, (sums[1] - sums[0]) / np.where(width > 0, width, 1.0), np.interp(t, s, v))
    else:
        value = np.interp(t, s, v)
    return np.where(unknown, np.nan, value)


def _integral(t: np.ndarray, s: np.ndarray, v: np.ndarray, integral: np.ndarray) -> np.ndarray:
    """The integral up to t of the broken line through (s, v)."""
    j = np.clip(np.searchsorted(s, t, side="right") - 1, 0, len(s) - 1)
    return integral[j] + (t - s[j]) * (v[j] + np.interp(t, s, v)) / 2


def _finished(rows: PlacedRows, inputs: Sequence[Signal], hold: str, max_gap: float | None) -> PlacedRows:
    """The rows from the first at which every input is known, with their breaks and the rest of the notes."""
    known = ~np.isnan(rows.u).any(axis=1)
    first = int(np.argmax(known)) if known.any() else 0
    notes = list(rows.notes)
    if first:
        notes.append(f"The first {checks.counted(first, 'row')} are left out: no input was logged yet.")
    if inputs:
        notes.append(
            "Inputs are the mean over the row." if hold == "zero_order" else "Inputs are linear between samples."
        )
    h = float(np.median(np.diff(rows.t))) if len(rows.t) > 1 else np.inf
    for one in inputs:
        if 2 * h < one.step < np.inf and hold == "zero_order":
            sentence = (
                f"{one.name} is logged every {one.step:.3g} s, {one.step / h:.3g} rows: what it was between is unknown."
            )
            log.warning(sentence)
            notes.append(sentence)
    breaks = () if max_gap is None else _breaks(rows, max_gap)
    rows = PlacedRows(
        rows.t[first:], rows.y[first:], rows.u[first:], tuple(k - first for k in breaks if k > first), rows.placing, ()
    )
    if rows.breaks:
        notes.append(f"{checks.counted(len(rows.breaks), 'gap')} longer than {max_gap:g} s: nothing connects across.")
    return rows._replace(notes=tuple(notes))


def _breaks(rows: PlacedRows, max_gap: float) -> list[int]:
    """The first row after each stretch in which an input was unknown, or no output was seen for longer than `max_gap`."""
    unknown = np.asarray(np.isnan(rows.u).any(axis=1))
    back = np.flatnonzero(unknown[:-1] & ~unknown[1:]) + 1
    seen = rows.t[~np.isnan(rows.y).all(axis=1)]
    silent = np.flatnonzero(np.diff(seen) > max_gap) + 1
    return sorted({int(k) for k in back} | {int(k) for k in np.searchsorted(rows.t, seen[silent])})


def placing_warnings(placing: Sequence[tuple[str, float]], noise: dict[str, Any]) -> list[str]:
    """A sentence for each output that placing moved by more than `PLACED` of its noise (standard deviations by name)."""
    return [
        f"placing {name!r} on the grid moved it by {error:.3g} (rms), more than {PLACED:g} of its noise, {noise[name]:.3g}: "
        "give a finer grid, or count it in R."
        for name, error in placing
        if name in noise and error > PLACED * noise[name]
    ]
