"""The steady filters of an unknown input, as dense matrices: their closed loops, by iterating the covariance.

Letters: x[k+1] = A x + B d + w, y = C x + D d + v, covariances Q, R and S between w and v; e is the error of the state
predicted from y[0..k-1], e+ = F e + w - K v. Where D has a null space N, the part B N of the last input is still undetermined.
Reference: H. Fang (2009), (2.22)-(2.30) and Algorithm 1; the exact filter by generalised least squares.
"""

from collections.abc import Callable

import numpy as np

Real = np.ndarray
STEPS = 3_000
CONVERGED = 1e-13


def closed_loop(A: Real, B: Real, C: Real, D: Real, Q: Real, R: Real, S: Real) -> float | None:
    """Spectral radius of F of the exact filter, for an input known after one sample at most; None without a limit."""
    return _radius(lambda P: exact_step(A, B, C, D, Q, R, S, P), A, C)


def fang_closed_loop(A: Real, B: Real, C: Real, D: Real, Q: Real, R: Real) -> float | None:
    """Spectral radius of A - L C - (B - L D) H C of Fang's Algorithm 1; None where its covariance has no limit."""
    return _radius(lambda P: fang_step(A, B, C, D, Q, R, P), A, C)


def _radius(step: Callable[[Real], tuple[Real, Real]], A: Real, C: Real) -> float | None:
    P, K = np.eye(len(A)), np.zeros(C.T.shape)
    for _ in range(STEPS):
        K, after = step(P)
        if not np.all(np.isfinite(after)) or np.abs(after).max() > 1e100:
            return None
        moved, P = np.abs(after - P).max(), after
        if moved <= CONVERGED * np.abs(P).max():
            break
    return float(np.abs(np.linalg.eigvals(A - K @ C)).max())


def exact_step(
    A: Real, B: Real, C: Real, D: Real, Q: Real, R: Real, S: Real, P: Real
) -> tuple[Real, Real]:
    """Gain and next covariance: d and the undetermined part of the last input by least squares, then x and w."""
    _, s, V = np.linalg.svd(D)
    rank = int(np.sum(s > 1e-10 * max(s.max(initial=0.0), 1e-300)))
    determined, N = V[:rank].T, V[rank:].T
    open_state = B @ N
    E = np.hstack([C @ open_state, D @ determined])
    W = np.linalg.pinv(C @ P @ C.T + R, hermitian=True)
    H = np.linalg.pinv(E.T @ W @ E, hermitian=True) @ E.T @ W
    rest = W @ (np.eye(len(C)) - E @ H)
    K = A @ (open_state @ H[: N.shape[1]] + P @ C.T @ rest) + B @ determined @ H[N.shape[1] :] + S @ rest
    return K, covariance(A - K @ C, K, P, Q, R, S)


def fang_step(A: Real, B: Real, C: Real, D: Real, Q: Real, R: Real, P: Real) -> tuple[Real, Real]:
    """Gain and next P̂ of Algorithm 1, symmetrised."""
    W = np.linalg.pinv(C @ P @ C.T + R, hermitian=True)                # lines 3 and 4
    H = np.linalg.pinv(D.T @ W @ D, hermitian=True) @ D.T @ W
    E = np.vstack([np.eye(len(A)), -H @ C])
    O = E @ P @ E.T                                                    # lines 5 to 8  # noqa: E741
    O[len(A) :, len(A) :] += H @ R @ H.T
    M, Nn = np.hstack([A, B]), np.hstack([C, D])
    U, T = Nn @ O @ Nn.T + R, M @ O @ Nn.T                             # line 9
    L = T @ np.linalg.pinv(U, hermitian=True)                          # line 10
    after = M @ O @ M.T - L @ T.T + Q                                  # line 11
    return B @ H + L - L @ D @ H, (after + after.T) / 2


def covariance(F: Real, K: Real, P: Real, Q: Real, R: Real, S: Real) -> Real:
    """The covariance of F e + w - K v, (2.27)."""
    after = F @ P @ F.T + Q + K @ R @ K.T - K @ S.T - S @ K.T
    return (after + after.T) / 2
