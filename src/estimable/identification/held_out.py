"""The rows on which methods are judged: the rest of each record, or whole other records; and whether the rest is alike."""

from collections.abc import Sequence

import numpy as np

from .. import checks
from ..data.record import Record
from ..data.trends import Trend
from ..results.comparisons import Divided

LEVELS = {"mean": 0, "trend": 1, "none": None}
BEGIN, LEAST = 0.1, 20  # share of a whole record, and least rows, from which its first state is found
BANDS = 24  # of equal ratio in frequency, in which the inputs of two parts are compared
THIN = 0.05  # of the density of the judged part, below which a frequency was hardly fitted


def divided(records: Sequence[Record], split: float, level: str) -> Divided:
    """The records without their levels, the first part of each, and the row from which each is judged."""
    faults = checks.Faults()
    faults.choice("level", level, tuple(LEVELS))
    faults.finish()
    parts = [one.split(split)[0] if split < 1 else one for one in records]
    trend = _trend(parts, level)
    deviations, rows = [trend.taken_from(one) for one in records], [len(part) for part in parts]
    return Divided(records, deviations, [one[:n] for one, n in zip(deviations, rows, strict=True)], trend, tuple(rows))


def with_held_out(records: Sequence[Record], held_out: Sequence[Record], level: str) -> Divided:
    """Whole records to fit, and whole others to judge on, each without its own level.

    The first tenth of a judged record gives its state, and is not judged.
    """
    trend = _trend(records, level)
    whole = [_trend([one], level).taken_from(one) for one in held_out]
    rows = tuple(min(max(round(BEGIN * len(one)), LEAST), len(one) // 2) for one in held_out)
    return Divided(held_out, whole, [trend.taken_from(one) for one in records], trend, rows)


def with_levels(task: Divided) -> Divided:
    """The same with the levels in the records, for a method that estimates them: the mean of a part is no level of a plant that
    integrates, or starts far from rest. Trends, and the own levels of held-out records, stay subtracted."""
    same = [len(one) for one in task.first] == list(task.rows)
    if not same or any(np.any(line[1]) for line in task.trend):
        return task
    first = [one[:n] for one, n in zip(task.records, task.rows, strict=True)]
    return Divided(task.records, list(task.records), first, Trend.none(first[0]), task.rows)


def _trend(records: Sequence[Record], level: str) -> Trend:
    degree = LEVELS[level]
    return Trend.none(records[0]) if degree is None else Trend.of(records, degree)


def not_fitted(task: Divided) -> float:
    """The share of the energy of the judged inputs at frequencies that the fitted parts hardly contain."""
    fitted = [one.applied() for one in task.first]
    judged = [one.applied()[n:] for one, n in zip(task.whole, task.rows, strict=True)]
    if not fitted[0].shape[1]:
        return 0.0
    shares = []
    for j in range(fitted[0].shape[1]):
        energy, other = (_energy([one[:, j] for one in part]) for part in (judged, fitted))
        if energy.sum() > 0:
            shares.append(float(energy[other < THIN * energy].sum() / energy.sum()))
    return max(shares, default=0.0)


def _energy(signals: Sequence[np.ndarray]) -> np.ndarray:
    """The energy of signals (T,) in each band of frequency, per row; unknown values count as zero."""
    edges, total = np.geomspace(1 / 400, 0.5, BANDS), np.zeros(BANDS)
    for u in signals:
        x = np.nan_to_num(u - np.nanmean(u)) * np.hanning(len(u)) if len(u) > 1 else np.zeros(1)
        bands = np.searchsorted(edges, np.fft.rfftfreq(len(x)), side="right").clip(0, BANDS - 1)
        total += np.bincount(bands, np.abs(np.fft.rfft(x)) ** 2, BANDS) / len(x)
    return total / sum(map(len, signals))
