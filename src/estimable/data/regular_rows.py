"""Stamps that are multiples of one step, and rows that are missing between them."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from .. import checks
from .one_grid import Signal, slope

NEAR = 0.1  # of a step: farther from a multiple no stamp is
MOST = 100  # times the rows of a record: longer gaps than these have no rows


class Multiples(NamedTuple):
    """The row of each stamp, the step, the time of row 0, and the deviations of the stamps from their rows."""

    rows: np.ndarray
    dt: float
    zero: float
    deviation: np.ndarray


def multiples_of(t: np.ndarray, dt: float | None, faults: checks.Faults) -> Multiples | None:
    """The rows of increasing stamps on a grid; None if they are not multiples of one step."""
    steps = np.diff(t)
    if not len(steps):
        return Multiples(np.zeros(len(t), int), 1.0 if dt is None else dt, float(t[0]), np.zeros(len(t)))
    step = float(np.quantile(steps, 0.5, method="lower")) if dt is None else dt
    rows = np.concatenate([[0], np.cumsum(np.rint(steps / step).astype(np.int64))])
    if dt is None and rows[-1] > 0:
        step = float(f"{np.polyfit(rows, t - t[0], 1)[0]:.9g}")  # a median holds the rounding of one stamp
    zero = float(t[0] + np.median(t - t[0] - rows * step))
    deviation = t - (zero + rows * step)
    if np.abs(deviation).max() > NEAR * step:
        nearest = np.abs(t - zero - np.rint((t - zero) / step) * step)
        worst = int(np.argmax(nearest))
        faults.add(
            f"the stamps are no multiples of one step: that of row {worst}, {t[worst]:.9g} s, is {nearest[worst]:.3g} s "
            f"from a multiple of {step:.6g} s, more than {NEAR:g} of a step. Give on_grid(dt) another step, or read the log with "
            "grid=."
        )
        return None
    if np.any(again := np.diff(rows) == 0):
        k = int(np.argmax(again))
        at = zero + rows[k] * step
        faults.add(f"rows {k} and {k + 1} are both at {at:.6g} s on the grid of {step:.6g} s: give a smaller dt.")
        return None
    if rows[-1] + 1 > MOST * len(t):
        k = int(np.argmax(steps))
        faults.add(
            f"between rows {k} and {k + 1} {steps[k]:.6g} s are missing, and the grid of {step:.6g} s would have "
            f"{rows[-1] + 1:,} rows: cut the record there."
        )
        return None
    return Multiples(rows, step, zero, deviation)


def regular_rows(fields: Mapping[str, Any], found: Multiples | None) -> dict[str, Any]:
    """The fields of a record that are those of the grid, from its own."""
    assert found is not None
    t, y, u, arrived, sigma = (fields[name] for name in ("t", "y", "u", "arrived", "sigma"))
    rows, T = found.rows, int(found.rows[-1]) + 1
    u = filled(u, rows, agreeing=True)
    scatter = float(np.std(found.deviation))
    moved = {
        name: scatter * slope(Signal(name, t, column).known)
        for name, column in zip(fields["outputs"], y.T, strict=True)
        if (~np.isnan(column)).sum() > 2
    }
    missing, unknown = T - len(rows), int(np.isnan(u).any(axis=1).sum())
    note = (
        f"Rows on a grid of {found.dt:.6g} s: {missing} of {T} are missing, and the input is unknown in {unknown}; the stamps "
        f"scatter by {scatter / found.dt:.2g} of a step."
    )
    return {
        "y": filled(y, rows, agreeing=False), "u": u, "t": found.zero + found.dt * np.arange(T), "dt": found.dt,
        "arrived": None if arrived is None else filled(arrived, rows, agreeing=False), "grid": found.dt,
        "sigma": None if sigma is None else filled(sigma, rows, agreeing=False),
        "placing": tuple(sorted(moved.items())), "breaks": tuple(int(rows[k]) for k in fields["breaks"]),
        "notes": (*fields["notes"], note),
    }  # fmt: skip


def filled(values: np.ndarray, rows: np.ndarray, agreeing: bool) -> np.ndarray:
    """Values (T, m) on all rows; a missing row is NaN, or with `agreeing` the value of its neighbours where they agree."""
    T = int(rows[-1]) + 1
    out = np.full((T, values.shape[1]), np.nan)
    out[rows] = values
    if agreeing:
        before = np.searchsorted(rows, np.arange(T), side="right") - 1
        after = np.minimum(np.searchsorted(rows, np.arange(T)), len(rows) - 1)
        same = values[before] == values[after]
        missing = np.ones(T, bool)
        missing[rows] = False
        out = np.where(missing[:, None] & same, values[before], out)
    return out
