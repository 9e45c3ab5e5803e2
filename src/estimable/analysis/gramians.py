"""The effect of inputs over a horizon, as a matrix Γ with Γ Γ' the Gramian; and units of the states."""

import numpy as np

from ..models.discretisation import over
from .moments import compressed
from .moments_in_time import NODES, WEIGHTS, substeps


def effects(F: np.ndarray, M: np.ndarray, horizon: float, *, continuous: bool, reverse: bool) -> np.ndarray:
    """[M[K-1], F[K-1] M[K-2], ..] over K steps or seconds; with `reverse`, from row 0: [M[0], F[0] M[1], F[0] F[1] M[2], ..]."""
    rows = max(len(X) if X.ndim == 3 else 1 for X in (F, M))
    count = rows if continuous else int(horizon)
    Γ = np.zeros((F.shape[-1], 0))
    order = range(count - 1, -1, -1) if reverse else range(count)
    for k in order:
        Fk, Mk = (X if X.ndim == 2 else X[min(k, len(X) - 1)] for X in (F, M))
        Γ = _over_time(Γ, Fk, Mk, horizon / rows, rows) if continuous else compressed(Mk, Fk @ Γ)
    return Γ


def _over_time(Γ: np.ndarray, F: np.ndarray, M: np.ndarray, seconds: float, rows: int) -> np.ndarray:
    """A factor of ∫ e^{F s} M M' e^{F s}' ds, by Gauss's rule with four nodes per step."""
    n = len(F)
    steps = substeps(F, n, seconds, rows)
    h = seconds / steps
    Φ = over(F, np.zeros((n, 0)), np.zeros((n, n)), np.append(NODES, 1.0) * h, hold="zero_order")[0]
    N = np.hstack([np.sqrt(w * h) * Φ[i] @ M for i, w in enumerate(WEIGHTS)])
    for _ in range(steps):
        Γ = compressed(N, Φ[4] @ Γ)
    return Γ


def balancing_units(F: np.ndarray, M: np.ndarray) -> np.ndarray:
    """Units of the states (n,), powers of two, in which the rows and columns of F and M have similar sizes.

    States that F does not couple have the sizes that M gives them: a weakly seen state stays weakly seen.
    """
    from scipy.linalg import matrix_balance

    n, p = M.shape
    closed = np.zeros((n + p, n + p))
    closed[:n, :n], closed[:n, n:] = np.abs(F), np.abs(M)
    closed[n:, :n] = np.abs(M).max(initial=0.0) > 0
    return matrix_balance(closed, permute=False, separate=True)[1][0][:n]
