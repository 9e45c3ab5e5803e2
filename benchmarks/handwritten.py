"""The hand-written C loop, compiled where there is a compiler."""

import ctypes
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np

SOURCE = Path(__file__).with_name("handwritten.c")


def contender(model, prior, y):
    """A function that filters the record once and returns (means, log-likelihood); None without a compiler."""
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        return None
    library = Path(tempfile.mkdtemp()) / "handwritten.so"
    flags = ["-O3", "-march=native", "-ffast-math", "-fno-finite-math-only", "-shared", "-fPIC"]
    subprocess.run([compiler, *flags, str(SOURCE), "-o", str(library), "-lm"], check=True)
    kalman = ctypes.CDLL(str(library)).kalman
    kalman.restype, kalman.argtypes = ctypes.c_double, [ctypes.c_long, *[ctypes.c_void_p] * 9]
    A, C, Q, R, y = (np.ascontiguousarray(M) for M in (model.A, model.C, model.Q, model.R, y))

    def run():
        x, P = prior.mean.copy(), prior.covariance.copy()
        means, covariances = np.empty((len(y), 4)), np.empty((len(y), 4, 4))
        total = kalman(len(y), *(a.ctypes.data for a in (A, C, Q, R, x, P, y, means, covariances)))
        return means, total

    return run
