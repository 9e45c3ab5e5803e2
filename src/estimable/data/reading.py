"""Records from files and tables."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .. import checks
from .record import Record

READERS = (".csv", ".txt", ".tsv", ".mat", ".parquet")


def read_record(
    path: str | Path,
    *,
    outputs: Sequence[str],
    inputs: Sequence[str] = (),
    time: str | None = None,
    dt: float | None = None,
    arrived: str | Sequence[str] | None = None,
    lost: str = "zero",
    hold: str = "zero_order",
) -> Record:
    """The record in named columns of a file: CSV (.csv .txt .tsv), MATLAB (.mat, up to 7.2) or Parquet.

    `time` names the column of seconds (or timestamps); without it give `dt` in seconds. An empty cell is NaN: not seen.
    A .mat file holds one variable a channel, of one length. Parquet needs the extra `parquet`.

    Raises `InputError` where the file is not there or not readable, a column is missing, or a cell is not a number.
    """
    frame = _read_frame(Path(path), [*outputs, *inputs])
    try:
        return from_frame(
            frame, outputs=outputs, inputs=inputs, time=time, dt=dt, arrived=arrived, lost=lost, hold=hold, units=()
        )
    except checks.InputError as error:
        raise checks.InputError(*(f"{path}: {fault}" for fault in error.faults)) from None


def _read_frame(path: Path, wanted: list[str]):
    """The file as a table."""
    import pandas as pd

    if not path.is_file():
        checks.refuse(f"{path} is not there." if not path.exists() else f"{path} is not a file.")
    kind = path.suffix.lower()
    if kind not in READERS:
        checks.refuse(f"{path}: a record is read from {checks.listed(READERS)}. Got {kind!r}.")
    try:
        if kind == ".mat":
            return _read_mat(path)
        if kind == ".parquet":
            return pd.read_parquet(path)
        return pd.read_csv(path, sep="\t" if kind == ".tsv" else ",", skipinitialspace=True)
    except pd.errors.EmptyDataError:
        checks.refuse(f"{path} is empty: it has no header and no row.")
    except ImportError:
        checks.refuse(f"{path}: Parquet needs pyarrow: pip install 'estimable[parquet]'.")
    except (ValueError, OSError, NotImplementedError, TypeError) as error:
        first = str(error).splitlines()[0] if str(error) else type(error).__name__
        checks.refuse(f"{path} could not be read as {kind[1:]}: {first}")


def _read_mat(path: Path):
    import pandas as pd
    from scipy.io import loadmat

    found = {name: np.squeeze(value) for name, value in loadmat(path).items() if not name.startswith("__")}
    channels = {name: np.atleast_1d(value) for name, value in found.items() if value.ndim <= 1}
    lengths = {name: len(value) for name, value in channels.items()}
    longest = max(lengths.values(), default=0)
    return pd.DataFrame({name: value for name, value in channels.items() if lengths[name] == longest})


def from_frame(frame, *, outputs, inputs, time, dt, arrived, lost, hold, units) -> Record:
    """See `Record.from_pandas`."""
    faults = checks.Faults()
    outputs, inputs = _names("outputs", outputs, faults), _names("inputs", inputs, faults)
    if not outputs:
        faults.add("`outputs` must name at least one column.")
    arrivals = [arrived] if isinstance(arrived, str) else list(arrived or ())
    if arrivals and len(arrivals) not in (1, len(inputs)):
        faults.add(f"`arrived` must name one column, or one an input ({len(inputs)}). Got {checks.listed(arrivals)}.")
    columns = {name: _numbers(frame, name, faults) for name in dict.fromkeys([*outputs, *inputs, *arrivals])}
    t = _time(frame, time, dt, faults)
    if len(frame) == 0:
        faults.add("there is no row below the header.")
    faults.finish()

    def together(names):
        return np.stack([columns[name] for name in names], axis=1) if names else np.zeros((len(frame), 0))

    repeated = arrivals * len(inputs) if len(arrivals) == 1 else arrivals
    return Record(
        together(outputs), together(inputs), dt=dt, t=t, outputs=outputs, inputs=inputs,
        arrived=together(repeated) if arrivals else None, lost=lost, hold=hold, units=units,
    )  # fmt: skip


def _names(argument: str, given: Any, faults: checks.Faults) -> tuple[str, ...]:
    if isinstance(given, str):
        faults.add(f"`{argument}` must be a list of names. Got the text {given!r}: did you mean [{given!r}]?")
        return ()
    return tuple(given)


def _numbers(frame, name: str, faults: checks.Faults):
    """A column as float64; empty cells are NaN."""
    import pandas as pd

    if name not in frame.columns:
        columns = [str(column) for column in frame.columns]
        faults.add(f"there is no column {name!r}. The columns are {checks.listed(columns)}.{checks.suggestion(name, columns)}")
        return None
    column = frame[name]
    if getattr(column, "ndim", 1) != 1:
        faults.add(f"there is more than one column {name!r}.")
        return None
    numbers = pd.to_numeric(column, errors="coerce").astype(float).to_numpy()
    wrong = np.isnan(numbers) & column.notna().to_numpy()
    if wrong.any():
        row = int(np.argmax(wrong))
        faults.add(f"column {name!r} must hold numbers. Row {row + 1} below the header holds {column.iloc[row]!r}.")
        return None
    if np.isinf(numbers).any():
        faults.add(f"column {name!r} must be finite. Row {int(np.argmax(np.isinf(numbers))) + 1} below the header is not.")
        return None
    return numbers


def _time(frame, time: str | None, dt: float | None, faults: checks.Faults):
    """Seconds from a column of numbers or timestamps, or from the index; None where `dt` counts."""
    import pandas as pd

    if time is None:
        timed = isinstance(frame.index, pd.DatetimeIndex) or frame.index.name == "time"
        return _seconds(frame.index.to_series()) if timed and dt is None else None
    if time in frame.columns and pd.api.types.is_datetime64_any_dtype(frame[time]):
        return _seconds(frame[time])
    t = _numbers(frame, time, faults)
    if t is not None and np.isnan(t).any():
        faults.add(f"the time column {time!r} must not be empty or NaN. Row {int(np.argmax(np.isnan(t))) + 1} below the header is.")
        return None
    return t


def _seconds(series) -> np.ndarray:
    """Timestamps as seconds after the first; numbers as they are."""
    import pandas as pd

    if pd.api.types.is_datetime64_any_dtype(series):
        return (series - series.iloc[0]).dt.total_seconds().to_numpy(float)
    return series.to_numpy(float)
