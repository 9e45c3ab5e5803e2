"""A disk that is full at any byte: an error with the file and the reason, the old files as they were, and no drafts."""

import errno
import os
import re
import resource
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import estimable as es
from estimable.commands import app
from estimable.engines import lowering, native
from estimable.report import report_of, write_report

SOURCE = Path(es.__file__).parent
FULL = os.strerror(errno.EFBIG)
MODEL = es.StateSpace([[0.9]], [[0.5]], [[1.0]], Q=[[0.01]], R=[[0.1]], dt=0.5)
PRIOR = es.Prior([1.0], [[2.0]])
RECORD = es.Record(np.sin(np.arange(40.0)), np.ones(40), dt=0.5)
KALMAN = es.Kalman(MODEL)
RESULT = es.estimate(KALMAN, RECORD, prior=PRIOR)
CASE = es.LoopCase(MODEL, es.StateFeedback([[0.3]]), KALMAN, reference=np.ones((9, 0)), prior=PRIOR)


def online(path, version):
    running = es.online(KALMAN, prior=PRIOR)
    running.correct([float(version)])
    running.save(path)


def report(path, version):
    write_report(report_of(RESULT, record=RECORD, algorithm=KALMAN, prior=PRIOR, title=f"version {version}"), path)


def part(path, version):
    es.monte_carlo_loops(CASE, runs=3, seed=version, summary=lambda closed: {"end": closed.state[-1, 0]}, folder=path)


def command(path, version, *, words):
    given = [str(word).format(path=path, version=version, model=path.parent / "model.toml") for word in words]
    done = CliRunner(env={"COLUMNS": "80", "NO_COLOR": "1", "TERM": "dumb"}).invoke(app, given)
    if isinstance(done.exception, SystemExit) and done.exit_code:
        assert done.stderr.startswith("Error: ")
        assert "Traceback" not in done.output
        raise es.EstimableError(done.stderr)
    assert done.exception is None, done.exception


FLIGHT = es.packaged.path("f16-flight.csv")
FILTER = str(FLIGHT), "--model", "{model}"
MEASURED = "--input", "elevator_deg", "--output", "alpha_deg"
WRITERS = {  # by the module that calls `writing`: (name of the file or folder, call(path, version))
    "store/save.py": [
        ("prior.npz", lambda path, version: es.save(path, es.Prior([float(version)], [[1.0]]))),
        ("run.npz", online),
    ],
    "models/files.py": [
        (
            "written.toml",
            lambda path, version: es.write_model(path, MODEL, es.Prior([float(version)], [[1.0]])),
        )
    ],
    "report/page.py": [
        ("page.html", report),
        ("gain.html", partial(command, words=["gain", *FILTER, "--report", "{path}"])),
    ],
    "simulation/parts.py": [("parts", part)],
    "commands/simulate_report.py": [
        ("drawn.csv", partial(command, words=["simulate", "output-error", "--seed", "{version}", "--out", "{path}"]))
    ],
    "commands/simulate_world.py": [
        ("world.csv", partial(command, words=["simulate", "f16", "--seed", "{version}", "--out", "{path}"]))
    ],
    "commands/estimate_report.py": [
        ("states.csv", partial(command, words=["estimate", *FILTER, "--filter", "kalman", "--out", "{path}"]))
    ],
    "commands/reproduce_report.py": [
        ("poles.html", partial(command, words=["reproduce", "sillence-table-3", "--figure", "{path}"]))
    ],
}
CACHE = "cache_folder.py"  # where it cannot be written, there is none
CALLS = [(name, call) for calls in WRITERS.values() for name, call in calls]


@contextmanager
def limit(size):
    """No file may become larger."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def files(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_every_writer_is_tried():
    calls = re.compile(r"\bwriting\b.*import.*\bwrite\b|import.*\bwriting\b")
    found = {str(path.relative_to(SOURCE)) for path in SOURCE.rglob("*.py") if calls.search(path.read_text())}
    assert found == {*WRITERS, CACHE}


@pytest.mark.parametrize(("name", "call"), CALLS, ids=[name for name, _ in CALLS])
def test_a_full_disk_leaves_the_old_files(name, call, tmp_path):
    (tmp_path / "model.toml").write_bytes(es.packaged.path("f16-model.toml").read_bytes())
    path = tmp_path / name
    call(path, 1)
    old = files(tmp_path)
    written = max((found for found in old if found != "model.toml"), key=lambda found: len(old[found]))
    for size in (0, 1, len(old[written]) // 2, len(old[written]) * 9 // 10):
        with limit(size), pytest.raises(es.EstimableError) as raised:
            call(path, 2)
        words = "".join(str(raised.value).split())
        assert "".join(f"{path}".split()) in words
        assert f"could not be written: {FULL}." in " ".join(str(raised.value).split())
        assert files(tmp_path) == old
    call(path, 2)
    assert files(tmp_path).keys() >= old.keys()


@pytest.mark.parametrize("size", [0, 1, 1000])
def test_a_cache_on_a_full_disk_is_not_used(size, tmp_path, monkeypatch):
    place = tmp_path / "cache"
    monkeypatch.setenv("ESTIMABLE_CACHE", str(place))
    for cached in (lowering.write_shapes, native.compiled_step):
        cached.cache_clear()
    with limit(size):
        result = es.estimate(KALMAN, RECORD, prior=PRIOR, engine="native")
    np.testing.assert_array_equal(result.mean, RESULT.mean)
    assert all(len(content) <= size for content in files(place).values())
    assert not list(place.glob("*.draft"))
