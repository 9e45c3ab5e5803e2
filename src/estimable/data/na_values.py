"""Numbers that a recorder writes for missing values."""

import numpy as np

from .. import checks

MARKS = (-999.0, -9999.0, -99999.0, -32768.0, 9999.0, 99999.0, 1e20, 1e30)  # the common markers
FAR = 10.0  # a marker is larger than this factor times the largest other number


def without_na(column: np.ndarray, name: str, na_values: np.ndarray | None, faults: checks.Faults) -> np.ndarray:
    """The column with NaN instead of `na_values`; if those are None, a common marker in the column is a fault."""
    if na_values is not None:
        return np.where(np.isin(column, na_values), np.nan, column)
    others = column[~np.isnan(column) & ~np.isin(column, MARKS)]
    for mark in MARKS:
        rows = np.flatnonzero(column == mark)
        if len(rows) and len(others) and abs(mark) > FAR * np.abs(others).max():
            more = f" and {checks.counted(len(rows) - 1, 'more row')}" if len(rows) > 1 else ""
            faults.add(
                f"column {name!r} holds {mark:g} in row {rows[0] + 1} below the header{more}; its other values are "
                f"{others.min():.4g} to {others.max():.4g}. If {mark:g} marks missing values, give "
                f"na_values=[{mark:g}] (--na {mark:g}). If it was measured, give na_values=[]."
            )
    return column
