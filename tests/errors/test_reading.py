"""What is said of a file or table that no record can be read from."""

import sys

import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat

from estimable import Record, read_record

GOOD = "t,y,u\n0,1,2\n1,3,4\n"
COLUMNS = {"outputs": ["y"], "inputs": ["u"], "time": "t"}


@pytest.fixture
def written(tmp_path):
    def write(content, name="run.csv"):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


TEXTS = {
    "a mark": (
        GOOD + "2,-9999,5\n3,-9999,6\n",
        (
            "column 'y' holds -9999 in row 3 below the header and 1 more row; its other values are 1 to 3. If -9999 marks "
            "missing values, give na_values=[-9999] (--na -9999). If it was measured, give na_values=[]."
        ),
    ),
    "empty": ("", "it is empty: it needs a header and rows."),
    "blank": ("\n\n", "it is empty: it needs a header and rows."),
    "header only": ("t,y,u\n", "there is no row below the header."),
    "no header": ("0,1,2\n1,3,4\n", "it has no header. The first line must name the columns. It holds '0', '1', '2'."),
    "semicolons": (
        GOOD.replace(",", ";"),
        (
            "its header is one name, 't;y;u'. Are the cells separated by semicolons? They must be separated "
            "by commas. Or read it with pandas.read_csv(path, sep=';'), then use Record.from_pandas."
        ),
    ),
    "semicolons and decimal commas": (
        "t;y;u\n0,0;1,0;2,0\n1,0;3,0;4,0\n",
        (
            "its header is one name, 't;y;u'. Are the cells separated by semicolons? They must be separated "
            "by commas. Or read it with pandas.read_csv(path, sep=';'), then use Record.from_pandas."
        ),
    ),
    "tabs": (
        GOOD.replace(",", "\t"),
        (
            "its header is one name, 't\\ty\\tu'. Are the cells separated by tabs? They must be separated by "
            "commas. Or read it with pandas.read_csv(path, sep='\\t'), then use Record.from_pandas."
        ),
    ),
    "spaces": (
        GOOD.replace(",", " "),
        (
            "its header is one name, 't y u'. Are the cells separated by spaces? They must be separated by "
            "commas. Or read it with pandas.read_csv(path, sep=' '), then use Record.from_pandas."
        ),
    ),
    "zero bytes": (b"\0" * 100, "it is not a text file in UTF-8: it holds zero bytes."),
    "UTF-16": (GOOD.encode("utf-16"), "it is not a text file in UTF-8: it holds zero bytes."),
    "a picture": (
        b"\x89PNG\r\n\x1a\n" + bytes(range(256)),
        "it is not a text file in UTF-8: it holds zero bytes.",
    ),
    "Latin 1": (
        "t,y,u,\N{DEGREE SIGN}\n".encode("latin-1"),
        ("it could not be read as csv: 'utf-8' codec can't decode byte 0xb0 in position 6: invalid start byte"),
    ),
    "text among numbers": (
        "t,y,u\n0,1,2\n1,high,4\n",
        "column 'y' must hold numbers. Row 2 below the header holds 'high'.",
    ),
    "thousands": ('t,y,u\n0,"1,000",2\n', "column 'y' must hold numbers. Row 1 below the header holds '1,000'."),
    "complex": ("t,y,u\n0,1+2j,2\n", "column 'y' must hold numbers. Row 1 below the header holds '1+2j'."),
    "infinite": ("t,y,u\n0,1,2\n1,inf,2\n", "column 'y' must be finite. Row 2 below the header is not."),
    "too large": ("t,y,u\n0,1e999,2\n", "column 'y' must be finite. Row 1 below the header is not."),
    "name twice": ("t,y,y,u\n0,1,2,3\n", "there is more than one column 'y'."),
    "a longer row": (
        "t,y,u\n0,1,2\n1,2,3,4\n",
        ("it could not be read as csv: Error tokenizing data. C error: Expected 3 fields in line 3, saw 4"),
    ),
    "longer rows": (
        "t,y,u\n0,1,2,9\n1,2,3,9\n",
        ("its rows hold more cells than its header has names: 't', 'y', 'u'. Is a name missing in the header?"),
    ),
    "a shorter row": (
        "t,y,u\n0,1,2\n1,3\n",
        "row 2 below the header has 2 cells, the header has 3. Is the line truncated?",
    ),
    "a row cut off": (
        "t,y,u\n0,1,2\n1,3,4\n2",
        "row 3 below the header has 1 cell, the header has 3. Is the line truncated?",
    ),
    "time empty": ("t,y,u\n0,1,2\n,3,4\n", "the time column 't' must not be empty or NaN. Row 2 below the header is."),
    "time back": (
        "t,y,u\n0,1,2\n2,3,4\n1,5,6\n",
        (
            "the time column 't' must increase. From row 2 to row 3 below the header it goes from 2.0 to "
            "1.0 s: sort the rows by time."
        ),
    ),
    "time repeated": (
        "t,y,u\n0.5,1,2\n0.5,3,2\n",
        (
            "two rows have the time 0.5 s, and both have a value of 'y'. Rows at one instant are merged into one row "
            "only if each channel has one value there: drop one of them, take their mean, or read the file with repeated='first' "
            "or 'last'."
        ),
    ),
    "time past midnight": (
        "t,y,u\n23:59:59,1,2\n00:00:00,3,4\n",
        (
            "the time column 't' must increase. From row 1 to row 2 below the header it goes from 86399.0 to "
            "0.0 s: the times pass midnight; give a column with dates."
        ),
    ),
    "timestamps back": (
        "t,y,u\n2026-01-01 00:00:01,1,2\n2026-01-01 00:00:00,3,4\n",
        (
            "the time column 't' must increase. From row 1 to row 2 below the header it goes from 0.0 to "
            "-1.0 s: sort the rows by time."
        ),
    ),
}


@pytest.mark.parametrize(("content", "sentence"), TEXTS.values(), ids=TEXTS)
def test_a_text_file_is_refused_with_what_is_likely_wrong(refused, written, content, sentence):
    path = written(content)
    assert refused(lambda: read_record(path, **COLUMNS)) == [f"{path}: {sentence}"]


def test_a_number_too_large_for_float64_is_refused(refused, written):
    path = written(f"t,y,u\n0,{'9' * 400},2\n")
    (sentence,) = refused(lambda: read_record(path, **COLUMNS))
    assert sentence.startswith(f"{path}: column 'y' must ")


def test_commas_in_a_tsv_are_told(refused, written):
    path = written(GOOD, "run.tsv")
    (sentence,) = refused(lambda: read_record(path, **COLUMNS))
    assert (
        "its header is one name, 't,y,u'. Are the cells separated by commas? They must be separated by tabs."
    ) in sentence


ARGUMENTS = {
    "no such column": (dict(outputs=["Y_1"]), "there is no column 'Y_1'. The columns are 't', 'y', 'u'."),
    "nearly such a column": (
        dict(time="tt"),
        "there is no column 'tt'. The columns are 't', 'y', 'u'. Did you mean 't'?",
    ),
    "no such arrival": (dict(arrived="lost"), "there is no column 'lost'. The columns are 't', 'y', 'u'."),
    "one text": (dict(outputs="y"), "`outputs` must be a list of names. Got the string 'y'. Did you mean ['y']?"),
    "a number": (dict(outputs=3), "`outputs` must be a list of names, in order. Got 3."),
    "no output": (dict(outputs=[]), "`outputs` must name at least one column."),
    "nothing": (dict(outputs=None), "`outputs` must name at least one column."),
    "twice": (dict(outputs=["y", "y"]), "`outputs` names a channel twice: 'y'."),
    "inputs one text": (dict(inputs="u"), "`inputs` must be a list of names. Got the string 'u'. Did you mean ['u']?"),
    "time is an output": (dict(outputs=["t", "y"]), "`time` names 't', which is an output too."),
    "times": (dict(time=["t"]), "`time` must be the name of one column. Got ['t']."),
    "arrivals": (
        dict(arrived=["y", "t"]),
        ("`arrived` must name one column for all inputs, or one for each of the 1. Got 'y', 't'."),
    ),
    "arrivals of no input": (
        dict(inputs=[], arrived="u"),
        ("`arrived` marks which inputs were applied, but the record has no input: give `u`."),
    ),
    "no arrivals": (dict(arrived="y"), "`arrived` must be 1 (applied), 0 (lost) or NaN (unknown)."),
    "dt": (dict(dt=0.5), "`dt` = 0.5 s and `t` disagree: the mean step of `t` is 1 s. Give one."),
    "lost": (dict(lost="keep"), "`lost` must be one of 'zero', 'hold'. Got 'keep'."),
    "hold": (dict(hold="zoh"), "`hold` must be one of 'zero_order', 'first_order'. Got 'zoh'."),
}


@pytest.mark.parametrize(("given", "sentence"), ARGUMENTS.values(), ids=ARGUMENTS)
def test_an_argument_is_refused_with_the_name_of_the_file(refused, written, given, sentence):
    path = written(GOOD)
    assert refused(lambda: read_record(path, **(COLUMNS | given))) == [f"{path}: {sentence}"]


def test_every_column_that_is_missing_is_named_at_once(refused, written):
    path = written(GOOD)
    found = refused(lambda: read_record(path, outputs=["a"], inputs=["b"], time="c", arrived="y"))
    assert [sentence.split("'")[1] for sentence in found] == ["a", "b", "c"]


def test_every_cell_that_is_no_number_is_named_at_once(refused, written):
    path = written("t,y,u\nx,1,2\n1,y,4\n2,5,z\n")
    assert [sentence.split("Row ")[1] for sentence in refused(lambda: read_record(path, **COLUMNS))] == [
        "2 below the header holds 'y'.",
        "3 below the header holds 'z'.",
        "1 below the header holds 'x'.",
    ]


@pytest.mark.parametrize(
    ("path", "sentence"),
    [
        (None, "`path` must be the name of a file. Got None."),
        (3, "`path` must be the name of a file. Got 3."),
        ("nowhere.csv", "nowhere.csv does not exist."),
    ],
)
def test_a_path_must_be_of_a_file_that_is_there(refused, path, sentence):
    assert refused(lambda: read_record(path, **COLUMNS)) == [sentence]


def test_a_directory_is_no_file(refused, tmp_path):
    folder = tmp_path / "flight.csv"
    folder.mkdir()
    assert refused(lambda: read_record(folder, **COLUMNS)) == [f"{folder} is not a file."]


@pytest.mark.parametrize(("name", "kind"), [("run.xlsx", ".xlsx"), ("run", "")])
def test_a_file_of_another_kind_is_refused(refused, written, name, kind):
    path = written(GOOD, name)
    assert refused(lambda: read_record(path, **COLUMNS)) == [
        f"{path}: a record is read from '.csv', '.txt', '.tsv', '.mat', '.parquet'. Got {kind!r}."
    ]


T = np.arange(3.0)
MATLAB = {
    "a matrix": (np.zeros((3, 2)), "variable 'y' must be a vector of numbers, one for each channel. It is 3 × 2."),
    "a text": ("abc", "variable 'y' must be a vector of numbers, one for each channel. It is a text."),
    "a cell array": (
        np.array([1.0, "a"], object),
        ("variable 'y' must be a vector of numbers, one for each channel. It is a cell array."),
    ),
    "a structure": ({"a": 1.0}, "variable 'y' must be a vector of numbers, one for each channel. It is a structure."),
    "complex": (T * 1j, "variable 'y' must be a vector of numbers, one for each channel. It is complex."),
    "of another length": (T[:2], "the variables must have one length: 'y' has 2, 'u' has 3, 't' has 3."),
    "infinite": (np.array([0.0, np.inf, 1.0]), "column 'y' must be finite. Row 2 below the header is not."),
}


@pytest.mark.parametrize(("y", "sentence"), MATLAB.values(), ids=MATLAB)
def test_a_matlab_variable_is_refused_with_what_it_is(refused, tmp_path, y, sentence):
    path = tmp_path / "run.mat"
    savemat(path, {"t": T, "y": y, "u": T})
    assert refused(lambda: read_record(path, **COLUMNS)) == [f"{path}: {sentence}"]


def test_a_sparse_matlab_variable_is_refused(refused, tmp_path):
    from scipy.sparse import csc_matrix

    path = tmp_path / "run.mat"
    savemat(path, {"t": T, "y": csc_matrix(T[:, None]), "u": T})
    assert refused(lambda: read_record(path, **COLUMNS)) == [
        f"{path}: variable 'y' must be a vector of numbers, one for each channel. It is sparse."
    ]


def test_a_matlab_variable_that_is_missing_is_named_beside_those_there_are(refused, tmp_path):
    path = tmp_path / "run.mat"
    savemat(path, {"t": T, "yaw": T, "u": T, "dt": 0.1})
    assert refused(lambda: read_record(path, **COLUMNS | {"outputs": ["yow"]})) == [
        f"{path}: there is no column 'yow'. The columns are 't', 'yaw', 'u'. Did you mean 'yaw'?"
    ]


def test_matlab_7_3_is_refused_with_what_to_do(refused, written):
    path = written(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + b"\0" * 400, "run.mat")
    assert refused(lambda: read_record(path, **COLUMNS)) == [
        f"{path}: the file has the MATLAB format 7.3, which cannot be read. Save it again with save(..., '-v7')."
    ]


@pytest.mark.parametrize("name", ["run.mat", "run.parquet"])
@pytest.mark.parametrize("content", ["", GOOD, b"\x05\x06\x07" * 200], ids=["empty", "text", "noise"])
def test_a_binary_file_that_is_none_is_refused(refused, written, name, content):
    path = written(content, name)
    (sentence,) = refused(lambda: read_record(path, **COLUMNS))
    assert sentence.startswith(f"{path}: it could not be read as {path.suffix[1:]}: ")


def test_an_empty_parquet_is_refused(refused, tmp_path):
    path = tmp_path / "run.parquet"
    pd.DataFrame({"t": [], "y": [], "u": []}, dtype=float).to_parquet(path)
    assert refused(lambda: read_record(path, **COLUMNS)) == [f"{path}: there is no row below the header."]


def test_parquet_without_pyarrow_says_what_to_install(refused, written, monkeypatch):
    path = written("", "run.parquet")
    for name in [*(name for name in sys.modules if name.split(".")[0] == "pyarrow"), "pyarrow", "fastparquet"]:
        monkeypatch.setitem(sys.modules, name, None)
    assert refused(lambda: read_record(path, **COLUMNS)) == [
        f"{path}: Parquet needs pyarrow: pip install 'estimable[parquet]'."
    ]


FRAME = pd.DataFrame({"t": T, "y": T, "u": T})
DAYS = pd.date_range("2026-01-01", periods=3)
FRAMES = {
    "a list": ([1.0], "`frame` must be a pandas DataFrame. Got list."),
    "a column": (FRAME["y"], "`frame` must be a pandas DataFrame. Got Series."),
    "no row": (FRAME[:0], "there is no row below the header."),
    "a column twice": (pd.concat([FRAME, FRAME["y"]], axis=1), "there is more than one column 'y'."),
    "dates": (FRAME.assign(y=DAYS.as_unit("ns")), "column 'y' must hold numbers. It holds datetime64[ns]."),
    "durations": (
        FRAME.assign(y=(DAYS - DAYS[0]).as_unit("ns")),
        "column 'y' must hold numbers. It holds timedelta64[ns].",
    ),
    "complex": (FRAME.assign(y=T * 1j), "column 'y' must hold numbers. It holds complex128."),
    "lists": (
        FRAME.assign(y=pd.Series([1.0, [2.0], 3.0], dtype=object)),
        "column 'y' must hold numbers. Row 2 below the header holds [2.0].",
    ),
    "categories": (
        FRAME.assign(y=pd.Categorical(list("abc"))),
        "column 'y' must hold numbers. Row 1 below the header holds 'a'.",
    ),
    "time not a time": (
        FRAME.assign(t=[DAYS[0], pd.NaT, DAYS[1]]),
        "the time column 't' must not be empty or NaN. Row 2 below the header is.",
    ),
}


@pytest.mark.parametrize(("frame", "sentence"), FRAMES.values(), ids=FRAMES)
def test_a_table_is_refused_with_the_column_at_fault(refused, frame, sentence):
    assert refused(lambda: Record.from_pandas(frame, **COLUMNS)) == [sentence]


@pytest.mark.parametrize(
    ("index", "sentence"),
    [
        (
            pd.Index(list("abc"), name="time"),
            (
                "the index must hold numbers, or timestamps like 2026-01-31 12:00:00.5. Row 1 below the header "
                "holds 'a'."
            ),
        ),
        (
            DAYS[::-1],
            (
                "the index must increase. From row 1 to row 2 below the header it goes from 0.0 to -86400.0 s: "
                "sort the rows by time."
            ),
        ),
    ],
)
def test_an_index_is_refused_like_a_time_column(refused, index, sentence):
    assert refused(lambda: Record.from_pandas(FRAME.set_index(index), outputs=["y"])) == [sentence]


def test_columns_that_are_numbers_are_no_names(refused):
    assert refused(lambda: Record.from_pandas(pd.DataFrame(np.zeros((3, 2))), outputs=[0])) == [
        "`outputs` must be nonempty strings. Got (0,)."
    ]
