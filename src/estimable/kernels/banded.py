"""Least squares with noise of a known autocovariance: banded, never N x N. NumPy and SciPy, outside jit.

Letters: y = Φ θ + v, cov(v_k, v_l) = r_|k-l|, zero beyond q; rows may be missing, `at` holds the time of each. Where the
noise changes from row to row, r_jk is the covariance of row k with the time j later.
"""

import numpy as np


def whitened(r: np.ndarray, at: np.ndarray, X: np.ndarray) -> np.ndarray:
    """L^-1 X with L L' the covariance of rows at times `at` (N,), r (q+1,) or (q+1, N). Cost: O(N q²).

    Raises `LinAlgError` where r is no autocovariance.
    """
    from scipy.linalg import cholesky_banded
    from scipy.linalg.lapack import dtbtrs  # type: ignore[attr-defined]

    N, q = len(at), min(len(r), len(at)) - 1
    band = np.zeros((q + 1, N))
    for j in range(q + 1):
        apart = at[j:] - at[: N - j]
        lag = np.minimum(apart, len(r) - 1)
        band[j, : N - j] = np.where(apart < len(r), r[lag] if r.ndim == 1 else r[lag, np.arange(N - j)], 0.0)
    solved, code = dtbtrs(cholesky_banded(band, lower=True), X, uplo="L")
    if code:
        raise np.linalg.LinAlgError("the covariance is singular")
    return solved


def autocovariance(e: np.ndarray, at: np.ndarray, q: int) -> np.ndarray:
    """r_0 .. r_q of residuals e (N,) at times `at`, over the available pairs; Bartlett's taper makes it positive semidefinite."""
    T = int(at[-1] - at[0]) + 1
    full, seen = np.zeros(T), np.zeros(T)
    full[at - at[0]], seen[at - at[0]] = e, 1.0
    r = []
    for j in range(min(q, T - 1) + 1):
        pairs = max(float(seen[j:] @ seen[: T - j]), 1.0)
        r.append(float(full[j:] @ full[: T - j]) / pairs * (1 - j / (q + 1)))
    return np.array(r)
