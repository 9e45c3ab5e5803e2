"""Named columns of a table as channels."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import checks
from ..annotations import Numbers
from .na_values import without_na

if TYPE_CHECKING:
    import pandas as pd

LATEST = 1e11  # [s] of a record: 3,000 years
EPOCHS = ((1e17, "nanoseconds", "ns"), (1e14, "microseconds", "us"), (LATEST, "milliseconds", "ms"))
REMEDY = "sort the rows by time"


def channels_of(
    frame: "pd.DataFrame",
    *,
    outputs: Sequence[str],
    inputs: Sequence[str],
    time: str | None,
    dt: float | None,
    arrived: str | Sequence[str] | None,
    na_values: Numbers | None,
) -> dict[str, Any]:
    """The arguments `y`, `u`, `t`, `arrived`, `outputs` and `inputs` of a `Record`, from named columns.

    Raises `InputError` with all columns that are missing or hold anything but numbers.
    """
    import pandas as pd

    if not isinstance(frame, pd.DataFrame):
        checks.refuse(f"`frame` must be a pandas DataFrame. Got {type(frame).__name__}.")
    faults = checks.Faults()
    outputs, inputs = faults.names("outputs", outputs, "", ""), faults.names("inputs", inputs, "", "")
    if not outputs and not faults.sentences:
        faults.add("`outputs` must name at least one column.")
    arrivals = faults.names("arrived", [arrived] if isinstance(arrived, str) else arrived, "", "")
    if arrivals and len(arrivals) not in (1, len(inputs)):
        given = checks.listed(arrivals)
        faults.add(f"`arrived` must name one column for all inputs, or one for each of the {len(inputs)}. Got {given}.")
    columns = {name: _numbers(frame, name, faults) for name in dict.fromkeys([*outputs, *inputs, *arrivals])}
    if len(frame) == 0:
        faults.add("there is no row below the header.")
    marks = None if na_values is None else faults.array("na_values", np.atleast_1d(na_values), "marks")
    t = _time(frame, time, dt, outputs, faults)
    faults.finish()
    columns |= {name: without_na(np.asarray(columns[name]), name, marks, faults) for name in (*outputs, *inputs)}
    faults.finish()

    def together(names: Sequence[str]) -> np.ndarray:
        return np.stack([np.asarray(columns[name]) for name in names], axis=1) if names else np.zeros((len(frame), 0))

    repeated = arrivals * len(inputs) if len(arrivals) == 1 else arrivals
    return {
        "y": together(outputs), "u": together(inputs), "t": t, "outputs": outputs, "inputs": inputs,
        "arrived": together(repeated) if arrivals else None,
    }  # fmt: skip


def _column(frame: "pd.DataFrame", name: str, faults: checks.Faults) -> "pd.Series | None":
    """The column with a name, or None."""
    import pandas as pd

    if name not in frame.columns:
        columns = [str(column) for column in frame.columns]
        near = checks.suggestion(name, columns)
        faults.add(f"there is no column {name!r}. The columns are {checks.listed(columns)}.{near}")
        return None
    column = frame[name]
    if not isinstance(column, pd.Series):
        faults.add(f"there is more than one column {name!r}.")
        return None
    return column


def _numbers(frame: "pd.DataFrame", name: str, faults: checks.Faults) -> np.ndarray | None:
    """A column as float64; empty cells are NaN."""
    column = _column(frame, name, faults)
    return None if column is None else _as_numbers(column, f"column {name!r}", "numbers", faults)


def _as_numbers(column: "pd.Series", label: str, wanted: str, faults: checks.Faults) -> np.ndarray | None:
    import pandas as pd

    if getattr(column.dtype, "kind", "O") in "mMc" or isinstance(column.dtype, pd.PeriodDtype):
        faults.add(f"{label} must hold {wanted}. It holds {column.dtype}.")
        return None
    try:
        numbers = pd.Series(pd.to_numeric(column, errors="coerce")).astype(float).to_numpy()
    except (OverflowError, TypeError, ValueError) as error:
        faults.add(f"{label} must hold {wanted}: {error}.")
        return None
    wrong = np.isnan(numbers) & column.notna().to_numpy()
    if wrong.any():
        row = int(np.argmax(wrong))
        held = checks.short(column.iloc[row])
        faults.add(f"{label} must hold {wanted}. Row {row + 1} below the header holds {held}.")
        return None
    if np.isinf(numbers).any():
        faults.add(f"{label} must be finite. Row {int(np.argmax(np.isinf(numbers))) + 1} below the header is not.")
        return None
    return numbers


def _time(
    frame: "pd.DataFrame", time: str | None, dt: float | None, outputs: tuple[str, ...], faults: checks.Faults
) -> np.ndarray | None:
    """Seconds from a column, or from the index; None where `dt` counts, or something is at fault."""
    import pandas as pd

    index = frame.index
    if time is None:
        timed = isinstance(index, pd.DatetimeIndex | pd.TimedeltaIndex | pd.PeriodIndex) or index.name == "time"
        return _seconds(index.to_series(), "the index", faults) if timed and dt is None else None
    if not isinstance(time, str):
        faults.add(f"`time` must be the name of one column. Got {checks.short(time)}.")
        return None
    if time in outputs:
        faults.add(f"`time` names {time!r}, which is an output too.")
        return None
    if time == index.name and time not in frame.columns:
        return _seconds(index.to_series(), "the index", faults)
    column = _column(frame, time, faults)
    return None if column is None else _seconds(column, f"the time column {time!r}", faults)


def _seconds(column: "pd.Series", label: str, faults: checks.Faults) -> np.ndarray | None:
    """Timestamps as seconds after the first; durations and numbers unchanged."""
    import pandas as pd

    if len(column) == 0:
        return None
    if column.isna().any():
        faults.add(f"{label} must not be empty or NaN. Row {int(np.argmax(column.isna())) + 1} below the header is.")
        return None
    if isinstance(column.dtype, pd.PeriodDtype):
        column = column.dt.to_timestamp()
    if column.dtype.kind not in "mMfiub":
        stamps = pd.to_datetime(column, format="ISO8601", utc=True, errors="coerce")
        column = stamps if stamps.notna().all() else column
    if column.dtype.kind in "mM":
        since = column - column.iloc[0] if column.dtype.kind == "M" else column
        t = since.dt.total_seconds().to_numpy(float)
    else:
        t = _as_numbers(column, label, "seconds, or timestamps like 2026-01-31 12:00:00.5", faults)
        if t is not None and np.abs(t).max() > LATEST:
            word, unit = next((word, unit) for size, word, unit in EPOCHS if np.abs(t).max() > size)
            faults.add(
                f"{label} must hold seconds. It holds numbers up to {np.abs(t).max():.6g}, which are {word} since 1970, "
                f"probably: convert the column by pd.to_datetime(column, unit={unit!r})."
            )
            return None
    if t is not None and np.any(back := np.diff(t) < 0):
        row = int(np.argmax(back)) + 1
        faults.add(
            f"{label} must increase. From row {row} to row {row + 1} below the header it goes from {float(t[row - 1])} "
            f"to {float(t[row])} s: {REMEDY}."
        )
        return None
    return t
