"""A state-space model from its Markov parameters (Ho-Kalman, ERA). NumPy, outside jit.

Letters: M_0 = D, M_j = C A^(j-1) B; H block (i, j) is M_(i+j+1), H = Γ Δ with Γ = [C; CA; ..], Δ = [B, AB, ..].

References: B. L. Ho, R. E. Kálmán, Regelungstechnik 14 (1966) 545; J.-N. Juang, R. S. Pappa, J. Guidance 8 (1985) 620.
"""

from typing import NamedTuple

import numpy as np


class Realisation(NamedTuple):
    """A (n, n), B (n, m), C (p, n), D (p, m), and all singular values of the Hankel matrix, the largest first."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    singular_values: np.ndarray


def hankel(M: np.ndarray, rows: int, columns: int) -> np.ndarray:
    """The block Hankel matrix (rows p, columns m) of M (L+1, p, m), from M[1] on."""
    _, p, m = M.shape
    index = 1 + np.arange(rows)[:, None] + np.arange(columns)
    return M[index].transpose(0, 2, 1, 3).reshape(rows * p, columns * m)


def ho_kalman(M: np.ndarray, n: int) -> Realisation:
    """The balanced realisation of order n of M (L+1, p, m), L >= 2: exact where M belongs to a system of order n.

    A maps Γ without its last block to Γ without its first, so that no M beyond M_L is needed.
    """
    L, p, m = len(M) - 1, M.shape[1], M.shape[2]
    rows = (L + 1) // 2 + (L + 1) % 2 if m > p else (L + 1) // 2
    rows = max(min(rows, L - 1), 1) if L > 1 else 1
    H = hankel(M, rows, L - rows)
    shifted = hankel(M[1:], rows, L - rows)
    left, s, right = np.linalg.svd(H, full_matrices=False)
    n = min(n, len(s))
    root = np.sqrt(np.maximum(s[:n], s[:1].max(initial=0.0) * 1e-15 + np.finfo(float).tiny))
    Γ, Δ = left[:, :n] * root, root[:, None] * right[:n]
    A = (left[:, :n] / root).T @ shifted @ (right[:n].T / root)
    return Realisation(A, Δ[:, :m], Γ[:p], M[0], s)


def markov(A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray, length: int) -> np.ndarray:
    """M_0 .. M_length (length+1, p, m)."""
    found, X = [D], B
    for _ in range(length):
        found.append(C @ X)
        X = A @ X
    return np.stack(found)
