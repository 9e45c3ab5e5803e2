"""The spread of the state of a model that has run for long, and the directions in which it has none.

Letters: x = Z1 a + V b, with a in the stable invariant subspace and V a basis of the other one; a = L x.
"""

from typing import Any, NamedTuple

import numpy as np

from ..kernels.riccati import dlyap

MARGINAL = 1e-9  # of the fastest mode, or of one: a mode as slow as this does not decay


class StateSpread(NamedTuple):
    """The covariance (n, n) of what is stable, the directions (n, r) without a spread, and L (k, n) of the stable part."""

    covariance: np.ndarray
    diffuse: np.ndarray
    stable: np.ndarray

    def leaves_more_unknown_than(self, covariance: np.ndarray) -> bool:
        """Whether another covariance of the state is below this one in every stable direction."""
        P, N = (self.stable @ M @ self.stable.T for M in (self.covariance, covariance))
        size = np.sqrt(np.maximum(np.diagonal(P), np.finfo(float).tiny))
        rest = (P - N) / size[:, None] / size
        return not len(rest) or bool(np.linalg.eigvalsh(rest)[0] >= -1e-9)


def spread(
    A: np.ndarray, GQG: np.ndarray, B: np.ndarray, variance: np.ndarray, diffusion: np.ndarray, dt: float
) -> StateSpread:
    """The spread under process noise and inputs (m,) of a `variance` about the operating point, which wander by `diffusion`.

    Each input is a first-order process, u' = -u g / (2 variance) + noise of density g: its mean square step over a short time s
    is g s. `dt` = 0: continuous.
    """
    from scipy import linalg

    T11, Z1, V, L = _parts(A, dt)
    k, rate = len(T11), np.where(variance > 0, diffusion / np.where(variance > 0, 2 * variance, 1.0), 0.0)
    lasting = variance * (rate == 0)  # inputs that do not move: their effect is that of a constant
    moves = np.flatnonzero((variance > 0) & (rate > 0))
    constant = L @ B @ np.diag(np.sqrt(lasting))
    m = len(moves)
    F, N = np.zeros((k + m, k + m)), np.zeros((k + m, k + m))
    F[:k, :k], F[:k, k:], N[:k, :k] = T11, L @ B[:, moves], L @ GQG @ L.T
    if dt == 0:
        F[k:, k:], N[k:, k:] = -np.diag(rate[moves]), np.diag(diffusion[moves])
        P = linalg.solve_continuous_lyapunov(F, -N) if k + m else N
        steady = linalg.solve(T11, constant) if k else constant
    else:
        ρ = np.exp(-rate[moves] * dt)
        F[k:, k:], N[k:, k:] = np.diag(ρ), np.diag(variance[moves] * (1 - ρ**2))
        P = dlyap(F, N) if k + m else N
        steady = linalg.solve(np.eye(k) - T11, constant) if k else constant
    P = P[:k, :k] + steady @ steady.T
    return StateSpread(Z1 @ ((P + P.T) / 2) @ Z1.T, V, L)


def _parts(A: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The stable block T11 (k, k) of a Schur form, Z1 (n, k), V (n, n - k) and L (k, n)."""
    from scipy import linalg

    fastest = max(np.abs(np.linalg.eigvals(A)).max(initial=0.0), np.finfo(float).tiny)

    def decays(real: complex, imaginary: float = 0.0) -> bool:
        mode = complex(real) + 1j * float(np.real(imaginary))
        return mode.real < -MARGINAL * fastest if dt == 0 else abs(mode) < 1 - MARGINAL

    schur: Any = linalg.schur(A, output="real", sort=decays)
    T, Z, k = schur
    X = linalg.solve_sylvester(T[:k, :k], -T[k:, k:], -T[:k, k:]) if 0 < k < len(A) else np.zeros((k, len(A) - k))
    V = Z[:, :k] @ X + Z[:, k:]
    return T[:k, :k], Z[:, :k], V / np.linalg.norm(V, axis=0), Z[:, :k].T - X @ Z[:, k:].T


def growth_time(A: np.ndarray, dt: float) -> float | None:
    """The time constant of the fastest unstable mode; inf where a mode is marginal and none unstable; None: all are stable."""
    modes = np.linalg.eigvals(A)
    fastest = np.abs(modes).max(initial=0.0)
    rates = modes.real if dt == 0 else np.log(np.maximum(np.abs(modes), 1e-300)) / dt
    slow = MARGINAL * (fastest if dt == 0 else 1 / dt)
    worst = float(rates.max(initial=-np.inf))
    return None if worst < -slow else np.inf if worst <= slow else 1 / worst
