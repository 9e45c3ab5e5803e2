"""Expected covariances when samples are lost. NumPy, outside jit.

Letters: X a covariance of the one-step prediction, λ the arrival rate, F = A - K C; noise covariances Q, R, N = cov(w, v).

g(X) = A X A' + Q - λ (A X C' + N)(C X C' + R)^-1 (A X C' + N)' is the least over K of
(1-λ)(A X A' + Q) + λ (F X F' + Q - K N' - N K' + K R K'). Policy iteration therefore solves X = g(X) from any K for which
(1-λ) A(x)A + λ F(x)F has a spectral radius below 1. The existence of such a K is also necessary.

Reference: B. Sinopoli, L. Schenato, M. Franceschetti, K. Poolla, M. I. Jordan, S. S. Sastry, IEEE TAC 49 (2004) 1453,
(14), Theorems 2-5.
"""

import numpy as np

STEPS = 4096        # of g, after which no K is taken to exist
POLICIES = 60
HUGE = 1e12         # of the start, beyond which g is taken to grow without bound

Real = np.ndarray


def gain(A: Real, C: Real, R: Real, N: Real, X: Real) -> Real:
    """K = (A X C' + N)(C X C' + R)^-1."""
    return np.linalg.solve(C @ X @ C.T + R, (A @ X @ C.T + N).T).T


def radius(A: Real, C: Real, K: Real, λ: float) -> float:
    """The spectral radius of the growth of the expected covariance under the gain K."""
    F = A - K @ C
    return float(np.abs(np.linalg.eigvals((1 - λ) * np.kron(A, A) + λ * np.kron(F, F))).max())


def stabilising_gain(A: Real, C: Real, Q: Real, R: Real, N: Real, λ: float) -> Real | None:
    """A K for which the expected covariance stays bounded; None where the iteration of g finds none."""
    X, start, check = Q.copy(), np.trace(Q), 1
    for k in range(1, STEPS + 1):
        K = gain(A, C, R, N, X)
        if k == check:
            if radius(A, C, K, λ) < 1:
                return K
            check *= 2
        X = A @ X @ A.T + Q - λ * K @ (A @ X @ C.T + N).T
        X = (X + X.T) / 2
        if np.trace(X) > HUGE * start:
            return None
    return None


def upper_covariance(A: Real, C: Real, Q: Real, R: Real, N: Real, λ: float) -> Real | None:
    """The X with X = g(X); None where there is none."""
    n = len(A)
    K = stabilising_gain(A, C, Q + np.eye(n) * max(np.trace(Q) / n, 1e-300), R, N, λ)
    if K is None:
        return None
    X = np.full((n, n), np.inf)
    for _ in range(POLICIES):
        F = A - K @ C
        constant = Q - λ * (K @ N.T + N @ K.T - K @ R @ K.T)
        grows = (1 - λ) * np.kron(A, A) + λ * np.kron(F, F)
        new = np.linalg.solve(np.eye(n * n) - grows, constant.ravel()).reshape(n, n)
        X, old = (new + new.T) / 2, X
        K = gain(A, C, R, N, X)
        if np.abs(X - old).max() <= 1e-14 * np.abs(X).max():
            break
    return X
