"""The hand-written C loop, compiled where there is a compiler."""

import ctypes
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np

SOURCE = Path(__file__).with_name("handwritten.c")


def contender(model, prior, y, form="kalman"):
    """A function that filters the record once and returns (means, log-likelihood); None without a compiler.

    `form`: "kalman" (conventional) or "kalman_ud" (square-root), the functions of the source.
    """
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        return None
    library = Path(tempfile.mkdtemp()) / "handwritten.so"
    flags = ["-O3", "-march=native", "-ffast-math", "-fno-finite-math-only", "-shared", "-fPIC"]
    subprocess.run([compiler, *flags, str(SOURCE), "-o", str(library), "-lm"], check=True)
    kalman = getattr(ctypes.CDLL(str(library)), form)
    kalman.restype, kalman.argtypes = ctypes.c_double, [ctypes.c_long, *[ctypes.c_void_p] * 9]
    noise = model.Q if form == "kalman" else np.linalg.cholesky(model.Q)
    start = prior.covariance if form == "kalman" else upper_factors(prior.covariance)
    A, C, noise, R, y = (np.ascontiguousarray(M) for M in (model.A, model.C, noise, model.R, y))

    def run():
        x, P = prior.mean.copy(), start.copy()
        means, covariances = np.empty((len(y), 4)), np.empty((len(y), 4, 4))
        total = kalman(len(y), *(a.ctypes.data for a in (A, C, noise, R, x, P, y, means, covariances)))
        return means, total

    return run


def upper_factors(P):
    """U with D on its diagonal, P = U D U'."""
    L = np.linalg.cholesky(P[::-1, ::-1])[::-1, ::-1]
    scale = np.diag(L)
    return L / scale - np.eye(len(P)) + np.diag(scale**2)
