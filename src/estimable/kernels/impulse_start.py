"""An initial estimate of an output-error model from incomplete data, without a search: a long impulse response, then A and B.

Letters: g (m, L) the impulse response y[k] = Σ g_jl u_j[k-l], linear in the data even with gaps; A g = B past its end.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

LONGEST = 40  # lags of an input, at most
PER_LAG = 3  # outputs seen for each coefficient, at least
RIDGE = 1e-8  # of the largest: directions without excitation stay zero


class Datum(NamedTuple):
    """One record of one output: inputs applied u (T, m), output y (T,), which were seen (T,), and sigma of their noise (T,), NaN
    or None where it is not known; `steps` (T - 1,): the lengths of the intervals in nominal steps, None: all 1."""

    u: np.ndarray
    y: np.ndarray
    seen: np.ndarray
    sigma: np.ndarray | None = None
    steps: np.ndarray | None = None


def start(na: int, nb: int, delay: int, data: Sequence[Datum]) -> np.ndarray:
    """θ = (a, b) from records (u, y, seen); zeros where there are too few data."""
    m = data[0].u.shape[1]
    lags = _lags(na, nb, delay, data)
    g = _impulse_response(data, lags)
    a = _denominator(g, na, nb + delay)
    b = np.stack([np.convolve(np.append(1.0, a), row)[delay : delay + nb + 1] for row in g])
    return np.concatenate([a, np.pad(b, ((0, 0), (0, nb + 1 - b.shape[1]))).reshape(m * (nb + 1))])


def residual_variance(na: int, nb: int, delay: int, data: Sequence[Datum]) -> float:
    """The noise variance, from the residuals of a long impulse response."""
    lags = _lags(na, nb, delay, data)
    g = _impulse_response(data, lags)
    e = np.concatenate([(datum.y - _lagged(datum.u, lags) @ g.ravel())[datum.seen] for datum in data])
    return float(e @ e / max(len(e) - g.size, 1)) if len(e) else 0.0


def _lags(na: int, nb: int, delay: int, data: Sequence[Datum]) -> int:
    m, seen = data[0].u.shape[1], sum(int(datum.seen.sum()) for datum in data)
    wanted = min(LONGEST, 8 * (na + 1) + nb + delay)
    return max(min(wanted, seen // (PER_LAG * m)), nb + delay + 1)


def _lagged(u: np.ndarray, lags: int) -> np.ndarray:
    """u_j[k - l], (T, m lags): input by input."""
    T, m = u.shape
    padded = np.concatenate([np.zeros((lags, m)), u])
    rows = np.lib.stride_tricks.sliding_window_view(padded, lags, axis=0)[1 : T + 1, :, ::-1]
    return rows.reshape(T, m * lags)


def _impulse_response(data: Sequence[Datum], lags: int) -> np.ndarray:
    """g by least squares on the rows that were seen."""
    M, c = 0.0, 0.0
    for datum in data:
        U = _lagged(datum.u, lags)[datum.seen]
        M, c = M + U.T @ U, c + U.T @ datum.y[datum.seen]
    M = np.asarray(M)
    size = max(float(np.diagonal(M).max(initial=0.0)), np.finfo(float).tiny / RIDGE)
    return np.linalg.solve(M + RIDGE * size * np.eye(len(M)), np.asarray(c)).reshape(-1, lags)


def _denominator(g: np.ndarray, na: int, last: int) -> np.ndarray:
    """a with g_k + Σ a_i g_{k-i} = 0 for k > nb + delay, by least squares."""
    rows, right = [], []
    for row in g:
        for k in range(last + 1, len(row)):
            rows.append([row[k - i] if k >= i else 0.0 for i in range(1, na + 1)])
            right.append(-row[k])
    if not rows or na == 0:
        return np.zeros(na)
    return np.linalg.lstsq(np.array(rows), np.array(right), rcond=1e-8)[0]
