"""What is said of a thing that cannot be saved, and of a file that cannot be loaded."""

import enum
import io
import json
import sys
import zipfile

import jax
import numpy as np
import pandas as pd
import pytest

import estimable as es
from estimable.frozen import frozen, replace
from estimable.store import header

MODEL = es.StateSpace([[0.5]], [[1.0]], Q=[[0.1]], R=[[1.0]], dt=1, inputs=["u"])
PRIOR = es.Prior([0.0], [[1.0]])
RECORD = es.Record([1.0, 2.0, 3.0], [0.0, 1.0, 1.0], dt=1, inputs=["u"])
ESTIMATE = es.estimate(es.Kalman(MODEL), RECORD, prior=PRIOR)


@frozen
class Mine:
    """A record of the user's."""

    x: float


class Level(enum.IntEnum):
    """A number that is more than a number."""

    HIGH = 1


UNKNOWN = "A file can hold records of estimable, arrays, numbers and strings."
UNSAVED = {
    "object": (object(), f"thing is of type object. {UNKNOWN}"),
    "set": ({1.0}, f"thing is of type set. {UNKNOWN}"),
    "frame": (pd.DataFrame(), f"thing is of type {pd.DataFrame.__module__}.DataFrame. {UNKNOWN}"),
    "bytes": (b"", f"thing is of type bytes. {UNKNOWN}"),
    "enumeration": ((Level.HIGH,), f"thing[0] is of type {__name__}.Level. {UNKNOWN}"),
    "a record of the user's": (Mine(1.0), f"thing is of type {__name__}.Mine. {UNKNOWN}"),
    "masked array": ([np.ma.array([1.0])], f"thing[0] is of type numpy.ma.MaskedArray. {UNKNOWN}"),
    "function": (np.linalg.norm, "thing is a function, which a file cannot hold."),
    "class": (es.Prior, "thing is a class, which a file cannot hold."),
    "objects": ({"a": np.array([None])}, "thing['a'] is an array of object."),
    "random key": (jax.random.key(0), "thing is an array of key<fry>."),
    "a field": (replace(es.Kalman(MODEL), model=object()), f"thing.model is of type object. {UNKNOWN}"),
    "a field of another kind": (replace(es.Kalman(MODEL), model=3), "thing: `model` must be a StateSpace. Got 3."),
    "an algorithm that a driver is running": (
        replace(es.Kalman(MODEL), model=None),
        "thing: `model` must be a StateSpace. Got None.",
    ),
    "no covariance": (
        (replace(PRIOR, covariance=np.array([[-1.0]])),),
        "thing[0]: `covariance` must be positive semidefinite: its smallest eigenvalue is -1.",
    ),
    "rows": (
        replace(ESTIMATE, t=np.arange(2.0)),
        "thing: `info.mean` must be (T = 2, ..): `t` is (2,). Got (3, 1).",
    ),
}


@pytest.mark.parametrize(("thing", "sentence"), UNSAVED.values(), ids=UNSAVED)
def test_what_no_file_holds_is_refused_and_located(refused, tmp_path, thing, sentence):
    path = tmp_path / "thing.npz"
    assert refused(lambda: es.save(path, thing)) == [f"`thing` cannot be saved: {sentence}"]
    assert not list(tmp_path.iterdir())


def test_what_a_run_holds_must_be_ours(refused, tmp_path):
    running = es.online(es.Kalman(MODEL), prior=PRIOR)
    running.progress = object()
    assert refused(lambda: es.save(tmp_path / "run.npz", running)) == [
        f"`thing` cannot be saved: thing is of type object. {UNKNOWN}"
    ]


def test_a_path_must_be_of_a_file_that_is_there(refused, tmp_path):
    assert refused(lambda: es.load(None)) == ["`path` must be the name of a file. Got None."]
    assert refused(lambda: es.load(tmp_path / "none")) == [f"{tmp_path / 'none'} does not exist."]
    assert refused(lambda: es.load(tmp_path)) == [f"{tmp_path} is not a file."]


def wrote(path, header, **arrays):
    """A file with any header."""
    np.savez_compressed(path, header=np.array(header if isinstance(header, str) else json.dumps(header)), **arrays)


@pytest.fixture
def edited(tmp_path):
    """A file that `save` wrote, and somebody changed: edited(thing, change), with change(header, arrays)."""

    def edit(thing, change):
        path = tmp_path / "thing.npz"
        es.save(path, thing)
        with np.load(path) as file:
            arrays = {name: file[name] for name in file.files}
        said = json.loads(str(arrays.pop("header")))
        change(said, arrays)
        wrote(path, said, **arrays)
        return path

    return edit


def put(name, value):
    """A change of one array."""
    return lambda said, arrays: arrays.update({name: np.asarray(value)})


def field(*names, value):
    """A change of one field in the header."""

    def change(said, arrays):
        inner = said["thing"]
        for name in names[:-1]:
            inner = inner["record"]["fields"][name]
        inner["record"]["fields"][names[-1]] = value

    return change


def without(*names):
    def change(said, arrays):
        fields = said["thing"]["record"]["fields"]
        for name in names:
            arrays.pop(fields.pop(name)["array"])

    return change


TEXT = {"record": {"class": "Outcome", "fields": {}}}
UNFIT = "`state` does not fit `algorithm`: a step fails, changes its shape, or gives a mean of another size."
EDITED = {
    "indefinite": (
        PRIOR,
        put("thing.covariance", [[-1.0]]),
        ["thing: `covariance` must be positive semidefinite: its smallest eigenvalue is -1."],
    ),
    "infinite, deep inside": (
        ESTIMATE,
        put("thing.origin.prior.mean", [np.inf]),
        ["thing.origin.prior: `mean` must be finite. First infinite value at index 0."],
    ),
    "two faults of a constructor": (
        MODEL,
        lambda said, arrays: arrays.update({"thing.A": np.ones((1, 2)), "thing.R": np.array([[np.nan]])}),
        ["thing: `A` must be (n, n). Got (1, 2).", "thing: `R` must not hold NaN. First at index (0, 0)."],
    ),
    "another dtype": (
        PRIOR,
        put("thing.mean", np.zeros(1, np.float32)),
        [
            "thing: `mean` must be an array of shape (1,) and dtype float64. Got an array of shape (1,) and dtype float32."
        ],
    ),
    "what the constructor works out": (
        MODEL,
        field("varying", value={"tuple": ["A"]}),
        ["thing: `varying` must be (). Got ('A',)."],
    ),
    "a row is missing": (
        ESTIMATE,
        put("thing.info.covariance", np.ones((2, 1, 1))),
        ["thing: `info.covariance` must be (T = 3, ..): `t` is (3,). Got (2, 1, 1)."],
    ),
    "another size": (
        es.results.KalmanGain(*es.kalman_gain(MODEL).__dict__.values()),
        put("thing.predicted_covariance", np.eye(2)),
        ["thing: `predicted_covariance` must be (n = 1, n = 1): `filter` is (1, 1). Got (2, 2)."],
    ),
    "not symmetric": (
        es.kalman_gain(es.StateSpace(0.5 * np.eye(2), Q=np.eye(2), R=np.eye(2), dt=1)),
        put("thing.covariance", [[1.0, 0.5], [0.0, 1.0]]),
        ["thing: `covariance` must be symmetric: it differs from its transpose by 0.5."],
    ),
    "texts": (ESTIMATE, put("thing.t", ["a", "b", "c"]), [
        "thing: `t` must hold numbers. Got an array of shape (3,) and dtype <U1."]),
    "another record": (
        ESTIMATE,
        field("outcome", value="fine"),
        ["thing: `outcome` must be an Outcome. Got 'fine'."],
    ),
    "another kind": (ESTIMATE, field("engine", value=3), ["thing: `engine` must be a text. Got 3."]),
    "a number of rows that is fixed": (
        es.Trend(np.zeros((2, 1)), np.zeros((2, 1))),
        put("thing.inputs", np.zeros((3, 1))),
        ["thing: `inputs` must be (2, m). Got (3, 1)."],
    ),
    "names of another number": (
        es.results.Fit(MODEL, np.ones(1), np.eye(1), ("a",)),
        field("names", value={"tuple": ["a", "b"]}),
        ["thing: `names` must be (d = 1): `parameters` is (1,). Got (2,)."],
    ),
    "an item of a stack": (
        es.stack([PRIOR, PRIOR, PRIOR]),
        put("thing.items.covariance", [[[1.0]], [[-1.0]], [[1.0]]]),
        ["thing.items: item 1: `covariance` must be positive semidefinite: its smallest eigenvalue is -1."],
    ),
    "a stack of another size": (
        es.stack([PRIOR, PRIOR]),
        field("size", value=3),
        ["thing: `items.mean` must be (size = 3, ..). Got (2, 1)."],
    ),
    "a run": (
        es.online(es.Kalman(MODEL), prior=PRIOR),
        put("thing.algorithm.model.R", [[-1.0]]),
        ["thing.algorithm.model: `R` must be positive semidefinite: its smallest eigenvalue is -1."],
    ),
    "a run whose state has another shape": (
        es.online(es.Kalman(MODEL), prior=PRIOR),
        put("thing.state.factor", np.eye(2)),
        [UNFIT],
    ),
    "a run whose state is of more states": (
        es.online(es.Kalman(MODEL), prior=PRIOR),
        lambda said, arrays: arrays.update(
            {"thing.state.mean": np.zeros(2), "thing.state.factor": np.eye(2), "thing.state.size": np.zeros(2),
             "thing.state.diffuse": np.zeros((2, 0))}
        ),
        [UNFIT],
    ),
    "fields missing": (PRIOR, without("mean", "covariance"), [
        "thing is of class Prior, whose fields 'mean', 'covariance' are missing."]),
    "fields unknown": (PRIOR, field("colour", value="red"), ["thing is of class Prior, which has no fields 'colour'."]),
    "entries unknown": (PRIOR, put("more", 1.0), ["its header does not mention its entries 'more'."]),
    "entry missing": (
        PRIOR,
        lambda said, arrays: arrays.pop("thing.mean"),
        ["it has no entry 'thing.mean'."],
    ),
    "another format": (
        PRIOR,
        lambda said, arrays: said.update(format=99),
        ["it has format 99; this version reads format 2."],
    ),
    "the format before": (
        PRIOR,
        lambda said, arrays: said.update(estimable=said.pop("format") - 1),
        ["it has format 1; this version reads format 2."],
    ),
    "keys of the header": (
        PRIOR,
        lambda said, arrays: said.update(extra=1),
        [
            "its header must have the keys 'estimable', 'format', 'modules', 'thing'. Missing or unknown: 'extra'."
        ],
    ),
    "modules": (PRIOR, lambda said, arrays: said.update(modules=[]), [
        "`modules` of its header must name a module for each class."]),
    "no module": (PRIOR, lambda said, arrays: said.update(modules={}), ["its header names no module for 'Prior'."]),
    "a kind of its own": (
        PRIOR,
        lambda said, arrays: said.update(thing={"pickle": "gASVBwAAAA=="}),
        ["thing is {'pickle': 'gASVBwAAAA=='}, which `save` does not write."],
    ),
    "a number that is written elsewhere": (
        PRIOR,
        lambda said, arrays: said.update(thing={"float": "1_0"}),
        ["thing holds the text '1_0' as a number. `save` writes only 'nan', 'inf' and '-inf' as text."],
    ),
    "a dictionary of no pairs": (
        PRIOR,
        lambda said, arrays: said.update(thing={"dict": [[1.0]]}),
        ["thing is a dictionary whose items are not pairs, which `save` does not write."],
    ),
    "a record in no form": (
        PRIOR,
        lambda said, arrays: said.update(thing={"record": {}}),
        ["thing is a record without a class or without fields."],
    ),
    "a run of what does not run": (
        PRIOR,
        lambda said, arrays: said.update(thing={"online": said["thing"]}),
        ["thing is a run that resumes from Prior, which `save` does not write."],
    ),
}  # fmt: skip


@pytest.mark.parametrize(("thing", "change", "sentences"), EDITED.values(), ids=EDITED)
def test_a_file_that_somebody_changed_is_refused_with_the_field(refused, edited, thing, change, sentences):
    path = edited(thing, change)
    assert refused(lambda: es.load(path)) == [f"{path}: {sentence}" for sentence in sentences]


@pytest.mark.parametrize(
    "module",
    [
        "os",
        "this",
        "..os",
        "",
        "models.prior.os",
        "commands.show",
        "__main__",
        "models",
        "models.nowhere",
        "store.load",
        "Models.prior",
    ],
)
def test_only_modules_of_the_package_that_have_the_record_are_looked_at(refused, edited, module):
    path = edited(PRIOR, lambda said, arrays: said["modules"].update(Prior=module))
    assert refused(lambda: es.load(path)) == [
        f"{path}: it holds a 'Prior' of estimable.{module}, which estimable {es.__version__} does not have."
    ]
    assert "this" not in sys.modules


@pytest.mark.parametrize("name", ["Unheard", "_Structure", "Prior.of", "Faults"])
def test_only_records_are_made(refused, edited, name):
    def change(said, arrays):
        said["modules"][name] = "models.prior"
        said["thing"]["record"]["class"] = name

    path = edited(PRIOR, change)
    assert refused(lambda: es.load(path)) == [
        f"{path}: it holds a {name!r} of estimable.models.prior, which estimable {es.__version__} does not have."
    ]


def test_a_record_that_moved_is_found(same_prior, edited, monkeypatch):
    def change(said, arrays):
        said["modules"] = {"Belief": "models.beliefs"}
        said["thing"]["record"]["class"] = "Belief"

    path = edited(PRIOR, change)
    monkeypatch.setitem(header.MOVED, ("models.beliefs", "Belief"), ("models.prior", "Prior"))
    same_prior(es.load(path))


def test_a_field_that_came_later_says_what_older_files_mean(edited, monkeypatch):
    path = edited(PRIOR, lambda said, arrays: said["thing"]["record"]["fields"].pop("diffuse"))
    monkeypatch.setitem(header.ADDED, "Prior", {"diffuse": None})
    assert es.load(path).diffuse is None


@pytest.fixture
def same_prior():
    def check(found):
        assert type(found) is es.Prior
        assert found.mean.tolist() == PRIOR.mean.tolist()

    return check


@pytest.mark.parametrize(
    ("error", "reason"),
    [(PermissionError(13, "Permission denied"), "Permission denied"), (MemoryError(), "there is not enough memory")],
)
def test_a_file_that_cannot_be_read_is_not_said_to_be_damaged(refused, tmp_path, monkeypatch, error, reason):
    def fail(*_):
        raise error

    path = tmp_path / "thing.npz"
    es.save(path, PRIOR)
    monkeypatch.setattr(zipfile.ZipFile, "open", fail)
    assert refused(lambda: es.load(path)) == [f"{path} could not be read: {reason}."]


FOREIGN = {
    "empty": (lambda path: path.write_bytes(b""), "was not written by estimable.save, or is damaged: BadZipFile."),
    "a text": (lambda path: path.write_text("hello"), "was not written by estimable.save, or is damaged: BadZipFile."),
    "one array": (
        lambda path: path.write_bytes(npy((3,), bytes(24))),
        "was not written by estimable.save, or is damaged: BadZipFile.",
    ),
    "another archive": (lambda path: np.savez(path, a=1), ": it has no entry 'header'."),
    "a pickle": (
        lambda path: np.savez(path, header=np.array([{}], object)),
        ": its entry 'header' is an array of object, which `save` does not write.",
    ),
    "no JSON": (lambda path: wrote(path, "{"), "was not written by estimable.save, or is damaged: JSONDecodeError."),
    "nested too deep": (
        lambda path: wrote(path, "[" * 100_000 + "]" * 100_000),
        "was not written by estimable.save, or is damaged: RecursionError.",
    ),
    "a number that is none": (
        lambda path: wrote(path, '{"format": NaN}'),
        ": its header holds NaN, which is not JSON.",
    ),
    "another header": (lambda path: wrote(path, [1]), ": its header is not a JSON object."),
    "no header": (lambda path: wrote(path, {}), ": it has format None; this version reads format 2."),
}


@pytest.mark.parametrize(("write", "sentence"), FOREIGN.values(), ids=FOREIGN)
def test_a_file_that_save_did_not_write_is_refused(refused, tmp_path, write, sentence):
    path = tmp_path / "thing.npz"
    write(path)
    (found,) = refused(lambda: es.load(path))
    assert found == str(path) + (sentence if sentence[0] == ":" else f" {sentence}")


def test_a_damaged_file_is_refused_wherever_the_damage_is(refused, tmp_path):
    path = tmp_path / "thing.npz"
    es.save(path, es.StateSpace(np.random.default_rng(1).normal(size=(20, 20)), dt=1))
    whole = path.read_bytes()
    for cut in range(0, len(whole) - 1, len(whole) // 20):
        path.write_bytes(whole[:cut])
        assert "is damaged" in refused(lambda: es.load(path))[0]
    middle = bytearray(whole)
    middle[len(whole) // 2] ^= 0xFF
    path.write_bytes(middle)
    assert "is damaged" in refused(lambda: es.load(path))[0]


def npy(shape, data=b"", dtype="<f8"):
    """The bytes of an array that may lie about its shape."""
    stream = io.BytesIO()
    said = {"descr": dtype, "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(stream, said)
    return stream.getvalue() + data


def with_entry(path, data, compress=zipfile.ZIP_DEFLATED):
    """A prior whose mean is any bytes."""
    es.save(path, PRIOR)
    with zipfile.ZipFile(path) as archive:
        entries = {entry.filename: archive.read(entry) for entry in archive.infolist()}
    with zipfile.ZipFile(path, "w", compress) as archive:
        for name, content in (entries | {"thing.mean.npy": data}).items():
            archive.writestr(name, content)
    return path


HUGE = 2**40
LYING = {
    "more than there is": (npy((HUGE,), bytes(8)), f"its shape ({HUGE},)"),
    "less than there is": (npy((1,), bytes(16)), "its shape (1,)"),
    "more than a number of bytes can say": (npy((2**62, 4), bytes(8)), f"its shape ({2**62}, 4)"),
    "below nothing": (npy((-1, -1), bytes(8)), "its shape (-1, -1)"),
}


@pytest.mark.parametrize(("data", "shape"), LYING.values(), ids=LYING)
def test_the_shape_of_an_array_must_fill_its_entry(refused, tmp_path, data, shape):
    path = with_entry(tmp_path / "thing.npz", data)
    assert refused(lambda: es.load(path)) == [
        f"{path}: its entry 'thing.mean' has {len(data)} bytes, which {shape} does not fill."
    ]


def test_an_entry_that_claims_more_than_the_file_can_hold_is_not_read(refused, tmp_path, monkeypatch):
    path = with_entry(tmp_path / "thing.npz", npy((HUGE,), bytes(8)))
    size = len(npy((HUGE,))) + 8 * HUGE
    whole = bytearray(path.read_bytes())
    at = whole.index(b"thing.mean.npy", whole.rindex(b"PK\x01\x02", 0, whole.rindex(b"thing.mean.npy")))
    whole[at - 22 : at - 18] = (2**32 - 2).to_bytes(4, "little")  # the size before compression, in the directory
    path.write_bytes(whole)
    assert size > 2**32
    assert refused(lambda: es.load(path)) == [
        f"{path}: its entry 'thing.mean.npy' claims {2**32 - 2} bytes, more than the file holds."
    ]


def test_compression_that_save_does_not_use_is_refused(refused, tmp_path):
    path = with_entry(tmp_path / "thing.npz", npy((1,), bytes(8)), zipfile.ZIP_LZMA)
    (sentence,) = refused(lambda: es.load(path))
    assert sentence.endswith("bytes, more than the file holds.")


def test_an_array_of_another_layout_is_refused(refused, tmp_path):
    path = with_entry(tmp_path / "thing.npz", b"\x93NUMPY\x03\x00" + npy((1,), bytes(8))[8:])
    assert refused(lambda: es.load(path)) == [
        f"{path}: its entry 'thing.mean' is an array of a format that `save` does not write."
    ]
