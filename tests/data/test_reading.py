"""Records from tables and files."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat

from estimable import Record, packaged, read_record

SHARED = Path(__file__).parents[3] / "shared" / "data"
T = 40
RANDOM = np.random.default_rng(7)
TABLE = pd.DataFrame(
    {
        "t [s]": np.arange(T) * 0.02,
        "alpha": RANDOM.normal(size=T),
        "q": 1e-9 * RANDOM.normal(size=T),
        "elevator": 1e9 * RANDOM.normal(size=T),
        "thrust": np.arange(T),
        "came": (np.arange(T) % 3 != 0).astype(float),
        "comment": [f"row {k}" for k in range(T)],
    }
)
TABLE.loc[[3, 4, 17], "alpha"] = np.nan
TABLE.loc[5, "came"] = np.nan
COLUMNS = {
    "outputs": ["q", "alpha"],
    "inputs": ["elevator", "thrust"],
    "time": "t [s]",
    "arrived": "came",
    "lost": "hold",
}


def to_mat(path):
    savemat(
        path, {name.replace("t [s]", "t_s"): column.to_numpy() for name, column in TABLE.items() if name != "comment"}
    )


WRITERS = {
    "csv": lambda path: TABLE.to_csv(path, index=False),
    "txt": lambda path: TABLE.to_csv(path, index=False),
    "tsv": lambda path: TABLE.to_csv(path, index=False, sep="\t"),
    "CSV": lambda path: path.write_text("\ufeff" + TABLE.to_csv(index=False).replace("\n", "\r\n"), encoding="utf-8"),
    "parquet": lambda path: TABLE.to_parquet(path),
    "mat": to_mat,
}


@pytest.mark.parametrize("kind", WRITERS)
def test_every_kind_of_file_gives_the_same_record(same, tmp_path, kind):
    path = tmp_path / f"flight.{kind}"
    WRITERS[kind](path)
    arrived = TABLE["came"].to_numpy()
    there = Record(
        TABLE[["q", "alpha"]].to_numpy(),
        TABLE[["elevator", "thrust"]].to_numpy(),
        t=TABLE["t [s]"].to_numpy(),
        outputs=["q", "alpha"],
        inputs=["elevator", "thrust"],
        arrived=np.stack([arrived, arrived], axis=1),
        lost="hold",
    )
    columns = COLUMNS | ({"time": "t_s"} if kind == "mat" else {})
    same(read_record(path, **columns), there)
    same(read_record(str(path), **columns), there)


def test_a_table_gives_the_same_record_as_its_arrays(same):
    record = Record.from_pandas(TABLE, **COLUMNS, units={"alpha": "deg"})
    assert record.units == (("alpha", "deg"),)
    assert record.dt == pytest.approx(0.02)
    np.testing.assert_array_equal(record.y, TABLE[["q", "alpha"]].to_numpy())
    assert not record.seen[3, 1]
    assert record.seen[3, 0]


def test_the_options_of_a_record_go_through(tmp_path):
    TABLE.to_csv(tmp_path / "run.csv", index=False)
    record = read_record(tmp_path / "run.csv", outputs=["q"], inputs=["elevator"], dt=0.5, hold="first_order")
    assert (record.dt, record.hold, record.lost, record.arrived) == (0.5, "first_order", "zero", None)
    np.testing.assert_array_equal(record.t, np.arange(T) * 0.5)


def test_neither_time_nor_step_is_a_record_without_time():
    record = Record.from_pandas(TABLE, outputs=["q"])
    assert (record.dt, record.t, record.u.shape) == (None, None, (T, 0))


def test_an_arrival_may_be_told_for_each_input():
    table = TABLE.assign(other=1.0)
    record = Record.from_pandas(table, outputs=["q"], inputs=["elevator", "thrust"], arrived=["other", "came"])
    np.testing.assert_array_equal(record.arrived, table[["other", "came"]].to_numpy())


def test_one_channel_may_be_an_output_and_an_input():
    record = Record.from_pandas(TABLE, outputs=["alpha", "q"], inputs=["q"])
    np.testing.assert_array_equal(record.y[:, 1], record.u[:, 0])


START = pd.Timestamp("2026-03-29 01:59:59.5")
STAMPS = START + pd.to_timedelta(np.arange(T) * 20, unit="ms")
SECONDS = np.arange(T) * 0.02


TIMES = {
    "timestamps": TABLE.assign(when=STAMPS),
    "timestamps of a zone": TABLE.assign(when=STAMPS.tz_localize("UTC").tz_convert("Europe/Paris")),
    "nanoseconds": TABLE.assign(when=STAMPS.as_unit("ns")),
    "texts": TABLE.assign(when=STAMPS.astype(str)),
    "texts of a zone": TABLE.assign(when=[stamp.isoformat() + "+02:00" for stamp in STAMPS]),
    "objects": TABLE.assign(when=pd.Series(list(STAMPS), dtype=object)),
    "durations": TABLE.assign(when=STAMPS - START),
    "seconds as texts": TABLE.assign(when=[f"{s:.2f}" for s in SECONDS]),
    "seconds as decimals": TABLE.assign(when=pd.array(SECONDS, "Float64")),
}


@pytest.mark.parametrize("table", TIMES.values(), ids=TIMES)
def test_time_may_be_seconds_timestamps_or_durations(table):
    record = Record.from_pandas(table, outputs=["q"], time="when")
    np.testing.assert_allclose(record.t, SECONDS, atol=1e-12)
    assert record.dt == pytest.approx(0.02)


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_timestamps_in_a_file_are_seconds_after_the_first(tmp_path, kind):
    path = tmp_path / f"run.{kind}"
    table = TABLE.assign(when=STAMPS)
    table.to_parquet(path) if kind == "parquet" else table.to_csv(path, index=False)
    np.testing.assert_allclose(read_record(path, outputs=["q"], time="when").t, SECONDS, atol=1e-12)


INDICES = {
    "timestamps": (STAMPS, None),
    "durations": (pd.TimedeltaIndex(STAMPS - START), None),
    "named time": (pd.Index(SECONDS, name="time"), None),
    "named by the caller": (pd.Index(SECONDS, name="clock"), "clock"),
}


@pytest.mark.parametrize(("index", "time"), INDICES.values(), ids=INDICES)
def test_time_may_be_the_index(index, time):
    record = Record.from_pandas(TABLE.set_index(index), outputs=["q"], time=time)
    np.testing.assert_allclose(record.t, SECONDS, atol=1e-12)


def test_an_index_that_does_not_say_it_is_time_is_not():
    assert Record.from_pandas(TABLE.set_index(pd.Index(SECONDS)), outputs=["q"]).t is None


def test_a_step_counts_before_the_index():
    assert Record.from_pandas(TABLE.set_index(STAMPS), outputs=["q"], dt=0.5).dt == 0.5


@pytest.mark.parametrize(
    "column",
    [
        pd.array([1, None, 3], "Int64"),
        pd.array([1.0, None, 3.0], "Float64"),
        pd.Series([1, None, 3], dtype=object),
        ["1", None, "3"],
        pd.Categorical([1, None, 3]),
        np.array([1, np.nan, 3], "f4"),
    ],
    ids=["Int64", "Float64", "object", "text", "categories", "float32"],
)
def test_what_is_missing_in_a_table_is_not_seen(column):
    record = Record.from_pandas(pd.DataFrame({"y": column}), outputs=["y"])
    np.testing.assert_array_equal(record.y[:, 0], [1.0, np.nan, 3.0])


def test_an_empty_cell_is_not_seen_and_not_logged(tmp_path):
    (tmp_path / "run.csv").write_text("y, u, z\n1, 2, 3\n, 4, 3\n5,NaN, 3\nNA, 6,\n")
    record = read_record(tmp_path / "run.csv", outputs=["y", "z"], inputs=["u"])
    np.testing.assert_array_equal(record.y, [[1, 3], [np.nan, 3], [5, 3], [np.nan, np.nan]])
    np.testing.assert_array_equal(record.u[:, 0], [2, 4, np.nan, 6])


def test_an_empty_line_of_a_single_column_is_a_sample_not_seen(tmp_path):
    (tmp_path / "run.csv").write_text("y\n1\n\n3\n")
    np.testing.assert_array_equal(read_record(tmp_path / "run.csv", outputs=["y"]).y[:, 0], [1.0, np.nan, 3.0])


def test_empty_lines_between_rows_are_no_samples(tmp_path):
    (tmp_path / "run.csv").write_text("y,u\n1,2\n\n3,4\n\n")
    np.testing.assert_array_equal(read_record(tmp_path / "run.csv", outputs=["y"]).y[:, 0], [1.0, 3.0])


def test_a_comma_at_the_end_of_every_row_shifts_nothing(tmp_path):
    (tmp_path / "run.csv").write_text("y,u\n1,2,\n3,4,\n")
    record = read_record(tmp_path / "run.csv", outputs=["y"], inputs=["u"])
    np.testing.assert_array_equal(record.y[:, 0], [1.0, 3.0])
    np.testing.assert_array_equal(record.u[:, 0], [2.0, 4.0])


def test_a_name_twice_that_nobody_asked_for_is_no_fault(tmp_path):
    (tmp_path / "run.csv").write_text("y,spare,spare\n1,2,3\n")
    assert read_record(tmp_path / "run.csv", outputs=["y"]).y == [[1.0]]


def test_numbers_in_a_csv_are_read_to_the_last_bit(tmp_path):
    values = np.concatenate([RANDOM.normal(size=200) * 10.0 ** RANDOM.integers(-300, 300, 200), [5e-324, 1 / 3, -0.0]])
    pd.DataFrame({"y": values}).to_csv(tmp_path / "run.csv", index=False)
    np.testing.assert_array_equal(read_record(tmp_path / "run.csv", outputs=["y"]).y[:, 0], values)


@pytest.mark.parametrize("shape", [(T,), (T, 1), (1, T)])
def test_a_matlab_vector_may_stand_or_lie(tmp_path, shape):
    savemat(tmp_path / "run.mat", {"y": TABLE["q"].to_numpy().reshape(shape), "dt": 0.02, "other": np.zeros((7, 3))})
    record = read_record(tmp_path / "run.mat", outputs=["y"])
    np.testing.assert_array_equal(record.y[:, 0], TABLE["q"])


def test_a_longer_matlab_variable_beside_them_is_no_fault(tmp_path):
    savemat(tmp_path / "run.mat", {"y": np.ones(3), "u": np.arange(3), "raw": np.zeros(99)})
    record = read_record(tmp_path / "run.mat", outputs=["y"], inputs=["u"])
    np.testing.assert_array_equal(record.u[:, 0], [0.0, 1.0, 2.0])


FLIGHT = {
    "outputs": ["alpha_deg", "pitch_rate_deg_s"],
    "inputs": ["elevator_deg"],
    "time": "time_s",
    "hold": "first_order",
}


def check_flight(record):
    assert (record.y.shape, record.u.shape) == ((1201, 2), (1201, 1))
    assert record.dt == pytest.approx(0.01, rel=1e-9)
    np.testing.assert_array_equal(record.y[0], [0.359616, 0.060276])
    np.testing.assert_array_equal(record.u[0], [-1.280244])
    assert record.seen.all()


def test_the_packaged_flight_is_read():
    check_flight(read_record(packaged.path("f16-flight.csv"), **FLIGHT))


@pytest.mark.skipif(not SHARED.is_dir(), reason="the shared data are not on this machine")
def test_the_packaged_flight_is_the_shared_one(same):
    there = read_record(SHARED / "f16-flight.csv", **FLIGHT)
    check_flight(there)
    same(read_record(packaged.path("f16-flight.csv"), **FLIGHT), there)


@pytest.mark.skipif(not SHARED.is_dir(), reason="the shared data are not on this machine")
def test_the_hair_dryer_has_no_time_of_its_own():
    record = read_record(SHARED / "hair-dryer.csv", outputs=["y"], inputs=["u"], dt=0.08)
    assert (len(record), record.dt) == (1000, 0.08)
    assert (record.u[0], record.y[0]) == ([6.41], [4.766099])
