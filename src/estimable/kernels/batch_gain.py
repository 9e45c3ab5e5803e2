"""The initial state and the loop gain by one weighted least-squares fit over the whole record.

Letters: z[k] = C x[k] + v[k], x[k+1] = A x[k] + B(θ) u[k] + w[k], B(θ) = B0 + Σ θ_i B_i, k = 0 .. N-1. Stacked,
z = H (x0, θ) + z0 + V, with V the sum of v and of all that earlier w have become.
Reference: A. G. Sillence (1999), (72)-(81). Erratum: with process noise (76) is not diagonal, as w[i] is shared by every
later row; with the full covariance used here the estimate and its covariance are those of the recursive form.
"""

from typing import NamedTuple

import numpy as np

from .shapes import Float


class BatchGain(NamedTuple):
    """Mean and covariance of (x0, θ), and the covariance of the stacked noise."""

    mean: np.ndarray
    covariance: np.ndarray
    noise_covariance: np.ndarray


def batch_gain(
    x0: Float[np.ndarray, " n"],
    P0: Float[np.ndarray, "n n"],
    θ0: Float[np.ndarray, " p"],
    Pθ: Float[np.ndarray, "p p"],
    A: Float[np.ndarray, "n n"],
    B0: Float[np.ndarray, "n m"],
    B: Float[np.ndarray, "p n m"],
    C: Float[np.ndarray, "y n"],
    Q: Float[np.ndarray, "n n"],
    R: Float[np.ndarray, "y y"],
    u: Float[np.ndarray, "N m"],
    z: Float[np.ndarray, "N y"],
) -> BatchGain:
    """Condition the prior of (x0, θ) on the whole record. A NaN in z leaves its row out. Cost: about (N y)³ / 3.

    It uses the covariance of z given the prior, so that P0 and Pθ may be singular.
    """
    from scipy.linalg import cho_factor, cho_solve

    N, n = len(z), len(x0)
    H, z0, noise = _stack(A, B0, B, C, Q, R, u, N)
    seen = ~np.isnan(z.ravel())
    H, e, V = H[seen], (z.ravel() - z0)[seen], noise[np.ix_(seen, seen)]
    mean = np.concatenate([x0, θ0])
    P = np.zeros((len(mean), len(mean)))
    P[:n, :n], P[n:, n:] = P0, Pθ
    PH = P @ H.T
    gain = cho_solve(cho_factor(H @ PH + V), PH.T).T                 # (78) by the matrix inversion lemma
    J = np.eye(len(mean)) - gain @ H
    return BatchGain(mean + gain @ (e - H @ mean), J @ P @ J.T + gain @ V @ gain.T, noise)


def _stack(
    A: np.ndarray, B0: np.ndarray, B: np.ndarray, C: np.ndarray, Q: np.ndarray, R: np.ndarray, u: np.ndarray, N: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """H of (72)-(74), the effect of the known part of the input, and the full covariance of V that replaces (76)."""
    n, p, y = len(A), len(B), len(C)
    Φ, forced, known = np.eye(n), np.zeros((n, p)), np.zeros(n)
    H, z0 = np.zeros((N, y, n + p)), np.zeros((N, y))
    noise = np.zeros((N, y, N, y))
    Π = np.zeros((n, n))                                             # covariance of the effect of w[0..k-1] on x[k]
    for k in range(N):
        H[k], z0[k] = C @ np.hstack([Φ, forced]), C @ known
        X = Π                                                        # cov(x[j], x[k]) = A^{j-k} Π[k], j = k, k+1, ..
        for j in range(k, N):
            noise[j, :, k] = C @ X @ C.T
            noise[k, :, j] = noise[j, :, k].T
            X = A @ X
        noise[k, :, k] += R
        Φ, forced, known = A @ Φ, A @ forced + (B @ u[k]).T, A @ known + B0 @ u[k]
        Π = A @ Π @ A.T + Q
    return H.reshape(N * y, n + p), z0.ravel(), noise.reshape(N * y, N * y)
