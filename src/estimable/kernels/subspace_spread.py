"""The spread of a subspace estimate: estimates from outputs drawn from its own model. NumPy, outside jit.

Letters: those of `subspace`; β = (B, D, x0), y = Φ β. A draw's A and C come from its own factor, by the products of the signals
at all lags; its B and D to first order: δβ = Φ^+ (noise of the outputs - effect of δA and δC on them). Unseen outputs are
those of the simulation, as in the estimate itself.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from . import subspace_algorithms as kernel
from .innovations_form import System, response
from .subspace_algorithms import Factor
from .tangents import Dynamics, aligned, output_moves

RIDGE = 1e-13  # of the diagonal of the products, so that they have a Cholesky factor


class Drawn(NamedTuple):
    """How the estimate is computed, and so each draw (block rows s, order n, weighting, feedthrough)."""

    s: int
    n: int
    weighting: str
    feedthrough: bool


Data = Sequence[tuple[np.ndarray, np.ndarray]]


def spread(base: Dynamics, K: np.ndarray, Σ: np.ndarray, data: Data, how: Drawn, draws: int) -> Dynamics:
    """Tangents (draws, ..) of the estimate on `data` (u, y), the same in every call: their products sum to its covariance."""
    rng, L = np.random.default_rng(0), _root(Σ)
    noises = [_noise(base, K, L, len(u), draws, rng) for u, _ in data]
    regression = _Regression.of(base, data, how.feedthrough)
    A, C = [], []
    for b in range(draws):
        again = [
            (u, still + np.where(np.isnan(y), 0.0, noise[:, :, b]))
            for (u, y), still, noise in zip(data, regression.still, noises, strict=True)
        ]
        found = kernel.shift(products_factor(again, how.s), how.n, how.weighting)
        near = aligned(Dynamics(found.A, base.B, found.C, base.D), base)
        A.append(near.A - base.A)
        C.append(near.C - base.C)
    B, D = regression.moves(base, np.stack(A), np.stack(C), data, noises)
    moves = Dynamics(np.stack(A), B, np.stack(C), D)
    return Dynamics(*((one - one.mean(axis=0)) / np.sqrt(draws - 1) for one in moves))


def _root(Σ: np.ndarray) -> np.ndarray:
    values, vectors = np.linalg.eigh((Σ + Σ.T) / 2)
    return vectors * np.sqrt(np.maximum(values, 0.0))


def _noise(base: Dynamics, K: np.ndarray, L: np.ndarray, T: int, draws: int, rng: np.random.Generator) -> np.ndarray:
    """The part of the outputs due to the innovations, (T, p, draws)."""
    e = np.einsum("pq,tqb->tpb", L, rng.standard_normal((T, len(L), draws)))
    (n, p), none = K.shape, np.zeros((len(K), len(K)))
    return response(System(base.A, K, base.C, np.eye(p), none, none, none), e, np.zeros((n, draws)))[0]


def products_factor(data: Data, s: int) -> Factor:
    """`subspace.factor` by a Cholesky factor of the products of the signals: faster, half the digits."""
    (m, p), total, N = (data[0][0].shape[1], data[0][1].shape[1]), np.zeros(()), 0
    for u, y in data:
        columns = len(u) - 2 * s + 1
        if columns > 0:
            total, N = total + _products(np.concatenate([u, y], axis=1), 2 * s, columns), N + columns
    lags, q = 2 * s, m + p
    order = np.arange(lags * q).reshape(lags, q)
    picked = np.concatenate([order[s:, :m].ravel(), order[:s, :m].ravel(), order[:, m:].ravel()])
    G = total.reshape(lags * q, lags * q)[np.ix_(picked, picked)]
    return Factor(np.linalg.cholesky(G + RIDGE * np.diag(np.diagonal(G))), s, m, p, N)


def _products(z: np.ndarray, lags: int, N: int) -> np.ndarray:
    """Σ_t z[t+i] z[t+j]' over N columns, as (lags, q, lags, q): row i+1 is row i with one term removed and one added."""
    q = z.shape[1]
    G = np.zeros((lags, q, lags, q))
    for j in range(lags):
        G[0, :, j] = z[:N].T @ z[j : j + N]
    for i in range(lags - 1):
        gone, new = np.einsum("a,jb->ajb", z[i], z[: lags - 1]), np.einsum("a,jb->ajb", z[N + i], z[N : N + lags - 1])
        G[i + 1, :, 1:] = G[i, :, :-1] - gone + new
        G[i + 1, :, 0] = G[0, :, i + 1].T
    return G


class _Regression(NamedTuple):
    """y = Φ β at the estimate: Q, R of Φ at the seen rows, their indices, the outputs without noise, the states at row 0."""

    Q: np.ndarray
    R: np.ndarray
    seen: list[np.ndarray]
    still: list[np.ndarray]
    starts: list[np.ndarray]
    feedthrough: bool

    @staticmethod
    def of(base: Dynamics, data: Data, feedthrough: bool) -> "_Regression":
        """The regression at the estimate, each record from the state that fits it best."""
        n, m = base.B.shape
        Φ, y = kernel.regressors(base.A, base.C, data, feedthrough)
        Q, R = np.linalg.qr(Φ)
        fixed = n * m + (len(base.C) * m if feedthrough else 0)
        β = np.concatenate([base.B.ravel(), base.D.ravel()])[:fixed]
        x0 = np.linalg.lstsq(Φ[:, fixed:], y - Φ[:, :fixed] @ β, rcond=1e-12)[0].reshape(len(data), n)
        still = [response(System(*base, *base[:3]), u, start)[0] for (u, _), start in zip(data, x0, strict=True)]
        return _Regression(Q, R, [~np.isnan(one) for _, one in data], still, list(x0), feedthrough)

    def moves(self, base: Dynamics, dA: np.ndarray, dC: np.ndarray, data: Data, noises: list[np.ndarray]) -> tuple:
        """dB and dD (draws, ..)."""
        draws, (n, m), p = len(dA), base.B.shape, len(base.C)
        d = Dynamics(dA, np.zeros((draws, n, m)), dC, np.zeros((draws, p, m)))
        left = []
        for (u, _), seen, start, noise in zip(data, self.seen, self.starts, noises, strict=True):
            moved = output_moves(base, d, u, start).transpose(1, 2, 0)  # (T, p, draws)
            left.append((noise - moved)[seen])
        δβ = np.linalg.lstsq(self.R, self.Q.T @ np.concatenate(left), rcond=1e-12)[0].T
        dD = δβ[:, n * m : n * m + p * m].reshape(draws, p, m) if self.feedthrough else np.zeros((draws, p, m))
        return δβ[:, : n * m].reshape(draws, n, m), dD
