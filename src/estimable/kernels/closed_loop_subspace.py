"""Subspace identification from data of a closed loop: SSARX and PBSID. NumPy, outside jit.

Letters: z = (u, y), q = m + p channels; ARX of order P: y[k] = Σ_{j=1..P} g_j' z[k-j] + e[k]; x[k] = T' (z[k-1], .., z[k-P]).
Model: x+ = A x + B u + K e, y = C x + e. All is computed from the factor R of a matrix whose rows hold z[k-1], .., z[k-P] and
z[k], .., z[k+F-1], so that every product of the signals is one of columns of R.

References: M. Jansson, IFAC SYSID (2003) 2077 (SSARX); A. Chiuso, Automatica 43 (2007) 1034, and SIAM J. Control 45 (2006)
(PBSID). y never depends on u of the same row, which a loop would confuse with feedback.
"""

from collections.abc import Sequence
from itertools import accumulate
from typing import NamedTuple

import numpy as np

from .tangents import Dynamics, aligned

RANK = 1e-9  # of the largest singular value: directions of the past below it are exact combinations of others


class Windows(NamedTuple):
    """Factors R (blocks, L, L) of equal parts of the rows, their number N, and the sizes: lags P, rows F ahead, m and p."""

    R: np.ndarray
    N: int
    P: int
    F: int
    m: int
    p: int

    @property
    def whole(self) -> np.ndarray:
        """The factor of all rows."""
        return _factor(self.R.reshape(-1, self.R.shape[-1]))

    def each_left_out(self) -> list[np.ndarray]:
        """For each block the factor of all other rows, from those of the rows before it and of the rows after it."""
        none = np.zeros(self.R.shape[1:])
        before, after = ([*accumulate(one, _joined, initial=none)][:-1] for one in (self.R, self.R[::-1]))
        return [_joined(a, b) for a, b in zip(before, reversed(after), strict=True)]


class InnovationsForm(NamedTuple):
    """A (n, n), B (n, m), C (p, n), K (n, p), the covariance Σ (p, p) of e, and the singular values."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    K: np.ndarray
    Σ: np.ndarray
    singular_values: np.ndarray


def windows(data: Sequence[tuple[np.ndarray, np.ndarray]], P: int, F: int, blocks: int) -> Windows | None:
    """The factors of complete rows of the records (u, y); None with fewer rows than columns in some block left out."""
    (m, p), rows = (data[0][0].shape[1], data[0][1].shape[1]), []
    for u, y in data:
        z, N = np.concatenate([u, y], axis=1), len(u) - P - F + 1
        if N > 0:
            order = [*range(P - 1, -1, -1), *range(P, P + F)]  # z[k-1] first
            rows.append(np.concatenate([z[i : i + N] for i in order], axis=1))
    W = np.concatenate(rows) if rows else np.zeros((0, (P + F) * (m + p)))
    W = W[~np.isnan(W).any(axis=1)]
    if len(W) < 2 * W.shape[1]:
        return None
    return Windows(np.stack([_factor(one) for one in np.array_split(W, blocks)]), len(W), P, F, m, p)


def _factor(W: np.ndarray) -> np.ndarray:
    """R (L, L) of W = Q R, with rows of zeros where W has fewer."""
    R = np.asarray(np.linalg.qr(W, mode="r"))
    return np.concatenate([R, np.zeros((R.shape[1] - len(R), R.shape[1]))])


def _joined(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return _factor(np.concatenate([a, b]))


def ssarx(R: np.ndarray, sizes: Windows, n: int) -> InnovationsForm:
    """The states are the n directions of the past that explain most of the future, less the part due to later z (Jansson)."""
    _, N, P, F, m, p = sizes
    past, now = R[:, : P * (m + p)], R[:, P * (m + p) :].reshape(len(R), F, m + p)
    g = _lstsq(past, now[:, 0, m:]).reshape(P, m + p, p)
    future = []
    for i in range(F):  # (9) y[k+i] less Σ_{j=1..i} g_j' z[k+i-j]
        later = sum((now[:, i - j] @ g[j - 1] for j in range(1, min(i, P) + 1)), np.zeros((len(R), p)))
        future.append(now[:, i, m:] - later)
    Q_f, Q_p = _basis(np.concatenate(future, axis=1)), _basis(past)
    _, s, V = np.linalg.svd(Q_f.T @ Q_p, full_matrices=False)  # canonical correlations
    return _realised(R, sizes, _lstsq(past, Q_p @ V[:n].T) * np.sqrt(N), s)


def pbsid(R: np.ndarray, sizes: Windows, n: int) -> InnovationsForm:
    """The states are the n largest directions of the predictions G Z: row i of G holds at lag j the coefficients g_{i+j}."""
    _, N, P, _, m, p = sizes
    past, y = R[:, : P * (m + p)], R[:, P * (m + p) + m : (P + 1) * (m + p)]
    g = np.concatenate([_lstsq(past, y).reshape(P, m + p, p), np.zeros((P, m + p, p))])
    G = np.concatenate([g[i : i + P].reshape(P * (m + p), p) for i in range(P)], axis=1)
    _, s, V = np.linalg.svd(past @ G, full_matrices=False)
    return _realised(R, sizes, G @ V[:n].T / np.maximum(s[:n], np.finfo(float).tiny) * np.sqrt(N), s)


METHODS = {"ssarx": ssarx, "pbsid": pbsid}


def _realised(R: np.ndarray, sizes: Windows, T: np.ndarray, s: np.ndarray) -> InnovationsForm:
    """C by least squares, then A, B, K from (x, u, e), with x[k] = T' (z[k-1], ..)."""
    _, N, P, _, m, p = sizes
    q, n = m + p, T.shape[1]
    x, z = R[:, : P * q] @ T, R[:, P * q : (P + 1) * q]
    x_next = np.concatenate([z, R[:, : (P - 1) * q]], axis=1) @ T
    u, y = z[:, :m], z[:, m:]
    C = _lstsq(x, y).T
    e = y - x @ C.T
    found = _lstsq(np.concatenate([x, u, e], axis=1), x_next).T
    return InnovationsForm(found[:, :n], found[:, n : n + m], C, found[:, n + m :], e.T @ e / N, s)


def spread(found: InnovationsForm, sizes: Windows, method: str) -> Dynamics:
    """Tangents (blocks, ..) of the estimate by the jackknife: each block of rows is left out in turn."""
    n, blocks = len(found.A), len(sizes.R)
    base = Dynamics(found.A, found.B, found.C, np.zeros((sizes.p, sizes.m)))
    moves = []
    for R in sizes.each_left_out():
        one = METHODS[method](R, sizes, n)
        moves.append(aligned(Dynamics(one.A, one.B, one.C, base.D), base))
    scale = np.sqrt((blocks - 1) / blocks)
    return Dynamics(*(scale * (part - part.mean(axis=0)) for part in map(np.stack, zip(*moves, strict=True))))


def _lstsq(X: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.linalg.lstsq(X, y, rcond=RANK)[0]


def _basis(X: np.ndarray) -> np.ndarray:
    """Orthonormal columns that span those of X."""
    left, s, _ = np.linalg.svd(X, full_matrices=False)
    return left[:, s > RANK * s[0]]
