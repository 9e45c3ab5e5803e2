"""Numbers that a recorder writes where it measured nothing."""

import numpy as np

from .. import checks

MARKS = (-999.0, -9999.0, -99999.0, -32768.0, 9999.0, 99999.0, 1e20, 1e30)  # the usual ones
FAR = 10.0  # a mark lies beyond so many times the largest other number


def without_na(column: np.ndarray, name: str, na_values: np.ndarray | None, faults: checks.Faults) -> np.ndarray:
    """The column with NaN in the place of `na_values`; where those are None, a usual mark among them is a fault."""
    if na_values is not None:
        return np.where(np.isin(column, na_values), np.nan, column)
    others = column[~np.isnan(column) & ~np.isin(column, MARKS)]
    for mark in MARKS:
        rows = np.flatnonzero(column == mark)
        if len(rows) and len(others) and abs(mark) > FAR * np.abs(others).max():
            more = f" and {checks.counted(len(rows) - 1, 'more row')}" if len(rows) > 1 else ""
            faults.add(
                f"column {name!r} holds {mark:g} in row {rows[0] + 1} below the header{more}, and else "
                f"{others.min():.4g} to {others.max():.4g}. Where it stands for what was not measured, say "
                f"na_values=[{mark:g}] (--na {mark:g}); where it was measured, na_values=[]."
            )
    return column
