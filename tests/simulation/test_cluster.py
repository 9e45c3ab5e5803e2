"""Parts on a cluster of real processes: workers that are missing, killed, or that cannot load the summary."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import estimable as es
from estimable.simulation import cluster as module

distributed = pytest.importorskip("distributed", reason="needs dask[distributed]")
pytestmark = pytest.mark.filterwarnings("ignore")  # Dask's own, of sockets and ports

MODEL = es.StateSpace([[0.9]], [[0.5]], Q=[[0.01]], R=[[0.1]], dt=0.5)
CASE = es.LoopCase(
    MODEL, es.StateFeedback([[0.3]]), es.Kalman(MODEL), reference=np.ones((50, 0)), prior=es.Prior([1.0], [[2.0]])
)


def last():
    """A summary that is sent whole: it is in no module."""
    return lambda closed: {"state": closed.state[-1, 0]}


def fly(**given):
    return es.monte_carlo_loops(
        CASE, **{"runs": 12, "seed": 3, "chunk": 1, "summary": last(), "progress": False, **given}
    )


SOURCE = Path(es.__file__).parents[1]


class Cluster:
    """A scheduler and its workers, each a process that can be killed."""

    def __init__(self, folder, path=SOURCE):
        self.folder, self.path, self.processes = folder, path, []
        self.address = f"tcp://127.0.0.1:{_free_port()}"
        self.scheduler = self.start("scheduler", "--host", self.address, "--no-dashboard", "--no-show")

    def start(self, *words):
        command = [sys.executable, "-m", "distributed.cli.dask_" + words[0], *words[1:]]
        path = {"PYTHONPATH": str(self.path)}
        process = subprocess.Popen(
            command, cwd=self.folder, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL, env={**os.environ, **path}
        )
        self.processes.append(process)
        return process

    def worker(self):
        return self.start("worker", self.address, "--nworkers", "1", "--nthreads", "1", "--no-nanny", "--no-dashboard")

    def stop(self):
        for process in self.processes:
            process.kill()
            process.wait()


def _free_port():
    import socket

    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


@pytest.fixture
def cluster(tmp_path):
    made = Cluster(tmp_path)
    yield made
    made.stop()


def test_a_scheduler_without_workers_is_one_sentence_within_ten_seconds(cluster):
    start = time.monotonic()
    with pytest.raises(es.InputError, match=f"the Dask scheduler at '{cluster.address}' has no workers. Start some"):
        fly(scheduler=cluster.address)
    assert time.monotonic() - start < 10


def test_what_the_workers_cannot_load_is_named(cluster, tmp_path, monkeypatch):
    here = tmp_path / "here"
    here.mkdir()
    (here / "flight_summaries.py").write_text("def last(closed):\n    return {'state': closed.state[-1, 0]}\n")
    monkeypatch.syspath_prepend(here)
    import flight_summaries

    cluster.worker()
    with pytest.raises(es.InputError) as raised:
        fly(scheduler=cluster.address, summary=flight_summaries.last)
    assert str(raised.value) == (
        f"the workers at '{cluster.address}' cannot load `summary`: ModuleNotFoundError: No module named 'flight_summaries'. "
        "The scheduler and its workers need this version of estimable, and the modules of the `summary` and the cases, but for "
        "those that your script defines itself."
    )
    lock = threading.Lock()
    with pytest.raises(es.InputError, match=r"`summary` cannot be sent to the workers of a cluster: .*lock"):
        fly(scheduler=cluster.address, summary=lambda closed: {"state": lock})

    def broken(closed):
        raise FileNotFoundError("no such table")

    with pytest.raises(FileNotFoundError, match="no such table"):
        fly(scheduler=cluster.address, summary=broken)

    def late(closed):
        import flight_summaries

        return flight_summaries.last(closed)

    with pytest.raises(
        es.InputError, match="cannot import what a run needs: ModuleNotFoundError: No module named 'flight_s"
    ):
        fly(scheduler=cluster.address, summary=late)
    monkeypatch.setattr(module, "__version__", "0.0.0")
    with pytest.raises(es.InputError, match=f"cannot load estimable 0.0.0: they have version {es.__version__}"):
        fly(scheduler=cluster.address)


def test_a_cluster_without_estimable_is_one_sentence(tmp_path):
    (tmp_path / "estimable").mkdir()
    (tmp_path / "estimable" / "__init__.py").write_text("")
    other = Cluster(tmp_path, tmp_path)
    try:
        other.worker()
        with pytest.raises(es.InputError, match=f"cannot load estimable {es.__version__}: No module named 'estimable"):
            fly(scheduler=other.address)
    finally:
        other.stop()


def test_a_killed_worker_and_a_killed_scheduler_lose_nothing(cluster, tmp_path):
    expected = fly()[""].values["state"]
    one, _ = cluster.worker(), cluster.worker()
    parts = tmp_path / "parts"

    def slow(closed):
        time.sleep(0.3)
        return {"state": closed.state[-1, 0]}

    def kill(process, count):
        """When there are this many parts."""
        end = time.monotonic() + 30
        while len(list(parts.glob("*.npz"))) < count and time.monotonic() < end:
            time.sleep(0.01)
        os.kill(process.pid, signal.SIGKILL)

    threads = [threading.Thread(target=kill, args=given) for given in ((one, 2), (cluster.scheduler, 5))]
    parts.mkdir()
    for thread in threads:
        thread.start()
    with pytest.raises(es.EstimableError, match=r"ended before the work was done .*call again to continue"):
        fly(scheduler=cluster.address, summary=slow, folder=parts)
    for thread in threads:
        thread.join()
    done = {path.name: path.stat().st_mtime_ns for path in parts.glob("*.npz")}
    assert 5 <= len(done) < 12
    assert_array_equal(fly(summary=slow, folder=parts)[""].values["state"], expected)
    assert {name: (parts / name).stat().st_mtime_ns for name in done} == done


def test_a_cluster_whose_workers_are_all_lost_ends_in_a_sentence(cluster, tmp_path, monkeypatch):
    monkeypatch.setattr(module, "RETURN", 1.0)
    parts, number = tmp_path / "parts", cluster.worker().pid

    def kill(closed):
        os.kill(number, signal.SIGKILL)

    with pytest.raises(es.EstimableError, match=r"ended before the work was done \(no workers for 1 s\)"):
        fly(scheduler=cluster.address, summary=kill, folder=parts)
