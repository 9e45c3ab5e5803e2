"""Invariant zeros: the exponents of inputs that have no effect on the outputs.

Letters: the system (A, B, C, D). Reference: A. Emami-Naeini, P. Van Dooren, Automatica 18 (1982) 415-430.
"""

from typing import NamedTuple

import numpy as np

RANK = 1e-11  # a singular value this far below the size of the (scaled) system is rounding


class Zeros(NamedTuple):
    """The finite invariant zeros, and the rank of the transfer function: the number of distinguishable inputs."""

    values: np.ndarray
    normal_rank: int


def invariant_zeros(A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray) -> Zeros:
    """The zeros of (A, B, C, D), for any shape and ranks.

    >>> zeros = invariant_zeros([[0.5]], [[1.0]], [[1.0]], [[0.5]])
    >>> zeros.values.real.round(12).tolist(), zeros.normal_rank
    ([-1.5], 1)
    """
    A, B, C, D = _scaled(*(np.atleast_2d(np.asarray(M, float)) for M in (A, B, C, D)))
    tolerance = RANK * max(float(np.linalg.norm(np.block([[A, B], [C, D]]), 2)), 1e-300)
    A, B, C, D = _without_silent_states(A, B, C, D, tolerance)
    A, C, B, D = (M.T for M in _without_silent_states(A.T, C.T, B.T, D.T, tolerance))
    if len(A) == 0:
        return Zeros(np.zeros(0, complex), len(D))
    return Zeros(np.sort_complex(np.linalg.eigvals(A - B @ np.linalg.solve(D, C)).astype(complex)), len(D))


def _scaled(A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray):
    """The same zeros in balanced units of states, inputs and outputs."""
    from scipy.linalg import matrix_balance

    n = len(A)
    A, T = matrix_balance(A, permute=False)
    B, C = np.linalg.solve(T, B), C @ T
    rows = np.abs(np.hstack([C, D])).max(axis=1, initial=0.0)
    C, D = C / np.where(rows > 0, rows, 1.0)[:, None], D / np.where(rows > 0, rows, 1.0)[:, None]
    columns = np.abs(np.vstack([B, D])).max(axis=0, initial=0.0)
    assert len(A) == n
    return A, B / np.where(columns > 0, columns, 1.0), C, D / np.where(columns > 0, columns, 1.0)


def _without_silent_states(A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray, tolerance: float):
    """The system with the same zeros and a D of full row rank: states that the outputs determine become outputs."""
    while True:
        U, s, _ = np.linalg.svd(D) if D.size else (np.eye(len(D)), np.zeros(0), None)
        rank = int(np.sum(s > tolerance))
        C, D = U.T @ C, (U.T @ D)[:rank]
        fixed, C = C[rank:], C[:rank]
        _, s, V = np.linalg.svd(fixed) if fixed.size else (None, np.zeros(0), np.eye(len(A)))
        ν = int(np.sum(s > tolerance))
        if ν == 0:
            return A, B, C, D
        T = np.vstack([V[ν:], V[:ν]])  # x = T' z: the outputs determine the last ν states
        A, B, C, free = T @ A @ T.T, T @ B, C @ T.T, len(A) - ν
        C, D = np.vstack([C[:, :free], A[free:, :free]]), np.vstack([D, B[free:]])
        A, B = A[:free, :free], B[:free]
