"""The effect of uncertain model matrices on poles, zeros and responses, to first order. NumPy, outside jit.

Letters: x+ = A x + B u, y = C x + D u. Tangents (dA, dB, dC, dD), r of each: independent moves of one standard deviation, so
that the covariance of anything f of the model is Σ_i df_i df_i'. With Λ = diag(λ), W'V = I: dλ_k = w_k' dA v_k.
"""

from typing import NamedTuple

import numpy as np

from ..frozen import saved
from .innovations_form import FAR, System, response

DEFECTIVE = 1e-8  # w'v of unit vectors, below which an eigenvalue has no derivative
TOGETHER = 10  # tangents whose states are in memory at a time


@saved
class Dynamics(NamedTuple):
    """A (n, n), B (n, m), C (p, n), D (p, m); tangents have a leading axis r."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray


def pole_moves(A: np.ndarray, dA: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Poles (n,) and their moves (r, n), complex; NaN where poles coincide."""
    return _eigenvalue_moves(A, np.eye(len(A)), dA)


def zero_moves(found: Dynamics, d: Dynamics) -> tuple[np.ndarray, np.ndarray]:
    """Finite zeros (k,) of one input to one output and their moves (r, k): where [[A - z I, B], [C, D]] is singular."""
    n = len(found.A)
    P, E = np.block([[found.A, found.B], [found.C, found.D]]), np.diag([*np.ones(n), 0.0])
    dP = np.concatenate([np.concatenate([d.A, d.B], axis=2), np.concatenate([d.C, d.D], axis=2)], axis=1)
    return _eigenvalue_moves(P, E, dP)


def _eigenvalue_moves(P: np.ndarray, E: np.ndarray, dP: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The finite λ of P v = λ E v, and w' dP v / (w' E v)."""
    from scipy.linalg import eig

    with np.errstate(all="ignore"):
        λ, W, V = eig(P, E, left=True, right=True)  # type: ignore[misc]
    scale = np.einsum("ik,ij,jk->k", W.conj(), E, V)
    finite = np.isfinite(λ) & (np.abs(λ) < 1e6)
    moves = np.einsum("ik,rij,jk->rk", W.conj(), dP, V)
    good = np.abs(scale) > DEFECTIVE
    moves = np.where(good, moves / np.where(good, scale, 1.0), np.nan)
    return λ[finite], moves[:, finite]


def frequency_moves(found: Dynamics, d: Dynamics, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """G(z) = C (z I - A)^-1 B + D at each z (K, p, m), and dG (r, K, p, m) = dC X + Y dA X + Y dB + dD."""
    A, B, C, D = found
    N = z[:, None, None] * np.eye(len(A)) - A
    X = np.linalg.solve(N, np.broadcast_to(B, (len(z), *B.shape)).astype(complex))
    Y = np.linalg.solve(N.transpose(0, 2, 1), np.broadcast_to(C.T, (len(z), *C.T.shape)).astype(complex)).transpose(0, 2, 1)
    moves = d.C[:, None] @ X + Y @ (d.A[:, None] @ X) + Y @ d.B[:, None] + d.D[:, None]
    return C @ X + D, moves


def impulse_moves(found: Dynamics, d: Dynamics, length: int) -> tuple[np.ndarray, np.ndarray]:
    """M_0 .. M_length (L+1, p, m) and their moves (r, L+1, p, m)."""
    A, B, C, D = found
    M, dM, X, dX = [D], [d.D], B, d.B
    for _ in range(length):
        M.append(C @ X)
        dM.append(d.C @ X + C @ dX)
        X, dX = np.clip(A @ X, -FAR, FAR), np.clip(d.A @ X + A @ dX, -FAR, FAR)
    return np.stack(M), np.stack(dM, axis=1)


def output_moves(found: Dynamics, d: Dynamics, u: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Moves (r, T, p) of the outputs to u (T, m) from the fixed state x (n,): dx+ = A dx + dA x + dB u."""
    A, B, C, _ = found
    (n, m), p = B.shape, len(C)
    none = np.zeros((n, n))
    states, _ = response(System(A, B, np.eye(n), np.zeros((n, m)), none, none, none), u, x)
    sums = System(A, np.eye(n), C, np.zeros((p, n)), none, none, none)
    moves = []
    for part in np.array_split(np.arange(len(d.A)), max(-(-len(d.A) // TOGETHER), 1)):
        pushed = np.einsum("rij,tj->tir", d.A[part], states) + np.einsum("rij,tj->tir", d.B[part], u)
        carried, _ = response(sums, pushed, np.zeros((n, len(part))))
        direct = np.einsum("rij,tj->tir", d.C[part], states) + np.einsum("rij,tj->tir", d.D[part], u)
        moves.append((carried + direct).transpose(2, 0, 1))
    return np.concatenate(moves)


def aligned(found: Dynamics, base: Dynamics) -> Dynamics:
    """The same system in the states that are nearest to those of `base`: x' = T x with Γ' T = Γ."""
    n = len(base.A)
    Γ, Γ_base = (observability(one, n + 1) for one in (found, base))
    T = np.linalg.lstsq(Γ, Γ_base, rcond=None)[0]
    return Dynamics(np.linalg.solve(T, found.A @ T), np.linalg.solve(T, found.B), found.C @ T, found.D)


def observability(found: Dynamics, blocks: int) -> np.ndarray:
    """[C; CA; ..] (blocks p, n)."""
    rows, X = [], found.C
    for _ in range(blocks):
        rows.append(X)
        X = X @ found.A
    return np.concatenate(rows)


def root(Σ: np.ndarray) -> np.ndarray:
    """L (d, r) with L L' = Σ, without the directions of zero variance."""
    scale = np.sqrt(np.maximum(np.diagonal(Σ), 0.0))
    inverse = np.where(scale > 0, 1 / np.where(scale > 0, scale, 1.0), 0.0)
    values, vectors = np.linalg.eigh(Σ * np.outer(inverse, inverse))
    nonzero = values > 1e-14 * max(values.max(initial=0.0), np.finfo(float).tiny)
    return scale[:, None] * vectors[:, nonzero] * np.sqrt(values[nonzero])
