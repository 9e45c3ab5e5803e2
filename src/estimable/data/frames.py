"""Named columns of a table as channels."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from .. import checks
from ..annotations import Numbers
from .na_values import without_na
from .stamps import TimeOptions, read_stamps
from .time_units import Seconds

if TYPE_CHECKING:
    import pandas as pd

Channels: TypeAlias = Sequence[str] | Mapping[str, str]  # names, or {name in the model: channel}


def channels_of(
    frame: "pd.DataFrame",
    *,
    outputs: Channels,
    inputs: Channels,
    time: str | None,
    dt: float | None,
    arrived: str | Sequence[str] | None,
    na_values: Numbers | None,
    options: TimeOptions,
    sigma: Mapping[str, str] | None = None,
) -> dict[str, Any]:
    """The arguments `y`, `u`, `t`, `arrived`, `outputs`, `inputs`, `origin`, `sources` and `notes` of a `Record`, from named
    columns. `outputs` and `inputs` may map names to columns.

    Raises `InputError` with all columns that are missing or hold anything but numbers.
    """
    import pandas as pd

    if not isinstance(frame, pd.DataFrame):
        checks.refuse(f"`frame` must be a pandas DataFrame. Got {type(frame).__name__}.")
    faults = checks.Faults()
    sources = {kind: renamed(kind, given, faults) for kind, given in (("outputs", outputs), ("inputs", inputs))}
    outputs, inputs = (tuple(sources[kind].values()) for kind in ("outputs", "inputs"))
    if not outputs and not faults.sentences:
        faults.add("`outputs` must name at least one column.")
    arrivals = faults.names("arrived", [arrived] if isinstance(arrived, str) else arrived, "", "")
    if arrivals and len(arrivals) not in (1, len(inputs)):
        given = checks.listed(arrivals)
        faults.add(f"`arrived` must name one column for all inputs, or one for each of the {len(inputs)}. Got {given}.")
    sigmas = _sigma_columns(sigma, outputs, faults)
    columns = {
        name: _numbers(frame, name, faults) for name in dict.fromkeys([*outputs, *inputs, *arrivals, *sigmas.values()])
    }
    if len(frame) == 0:
        faults.add("there is no row below the header.")
    marks = None if na_values is None else faults.array("na_values", np.atleast_1d(na_values), "marks")
    read = time_of(frame, time, dt, outputs, options, faults)
    faults.finish()
    columns |= {name: without_na(np.asarray(columns[name]), name, marks, faults) for name in (*outputs, *inputs)}
    faults.finish()

    def together(names: Sequence[str]) -> np.ndarray:
        return np.stack([np.asarray(columns[name]) for name in names], axis=1) if names else np.zeros((len(frame), 0))

    repeated = arrivals * len(inputs) if len(arrivals) == 1 else arrivals
    return {
        "y": together(outputs), "u": together(inputs), "t": None if read is None else read.t,
        "outputs": tuple(sources["outputs"]), "inputs": tuple(sources["inputs"]),
        "arrived": together(repeated) if arrivals else None, "origin": None if read is None else read.origin,
        "sigma": _sigmas(sigmas, sources["outputs"], columns, len(frame)),
        "notes": () if read is None else (read.rule[0].upper() + read.rule[1:],),
        "sources": {name: column for both in sources.values() for name, column in both.items() if name != column},
    }  # fmt: skip


def renamed(argument: str, given: Channels, faults: checks.Faults) -> dict[str, str]:
    """{name in the record: name of the channel}; a list names channels of the same names."""
    if not isinstance(given, Mapping):
        return {name: name for name in faults.names(argument, given, "", "")}
    names, channels = faults.names(argument, list(given), "", ""), list(given.values())
    if all(isinstance(channel, str) for channel in channels):
        return dict(zip(names, channels, strict=False))
    faults.add(f"`{argument}` must map names to channels, as in {{'pitch_rate': 'gyro_y'}}. Got {checks.short(given)}.")
    return {}


def _sigma_columns(
    sigma: Mapping[str, str] | None, outputs: tuple[str, ...], faults: checks.Faults
) -> Mapping[str, str]:
    """The column of the standard deviation of each output that has one."""
    if sigma is None:
        return {}
    if not isinstance(sigma, Mapping) or not all(isinstance(column, str) for column in sigma.values()):
        faults.add(f"`sigma` must map outputs to columns, as in {{'range': 'range_sd'}}. Got {checks.short(sigma)}.")
        return {}
    for name in sigma:
        if name not in outputs:
            faults.add(f"`sigma` names {name!r}, which is not an output.{checks.suggestion(name, outputs)}")
    return sigma


def _sigmas(
    sigmas: Mapping[str, str], outputs: Mapping[str, str], columns: Mapping[str, Any], rows: int
) -> np.ndarray | None:
    """The standard deviations (T, p); None without any."""
    if not sigmas:
        return None
    return np.stack(
        [np.asarray(columns[sigmas[name]]) if name in sigmas else np.full(rows, np.nan) for name in outputs], 1
    )


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


def time_of(
    frame: "pd.DataFrame",
    time: str | None,
    dt: float | None,
    outputs: Sequence[str],
    options: TimeOptions,
    faults: checks.Faults,
) -> Seconds | None:
    """Seconds from a column, or from the index; None where `dt` counts, or something is at fault."""
    import pandas as pd

    index = frame.index
    if time is None:
        timed = isinstance(index, pd.DatetimeIndex | pd.TimedeltaIndex | pd.PeriodIndex) or index.name == "time"
        if timed and dt is None:
            return read_stamps(index.to_series(), "the index", options, faults)
        given = [
            f"time_{name}" if name != "zone" else name for name, value in options._asdict().items() if value is not None
        ]
        if given:
            faults.add(f"`{given[0]}` says how a time is read: give `time`, the column that holds it.")
        return None
    if not isinstance(time, str):
        faults.add(f"`time` must be the name of one column. Got {checks.short(time)}.")
        return None
    if time in outputs:
        faults.add(f"`time` names {time!r}, which is an output too.")
        return None
    if time == index.name and time not in frame.columns:
        return read_stamps(index.to_series(), "the index", options, faults)
    column = _column(frame, time, faults)
    return None if column is None else read_stamps(column, f"the time column {time!r}", options, faults)
