"""The initial state and the loop gain by one weighted least-squares fit over the whole record.

Letters: z[k] = C x[k] + d[k] θ~ + v[k], x[k+1] = A x[k] + b[k] θ~ + w[k], θ~ = (1, θ), k = 0 .. N-1, with b[k] = [B0 u, B1 u, ..]
and d[k] likewise the effect of the input; all may vary in time. Stacked, z = H (x0, θ) + z0 + V, with V the sum of v and of all
that earlier w have become.
Reference: A. G. Sillence (1999), (72)-(81). Erratum: with process noise (76) is not diagonal, as w[i] is shared by every
later row; with the full covariance used here the estimate and its covariance are those of the recursive form.
"""

from typing import NamedTuple

import numpy as np

from .shapes import Float


class BatchPosterior(NamedTuple):
    """Mean and covariance of (x0, θ), and the covariance of the stacked noise."""

    mean: np.ndarray
    covariance: np.ndarray
    noise_covariance: np.ndarray


class BatchModel(NamedTuple):
    """The model of each row."""

    A: Float[np.ndarray, "N n n"]
    b: Float[np.ndarray, "N n 1+p"]
    C: Float[np.ndarray, "N y n"]
    d: Float[np.ndarray, "N y 1+p"]
    Q: Float[np.ndarray, "N n n"]
    R: Float[np.ndarray, "N y y"]


def batch_posterior(
    mean: Float[np.ndarray, " s"], P: Float[np.ndarray, "s s"], model: BatchModel, z: Float[np.ndarray, "N y"]
) -> BatchPosterior:
    """Condition the prior of (x0, θ) on the whole record. A NaN in z leaves its row out. Cost: about (N y)³ / 3.

    It uses the covariance of z given the prior, so that P may be singular.
    """
    from scipy.linalg import cho_factor, cho_solve

    H, z0, noise = _stack(model)
    seen = ~np.isnan(z.ravel())
    H, e, V = H[seen], (z.ravel() - z0)[seen], noise[np.ix_(seen, seen)]
    PH = P @ H.T
    gain = cho_solve(cho_factor(H @ PH + V), PH.T).T                 # (78) by the matrix inversion lemma
    J = np.eye(len(mean)) - gain @ H
    return BatchPosterior(mean + gain @ (e - H @ mean), J @ P @ J.T + gain @ V @ gain.T, noise)


def _stack(model: BatchModel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """H of (72)-(74), the effect of the known part of the input, and the full covariance of V that replaces (76)."""
    A, b, C, d, Q, R = model
    (N, y, n), p = C.shape, b.shape[2] - 1
    Φ, forced, known = np.eye(n), np.zeros((n, p)), np.zeros(n)
    H, z0 = np.zeros((N, y, n + p)), np.zeros((N, y))
    noise = np.zeros((N, y, N, y))
    Π = np.zeros((n, n))                                             # covariance of the effect of w[0..k-1] on x[k]
    for k in range(N):
        H[k], z0[k] = np.hstack([C[k] @ Φ, C[k] @ forced + d[k, :, 1:]]), C[k] @ known + d[k, :, 0]
        X = Π                                                        # cov(x[j], x[k]) = A[j-1] .. A[k] Π[k], j = k, k+1, ..
        for j in range(k, N):
            noise[j, :, k] = C[j] @ X @ C[k].T
            noise[k, :, j] = noise[j, :, k].T
            X = A[j] @ X
        noise[k, :, k] += R[k]
        Φ, forced, known = A[k] @ Φ, A[k] @ forced + b[k, :, 1:], A[k] @ known + b[k, :, 0]
        Π = A[k] @ Π @ A[k].T + Q[k]
    return H.reshape(N * y, n + p), z0.ravel(), noise.reshape(N * y, N * y)
