"""Processes killed at random moments: `python -m benchmarks.figures.kill`.

Each process runs a Monte Carlo computation, saves an online run after every sample, or compiles its first steps. It is killed
(SIGKILL) at a random moment, and another process continues. The result must equal that of an undisturbed process to the last
bit, and what was finished before the kill must still be there.
"""

import argparse
import hashlib
import os
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

import estimable as es

RUNS, CHUNK = 120, 2  # of each of two cases: 120 parts
SAMPLES = 120
SIZES = 2, 3, 4, 5  # of the models that are compiled
START = es.Prior([1.0], [[2.0]])
MODEL = es.StateSpace([[0.9]], [[0.5]], Q=[[0.01]], R=[[0.1]], dt=0.5)


def loops(folder: Path) -> bytes:
    """The values of `monte_carlo_loops`, with its parts in `folder`."""
    found = es.monte_carlo_loops(CASES, runs=RUNS, chunk=CHUNK, seed=3, summary=last, folder=folder)
    return b"".join(one.values["state"].tobytes() for one in found.values())


def case(gain: float) -> es.LoopCase:
    law = es.StateFeedback([[gain]], reference_gain=[[0.4]])
    return es.LoopCase(MODEL, law, es.Kalman(MODEL), reference=np.ones(200), prior=START)


def last(closed: es.results.ClosedLoop) -> dict[str, np.ndarray]:
    return {"state": closed.state[-1]}


CASES = es.loop_grid(case, gain=[0.3, 0.6])


def save(folder: Path) -> bytes:
    """The end of an online run, which continues from the file of an earlier one. Prints each sample that is saved."""
    file = folder / "run.npz"
    running = es.load(file) if file.exists() else es.online(es.Kalman(MODEL), prior=START)
    for k in range(running.progress.sample, SAMPLES):
        running.correct([np.sin(float(k))])
        running.predict([1.0])
        running.save(file)
        print("saved", running.progress.sample, flush=True)
    info = running.progress.info
    return info.mean.tobytes() + info.covariance.tobytes()


def first_compile(folder: Path) -> bytes:
    """Estimates of models of several sizes, with their machine code in the cache `folder`."""
    found = []
    for n in SIZES:
        model = es.StateSpace(0.9 * np.eye(n), C=np.ones((1, n)), Q=0.1 * np.eye(n), R=[[0.2]], dt=1)
        record = es.Record(np.sin(np.arange(50.0)), dt=1)
        found.append(es.estimate(es.Kalman(model), record, prior=es.Prior(np.zeros(n), np.eye(n)), engine="native"))
    return b"".join(result.mean.tobytes() + result.covariance.tobytes() for result in found)


WORK: dict[str, Callable[[Path], bytes]] = {"loops": loops, "save": save, "compile": first_compile}


class Ended(NamedTuple):
    """A process that has ended: the digest of its result, None if it was killed before; the last saved sample; seconds."""

    digest: str | None
    saved: int
    seconds: float


class Kill(NamedTuple):
    """One kill: its moment, the files and drafts that it left, and what was wrong afterwards."""

    moment: float
    files: int
    drafts: int
    faults: tuple[str, ...]


def process(kind: str, folder: Path, moment: float | None = None) -> Ended:
    """Work in another process, killed `moment` seconds after it has loaded the package."""
    place = {"ESTIMABLE_CACHE": str(folder)} if kind == "compile" else {}
    command = [sys.executable, "-m", "benchmarks.figures.kill", "--work", kind, "--folder", str(folder)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env={**os.environ, **place}) as child:
        ready, start = child.stdout.readline(), time.perf_counter()
        try:
            if moment is not None:
                time.sleep(moment)
                child.kill()
            lines = [ready, *child.stdout]
        finally:
            child.kill()
    words = [line.split() for line in lines if line.endswith("\n")]
    saved = [int(number) for name, *rest in words if name == "saved" for number in rest]
    digests = [rest[0] for name, *rest in words if name == "digest"]
    return Ended(digests[0] if digests else None, max(saved, default=0), time.perf_counter() - start)


def contents(folder: Path) -> dict[str, bytes]:
    """The files of a folder, without drafts."""
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.suffix != ".draft"}


def killed(kind: str, moments: Callable[[], float], digest: str, again: Callable[[str, Path], str | None]) -> Kill:
    """A kill at the first of `moments` before the end of the work. `again(kind, folder)` continues: the digest."""
    while True:
        with tempfile.TemporaryDirectory() as name:
            folder, moment = Path(name), moments()
            ended = process(kind, folder, moment)
            if ended.digest is not None:
                continue
            before, drafts = contents(folder), len(list(folder.glob("*.draft")))
            faults = _lost(kind, folder, ended)
            if again(kind, folder) != digest:
                faults += ["the result is another one"]
            after = contents(folder)
            if kind != "save" and (changed := [file for file in before if after.get(file) != before[file]]):
                faults.append(f"{changed} had been finished, and were made again")
            return Kill(moment, len(before), drafts, tuple(faults))


def _lost(kind: str, folder: Path, ended: Ended) -> list[str]:
    """What was saved before the kill and is no longer there."""
    if kind != "save" or not ended.saved:
        return []
    sample = es.load(folder / "run.npz").progress.sample
    return [f"sample {ended.saved} was saved, but the file has {sample}"] if sample < ended.saved else []


def main(arguments: list[str] | None = None) -> int:
    """Kill, and print what was found."""
    options = argparse.ArgumentParser(description=__doc__, prog="python -m benchmarks.figures.kill")
    options.add_argument("--kills", type=int, default=50, help="of the three kinds together")
    options.add_argument("--seed", type=int, default=0, help="of the moments")
    options.add_argument("--work", choices=WORK, help="do the work of one process, in --folder")
    options.add_argument("--folder", type=Path)
    given = options.parse_args(arguments)
    if given.work:
        print("ready", flush=True)
        print("digest", hashlib.sha256(WORK[given.work](given.folder)).hexdigest(), flush=True)
        return 0
    wrong = 0
    for i, kind in enumerate(WORK):
        kills = _kills(kind, random.Random(f"{kind} {given.seed}"), len(range(i, given.kills, len(WORK))))
        wrong += sum(bool(kill.faults) for kill in kills)
    return 1 if wrong else 0


def _kills(kind: str, rng: random.Random, count: int) -> list[Kill]:
    """Kills of one kind, and a line about them."""
    with tempfile.TemporaryDirectory() as name:
        whole = process(kind, Path(name))
        files = len(contents(Path(name)))
    kills = [
        killed(kind, lambda: rng.uniform(0, whole.seconds), str(whole.digest), lambda *work: process(*work).digest)
        for _ in range(count)
    ]
    right, drafts = sum(not kill.faults for kill in kills), sum(kill.drafts for kill in kills)
    between = sum(kill.files > 0 for kill in kills)
    print(f"{kind:8} {count} kills within {whole.seconds:.1f} s: {right} continued to the same bits; {between} had left some "
          f"of {files} files, {drafts} had left a draft", flush=True)  # fmt: skip
    for kill in kills:
        for fault in kill.faults:
            print(f"  killed after {kill.moment:.4f} s: {fault}", flush=True)
    return kills


if __name__ == "__main__":
    sys.exit(main())
