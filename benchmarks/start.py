"""W9 and W11: seconds of a cold start, for whole processes, and for the first call in one."""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import estimable

from .common import row

PLACES = (
    Path(estimable.__file__).parents[1],
    Path(__file__).parents[1],
)  # of the measured package, and of this one


def process(code, **variables):
    """Seconds of a new process, and its output."""
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"} | variables
    path = [*map(str, PLACES), environment.get("PYTHONPATH", "")]
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, path))
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        ran = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, cwd=folder, env=environment)
        return time.perf_counter() - start, ran.stdout.decode()


def starts(name):
    """Imports, and the demo in a new process: with an empty disk cache, and with the machine code of the previous process."""
    times = [[process(f"import {module}")[0] for module in ("jax", "estimable")] for _ in range(5)]
    jax, ours = (min(each) for each in zip(*times, strict=True))
    yield row(name, "import estimable", ours)
    yield row(name, "import jax", jax, whose="library")
    demo = "import sys; sys.argv=['estimable','demo','--json']; from estimable.commands import main; main()"
    with tempfile.TemporaryDirectory() as cache:
        for contender in ("estimable demo, nothing on the disk", "estimable demo, machine code on the disk"):
            yield row(name, contender, process(demo, ESTIMABLE_CACHE=cache)[0])


FIRST = """
import time, jax, numpy as np
from estimable import Kalman, Record, estimate
from benchmarks.common import problem
(model, prior), record = problem({n}, 2), Record(np.zeros((200, 2)), dt=1)
jax.block_until_ready(jax.jit(lambda x: x + 1)(1.0))
start = time.perf_counter()
result = estimate(Kalman(model), record, prior=prior, engine="{engine}")
print(time.perf_counter() - start, result.engine)
"""


def first_calls(name, n):
    """`seconds`: of the first call that filters a record of 200 samples."""
    auto, xla = (FIRST.format(n=n, engine=engine) for engine in ("auto", "xla"))
    with tempfile.TemporaryDirectory() as cache:
        for code, which in ((auto, ", nothing on the disk"), (auto, ", machine code on the disk"), (xla, "")):
            seconds, engine = process(code, ESTIMABLE_CACHE=cache)[1].split()
            yield row(name, f"estimable {engine}{which}", float(seconds))
