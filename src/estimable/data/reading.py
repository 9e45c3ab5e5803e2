"""Records from files and tables."""

import csv
import warnings
from collections.abc import Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .. import checks
from ..annotations import Numbers
from ..models.angles import Given
from .frames import Channels
from .record import Record
from .record_arguments import Texts

if TYPE_CHECKING:
    import pandas as pd
    from scipy.sparse import spmatrix

READERS = (".csv", ".txt", ".tsv", ".mat", ".parquet")
SEPARATORS = {";": "semicolons", "\t": "tabs", "|": "bars", " ": "spaces", ",": "commas"}
BEGINNING = 8192  # bytes of a file that are checked before it is read as text


def read_record(
    path: str | Path,
    *,
    outputs: Channels,
    inputs: Channels = (),
    time: str | None = None,
    dt: float | None = None,
    time_unit: str | None = None,
    time_format: str | None = None,
    zone: str | None = None,
    repeated: str | None = None,
    grid: float | None = None,
    start: float | None = None,
    stop: float | None = None,
    max_gap: float | None = None,
    delay: Mapping[str, float] | None = None,
    offset: Mapping[str, float] | None = None,
    arrived: str | Sequence[str] | None = None,
    lost: str = "zero",
    hold: str = "zero_order",
    units: Texts = (),
    angles: Given = (),
    sigma: Mapping[str, str] | None = None,
    na_values: Numbers | None = None,
) -> Record:
    """Read a `Record` from named columns of a file: CSV (.csv .txt .tsv), MATLAB (.mat, up to version 7.2) or Parquet.

    - `outputs`, `inputs`: the names of the columns, or {name in the model: column}.
    - `time`: the column of the times, numbers or dates. Without it give the step `dt` in seconds.
    - `time_unit`: "s", "ms", "us", "ns", "min" or "h". None: the unit in the column's name ("t [us]", "time_ms", "TimeUS"); the
      one in which the first stamp is a date of this century since 1970; seconds where the steps are at most 50. Other columns
      are refused.
    - `time_format`: "day first", "month first" or a format of `strptime`, for dates such as 02.03.2026. None: ISO 8601, or the
      order of day and month that fits every row and increases.
    - `zone`: the time zone of dates without an offset, such as "Europe/Paris". None: they are taken as written.
    - `repeated`: which of several values of a channel at one instant counts, "first" or "last". None: they are refused.
    - `grid`: the step in seconds of a grid on which the samples are placed. Outputs go to the nearest row; inputs are the mean
      over the row of what was held (`hold="zero_order"`) or linear between their samples. None: the rows are those of the file.
    - `start`, `stop`: the first and last time of the record in seconds.
    - `max_gap`: nothing connects across a longer step (seconds), and on a grid an older input is not known.
    - `delay`: {column: seconds} by which its stamps are late. `offset`: {column: seconds} to add to its stamps, where they count
      from another zero than those of the outputs. Both need `grid`.
    - `units`: {channel: unit}, for figures and reports.
    - `angles`: {channel: "rad", "deg", a period or a range} of the channels that are angles, as in `Record`.
    - `sigma`: {output: column} of the standard deviations of the noise, for outputs whose noise changes from row to row.
    - `na_values`: numbers that mark missing values, such as -9999. By default such a number far outside the others raises an
      error that names its row. [] accepts every number as measured.

    An empty cell is NaN, a missing value. Cells are separated by commas in a .txt file, and by tabs in a .tsv file. A .mat
    file holds one vector for each channel; all have one length. Parquet needs the extra `parquet`.

    The notes of the record say which rule decided the unit of time, and what the grid did.

    Raises `InputError` if the file does not exist or is not readable, a column is missing, or a cell is not a number.
    """
    found = checks.existing_file(path)
    try:
        frame = _read_frame(found, _wanted(outputs, inputs, time, arrived))
        return Record.from_pandas(
            frame, outputs=outputs, inputs=inputs, time=time, dt=dt, time_unit=time_unit, time_format=time_format, zone=zone,
            repeated=repeated, grid=grid, start=start, stop=stop, max_gap=max_gap, delay=delay, offset=offset, arrived=arrived,
            lost=lost, hold=hold, units=units, angles=angles, sigma=sigma, na_values=na_values,
        )  # fmt: skip
    except checks.InputError as error:
        raise checks.InputError(*(f"{path}: {fault}" for fault in error.faults)) from None


def _wanted(*arguments: str | Channels | None) -> list[str]:
    """All names among the arguments; other values are reported later, with the other faults."""
    arguments = tuple(list(given.values()) if isinstance(given, Mapping) else given for given in arguments)
    lists = [[given] if isinstance(given, str) else given for given in arguments if isinstance(given, str | Sequence)]
    return [name for names in lists for name in names if isinstance(name, str)]


def _read_frame(path: Path, wanted: list[str]) -> "pd.DataFrame":
    """The file as a table."""
    import pandas as pd

    kind = path.suffix.lower()
    if kind not in READERS:
        checks.refuse(f"a record is read from {checks.listed(READERS)}. Got {kind!r}.")
    try:
        if kind == ".mat":
            return _read_mat(path, wanted)
        if kind == ".parquet":
            return pd.read_parquet(path)
        return _read_csv(path, "\t" if kind == ".tsv" else ",", wanted)
    except ImportError:
        checks.refuse("Parquet needs pyarrow: pip install 'estimable[parquet]'.")
    except NotImplementedError:
        checks.refuse("the file has the MATLAB format 7.3, which cannot be read. Save it again with save(..., '-v7').")
    except checks.InputError:
        raise
    except Exception as error:  # any exception with which another package reports an unreadable file
        first = str(error).splitlines()[0] if str(error) else type(error).__name__
        checks.refuse(f"it could not be read as {kind[1:]}: {first}")


def _read_csv(path: Path, separator: str, wanted: list[str]) -> "pd.DataFrame":
    import pandas as pd

    names = _header(path, separator, wanted)
    options = {"sep": separator, "skipinitialspace": True, "skip_blank_lines": len(names) > 1, "index_col": False}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)
            frame = pd.read_csv(path, **options)
    except pd.errors.ParserWarning:
        checks.refuse(
            f"its rows hold more cells than its header has names: {checks.listed(names)}. Is a name missing in the header?"
        )
    if len(frame) and len(names) > 1 and frame.iloc[:, -1].isna().any():
        _check_cells(path, separator, len(names))
    return frame


def _header(path: Path, separator: str, wanted: list[str]) -> list[str]:
    """The names in the first line of a text file."""
    with path.open("rb") as file:
        beginning = file.read(BEGINNING)
    if b"\0" in beginning:
        checks.refuse("it is not a text file in UTF-8: it holds zero bytes.")
    with path.open(newline="", encoding="utf-8-sig") as file:
        lines = csv.reader(file, delimiter=separator, skipinitialspace=True)
        names = next((line for line in lines if line), None)
    if names is None:
        checks.refuse("it is empty: it needs a header and rows.")
    twice = [name for name in dict.fromkeys(wanted) if names.count(name) > 1]
    if twice:
        checks.refuse(*(f"there is more than one column {name!r}." for name in twice))
    if not set(wanted) & set(names):
        _check_header(names, separator)
    return names


def _check_header(names: list[str], separator: str) -> None:
    """Report the likely fault of a header that has none of the wanted names."""
    other = next((mark for mark in SEPARATORS if len(names) == 1 and mark in names[0].strip()), None)
    if other is not None:
        checks.refuse(
            f"its header is one name, {checks.short(names[0])}. Are the cells separated by {SEPARATORS[other]}? "
            f"They must be separated by {SEPARATORS[separator]}. Or read it with pandas.read_csv(path, sep={other!r}), "
            "then use Record.from_pandas."
        )
    if all(_is_number(name) for name in names):
        checks.refuse(f"it has no header. The first line must name the columns. It holds {checks.listed(names)}.")


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _check_cells(path: Path, separator: str, columns: int) -> None:
    """Check that no row is shorter than the header: a truncated row is not the same as empty cells."""
    with path.open(newline="", encoding="utf-8-sig") as file:
        rows = (line for line in csv.reader(file, delimiter=separator) if "".join(line).strip())
        for number, row in enumerate(islice(rows, 1, None), start=1):
            if len(row) < columns:
                cells = checks.counted(len(row), "cell")
                checks.refuse(
                    f"row {number} below the header has {cells}, the header has {columns}. Is the line truncated?"
                )


def _read_mat(path: Path, wanted: list[str]) -> "pd.DataFrame":
    import pandas as pd
    from scipy.io import loadmat

    found = {name: value for name, value in loadmat(path).items() if not name.startswith("__")}
    faults = checks.Faults()
    for name in dict.fromkeys(wanted):
        if name in found and not _is_vector(found[name]):
            kind = _kind(found[name])
            faults.add(f"variable {name!r} must be a vector of numbers, one for each channel. It is {kind}.")
    faults.finish()
    structs = [name for name, value in found.items() if value.dtype.names is not None]
    if structs and not any(name in found for name in wanted):
        fields = ", ".join(found[structs[0]].dtype.names)
        checks.refuse(
            f"there is no variable {checks.listed(wanted)}, but a struct {structs[0]!r} with the fields {fields}: save its "
            f"fields as variables, with save('file.mat', '-struct', '{structs[0]}')."
        )
    vectors = {name: np.ravel(value) for name, value in found.items() if _is_vector(value)}
    lengths = {name: len(vectors[name]) for name in dict.fromkeys(wanted) if name in vectors}
    if len(set(lengths.values())) > 1:
        sizes = ", ".join(f"{name!r} has {length}" for name, length in lengths.items())
        checks.refuse(f"the variables must have one length: {sizes}.")
    length = next(iter(lengths.values()), max(map(len, vectors.values()), default=0))
    return pd.DataFrame({name: value for name, value in vectors.items() if len(value) == length})


def _is_vector(value: "np.ndarray | spmatrix") -> bool:
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiub":
        return False
    return value.size in (0, max(value.shape, default=1))


def _kind(value: "np.ndarray | spmatrix") -> str:
    """The kind of a MATLAB variable, for messages."""
    if not isinstance(value, np.ndarray):
        return "sparse"
    words = {"O": "a cell array", "U": "a text", "V": "a structure", "c": "complex"}
    return words.get(value.dtype.kind, " × ".join(map(str, value.shape)))


def column_names(path: str | Path) -> list[str]:
    """The names of the columns of a file. Raises `InputError` if it does not exist or is not readable."""
    return [str(name) for name in _read_frame(checks.existing_file(path), []).columns]
