"""The same numbers from threads, forked and spawned processes as from one thread; and one run used by several threads."""

import copy
import os
import pickle
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import estimable as es
from estimable.engines import lowering, native

PRIOR = es.Prior([0.0], [[1.0]])
MODEL = es.StateSpace([[0.9]], Q=[[0.1]], R=[[0.2]], dt=1)


def model_of(n):
    return es.StateSpace(0.9 * np.eye(n) + 0.05, C=np.ones((1, n)), Q=0.1 * np.eye(n), R=[[0.2]], dt=1)


def estimate(n, engine="native"):
    record = es.Record(np.sin(np.arange(200.0)), dt=1)
    return es.estimate(es.Kalman(model_of(n)), record, prior=es.Prior(np.zeros(n), np.eye(n)), engine=engine)


@pytest.fixture
def busy():
    """Threads change places all the time."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


@pytest.mark.parametrize("engine", ["native", "xla"])
def test_estimates_of_several_threads_are_those_of_one(engine, busy, tmp_path, monkeypatch):
    sizes = [1, 2, 3] * 4
    alone = {n: estimate(n, engine) for n in set(sizes)}
    monkeypatch.setenv("ESTIMABLE_CACHE", str(tmp_path))
    for cached in (lowering.write_shapes, native.compiled_step):
        cached.cache_clear()
    with ThreadPoolExecutor(6) as pool:
        found = list(pool.map(lambda n: estimate(n, engine), sizes))
    for n, result in zip(sizes, found, strict=True):
        assert_array_equal(result.mean, alone[n].mean)
        assert_array_equal(result.covariance, alone[n].covariance)
        assert result.log_likelihood == alone[n].log_likelihood


@pytest.mark.parametrize(("engine", "count"), [("native", 4000), ("xla", 100)])
def test_calls_of_one_run_from_several_threads_follow_each_other(engine, count, busy):
    """Corrections with one value commute: none is lost, and none is half done."""
    shared, alone = (es.online(es.Kalman(MODEL), prior=PRIOR, engine=engine) for _ in range(2))

    def correct():
        for _ in range(count):
            shared.correct([1.0])

    def look():
        while not done.is_set():
            seen.append((float(shared.progress.info.covariance[0, 0]) if shared.info else 1.0, shared.info is not None))

    done, seen = threading.Event(), []
    threads = [threading.Thread(target=correct) for _ in range(3)]
    watcher = threading.Thread(target=look)
    watcher.start()
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    done.set()
    watcher.join()
    variances = {1.0} | {float(alone.correct([1.0]).covariance[0, 0]) for _ in range(3 * count)}
    assert_array_equal(shared.info.mean, alone.info.mean)
    assert_array_equal(shared.info.covariance, alone.info.covariance)
    assert {variance for variance, _ in seen} <= variances


def test_a_call_that_does_not_end_is_one_sentence(monkeypatch):
    monkeypatch.setattr("estimable.estimation.turns.PATIENCE", 0.05)
    running = es.online(es.Kalman(MODEL), prior=PRIOR)
    running._turn.pop()
    for call in (lambda: running.correct([1.0]), running.predict, lambda: running.progress):
        with pytest.raises(es.EstimableError, match=r"another call of this run has not ended for 0.05 s"):
            call()
    running._turn.append(True)
    assert running.correct([1.0]).mean.shape == (1,)


@pytest.mark.parametrize("engine", ["native", "xla"])
@pytest.mark.parametrize("duplicate", [copy.copy, copy.deepcopy, lambda run: pickle.loads(pickle.dumps(run))])
def test_a_copy_of_a_run_is_a_run_of_its_own(engine, duplicate):
    running = es.online(es.Kalman(MODEL), prior=PRIOR, engine=engine)
    running.correct([1.0])
    other = duplicate(running)
    running.predict()
    running.correct([5.0])
    assert (other.engine, other.progress.sample) == (engine, 0)
    other.predict()
    assert_array_equal(other.correct([5.0]).mean, running.info.mean)


def test_errors_go_between_processes():
    outcome = es.results.Outcome(2, 3, None, "At sample 3: no.")
    for error in (es.RunError(outcome), es.InputError("one", "two"), es.AssumptionError("no")):
        again = pickle.loads(pickle.dumps(error))
        assert (type(again), str(again), vars(again)) == (type(error), str(error), vars(error))


def test_python_without_its_lock_is_refused():
    code = "import sys; sys._is_gil_enabled = lambda: False; import estimable"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 1
    assert "ImportError: estimable does not run in Python without the global interpreter lock" in done.stderr


def test_forked_and_spawned_processes_give_the_same_bits_or_a_sentence(tmp_path):
    """Machine code that is made runs everywhere; XLA, whose threads a fork does not copy, refuses instead of waiting for them."""
    script, place = Path(__file__).with_name("processes.py"), {"ESTIMABLE_CACHE": str(tmp_path / "cache")}
    done = subprocess.run(
        [sys.executable, str(script)], capture_output=True, text=True, cwd=tmp_path, env={**os.environ, **place}
    )
    ends = dict(line.split(": ", 1) for line in done.stdout.splitlines())
    refused = {
        name for name, end in ends.items() if end.startswith("XLA cannot run in this process: it was forked after")
    }
    assert {name for name, end in ends.items() if end != "the same"} == refused
    by_xla = {f"fork {name} {n}" for name in ("xla", "online", "simulate", "loop") for n in (1, 2)}
    assert refused == by_xla | {f"fork {name} 2" for name in ("estimate", "smooth", "fit_noise")}  # new steps
    same = {"fork inherited", "fork loaded", "fork cached", "fork pool", "spawn pool 1", "fork identify 2"}
    assert same | {"fork instruments 2"} <= ends.keys()
