"""The hand-written C loops, compiled where there is a compiler; otherwise a message replaces them."""

import ctypes
import functools
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np

NO_COMPILER = "no C compiler"


@functools.cache
def library(source):
    """The compiled source of this folder; None without a compiler."""
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        return None
    made = Path(tempfile.mkdtemp()) / "handwritten.so"
    flags = ["-O3", "-march=native", "-ffast-math", "-fno-finite-math-only", "-fPIC", "-pthread"]
    subprocess.run([compiler, *flags, "-c", str(Path(__file__).with_name(source)), "-o", f"{made}.o"], check=True)
    # without -ffast-math: with it the library would round small numbers to zero in the whole process
    subprocess.run([compiler, "-shared", "-pthread", f"{made}.o", "-o", str(made), "-lm"], check=True)
    return ctypes.CDLL(str(made))


def contender(model, prior, y, form="kalman", smooths=False):
    """A function that filters the record once and returns (means, log-likelihood).

    `form`: "kalman" (conventional) or "kalman_ud" (square-root), the functions of handwritten.c. `smooths`: whether
    handwritten_smoother.c follows the first.
    """
    smoothed = library("handwritten_smoother.c") if smooths else None
    if library("handwritten.c") is None:
        return NO_COMPILER
    kalman = getattr(library("handwritten.c"), form)
    kalman.restype, kalman.argtypes = ctypes.c_double, [ctypes.c_long, *[ctypes.c_void_p] * 9]
    noise = model.Q if form == "kalman" else np.linalg.cholesky(model.Q)
    start = prior.covariance if form == "kalman" else upper_factors(prior.covariance)
    A, C, noise, R, y = (np.ascontiguousarray(M) for M in (model.A, model.C, noise, model.R, y))

    def run():
        x, P = prior.mean.copy(), start.copy()
        means, covariances = np.empty((len(y), 4)), np.empty((len(y), 4, 4))
        total = kalman(len(y), *(a.ctypes.data for a in (A, C, noise, R, x, P, y, means, covariances)))
        if smoothed is not None:
            smoothed.rauch(
                ctypes.c_long(len(y)), *(ctypes.c_void_p(a.ctypes.data) for a in (A, noise, means, covariances))
            )
        return means, total

    return run


def bank(threads, A, C, Q, R, prior, y):
    """A function that returns the log-likelihood of each run of a bank, by handwritten_lanes.c."""
    if library("handwritten_lanes.c") is None:
        return NO_COMPILER
    kalman = library("handwritten_lanes.c").kalman_bank
    kalman.restype, kalman.argtypes = None, [*[ctypes.c_long] * 3, *[ctypes.c_void_p] * 8]
    given = [np.ascontiguousarray(M) for M in (A, C, Q, R, prior.mean, prior.covariance, y)]

    def run():
        totals = np.empty(len(y))
        kalman(threads, *y.shape[:2], *(a.ctypes.data for a in (*given, totals)))
        return totals

    return run


def upper_factors(P):
    """U with D on its diagonal, P = U D U'."""
    L = np.linalg.cholesky(P[::-1, ::-1])[::-1, ::-1]
    scale = np.diag(L)
    return L / scale - np.eye(len(P)) + np.diag(scale**2)
