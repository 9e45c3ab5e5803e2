"""Squared canonical correlations of the state with past outputs, for any growth. NumPy and LAPACK, outside jit.

Letters: Π = L L' the covariance of the state by the model alone, P = S S' that of the error of its estimate, Π - P = M M' that
of the estimate itself, each by its own recursion of factors, never a difference. The squared correlations ρ² are those of
(M M', Π), and 1 - ρ² those of (P, Π): two sets of singular values, each accurate where it is small.

The basis is the real Schur form by falling |λ|: A is upper triangular by blocks, so that a state of slow growth is made of
states of slower growth only, and Householder's transformations keep the accuracy of each row (N. J. Higham, Accuracy and
Stability of Numerical Algorithms, 2002, Theorem 19.4). Singular values by Jacobi's method (J. Demmel, K. Veselić, SIAM J.
Matrix Anal. Appl. 13 (1992) 1204-1245), which keeps that of graded matrices.
"""

from typing import Any, NamedTuple

import numpy as np

from .shapes import Float
from .square_root_elements import lengths, lower

Real = np.ndarray
CERTAIN = 1e-13  # singular value of L with rows of norm 1, below which a direction has no variance


class StateFactors(NamedTuple):
    """Factors of Π, P and Π - P in the frame: x = frame z."""

    L: Real
    S: Real
    M: Real


def corrected(moments: StateFactors, C: Float[Real, "p n"], V: Float[Real, "p v"]) -> StateFactors:
    """After a sample y = C x + V v."""
    L, S, M = moments
    p, n = C.shape
    both = lower(np.vstack([np.hstack([V, C @ S]), np.hstack([np.zeros((n, V.shape[1])), S])]))
    return StateFactors(L, both[p:, p:], lower(np.hstack([M, both[p:, :p]])))     # the gain times s: K s


def moved(moments: StateFactors, A: Float[Real, "n n"], g: Float[Real, "n w"]) -> StateFactors:
    """After a step x+ = A x + g w."""
    L, S, M = moments
    return StateFactors(lower(np.hstack([A @ L, g])), lower(np.hstack([A @ S, g])), A @ M)


class Pairs(NamedTuple):
    """ρ² and 1 - ρ², the least known first; g (n, r), the functionals of variance 1 to which they belong, and v = Π g;
    and the directions (n, k) without variance."""

    squared: Real
    left: Real
    g: Real
    v: Real
    known: Real


def pairs(moments: StateFactors) -> Pairs:
    """The canonical pairs of (Π - P, Π)."""
    L, S, M = moments
    size = lengths(L)
    unit = np.where(size > 0, size, 1.0)[:, None]
    U, σ, _ = np.linalg.svd(L / unit)
    σ = np.append(σ, np.zeros(len(L) - len(σ)))
    sure = σ <= CERTAIN * σ.max(initial=0.0)
    if sure.any() or L.shape[1] != len(L):
        whiten = lambda F: (U[:, ~sure].T @ (F / unit)) / σ[~sure, None]     # noqa: E731
        to = (U[:, ~sure] / σ[~sure]) / unit                                 # g = to z
    else:
        from scipy.linalg import solve_triangular

        whiten = lambda F: solve_triangular(L / unit, F / unit, lower=True)  # noqa: E731
        to = solve_triangular(L / unit, np.eye(len(L)), lower=True).T / unit
    squared, _ = _jacobi(whiten(M))
    left, W = _jacobi(whiten(S))
    left, squared = np.minimum(left**2, 1.0), np.minimum(squared[::-1] ** 2, 1.0)
    g = to @ W
    return Pairs(squared, left, g, L @ (L.T @ g), U[:, sure] / unit)


def _jacobi(X: Real) -> tuple[Real, Real]:
    """Singular values of X (r, s), falling, and its left singular vectors; each row may have its own size."""
    import scipy.linalg

    lapack: Any = scipy.linalg.lapack

    r = len(X)
    if r == 0 or not X.any():
        return np.zeros(r), np.eye(r)
    tall = np.vstack([X.T, np.zeros((max(r - X.shape[1], 0), r))])
    σ, _, V, work, *_ = lapack.dgejsv(tall, joba=2, jobu=3, jobv=0, jobr=0)
    return σ * work[0] / work[1], V
