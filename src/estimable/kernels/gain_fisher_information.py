"""The information in the outputs about an initial state and constant gains, given the input. NumPy, outside jit.

Letters: x+ = A x + N ζ + ω, y = C x + M ζ + v with ζ the unknowns, the first n of them x[0]; P the covariance of the state due to
the noises alone, X = dx/dζ of its prediction, E = de/dζ of the innovation e, S its covariance.

The innovations of the model's own filter are independent and linear in ζ: the information of ζ is Σ E'S^-1 E (the sensitivities
of B. Friedland, IEEE TAC 14 (1969) 359, with the filter started at P = 0, as x[0] is among the unknowns).
"""

from collections.abc import Iterable

import numpy as np

UNDETERMINED = 1e-10  # singular value of the scaled sensitivities, of the largest, below which a direction is undetermined
CHUNK = 256     # rows gathered before they are made triangular again


def information_factor(rows: Iterable, n: int, unknowns: int) -> np.ndarray:
    """F upper triangular with F'F the information of ζ (unknowns,). Raises `LinAlgError` where some S is singular.

    `rows` of (A, N, C, M, Q, R, Ω V', seen). Cost: that of the Kalman filter and of `unknowns` responses.
    """
    P, X = np.zeros((n, n)), np.eye(n, unknowns)
    gathered, F = [], np.zeros((0, unknowns))
    for A, N, C, M, Q, R, cross, seen in rows:
        C, M, R, cross = C[seen], M[seen], R[np.ix_(seen, seen)], cross[:, seen]
        E = C @ X + M
        L = np.linalg.cholesky(C @ P @ C.T + R)                            # S = L L'
        half = np.linalg.solve(L, np.hstack([E, C @ P @ A.T + cross.T]))   # L^-1 [E, S K']
        white, gain = half[:, :unknowns], half[:, unknowns:]
        X = A @ X + N - gain.T @ white                                     # K E = (S K')' S^-1 E
        P = A @ P @ A.T + Q - gain.T @ gain
        P = (P + P.T) / 2
        gathered.append(white)
        if len(gathered) == CHUNK:
            F, gathered = _triangular(F, gathered), []
    return _triangular(F, gathered)


def _triangular(F: np.ndarray, more: list[np.ndarray]) -> np.ndarray:
    return np.asarray(np.linalg.qr(np.vstack([F, *more]), mode="r"))


def posterior(F: np.ndarray, L: np.ndarray, D: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Covariance of ζ after information F'F, given the prior covariance L L' and diffuse directions D; and the undetermined part.

    The second result holds the directions of ζ of infinite variance, (unknowns, r); the first covers the rest.
    """
    span = np.hstack([L, D])
    prior = np.diag(np.r_[np.ones(L.shape[1]), np.zeros(D.shape[1])])[: L.shape[1]]
    G = np.vstack([F @ span, prior])
    size = np.linalg.norm(G, axis=0)
    size = np.where(size > 0, size, 1.0)
    V, s = _right(G / size)
    determined = s > UNDETERMINED * max(s.max(initial=0.0), 1.0)
    half = span @ (V[:, determined] / size[:, None] / s[determined])
    undetermined = span @ (V[:, ~determined] / size[:, None])
    return half @ half.T, undetermined


def _right(G: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Right singular vectors as columns, and a singular value for each: zero where there are fewer rows."""
    _, s, V = np.linalg.svd(G, full_matrices=True)
    return V.T, np.append(s, np.zeros(G.shape[1] - len(s)))
