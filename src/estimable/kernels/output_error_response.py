"""The response of one output of an output-error model, its derivatives, and their information. NumPy, one call a record.

Letters: x = (B u + z)/A with z impulses that represent the past before the first sample, ψ = dx/dθ, θ = (a, b).
"""

import numpy as np


def response(a: np.ndarray, b: np.ndarray, delay: int, u: np.ndarray, z: np.ndarray | None = None) -> np.ndarray:
    """x (T,) of a (na,), b (m, nb+1), u (T, m); z (n,) enters at the first n samples (the effect of the past)."""
    return over(a, _driven(b, delay, u, z))


def slopes(a: np.ndarray, b: np.ndarray, delay: int, u: np.ndarray, x: np.ndarray) -> np.ndarray:
    """ψ (T, d): dx/da_i = -z^-i x / A and dx/db_jl = z^-(delay+l) u_j / A. Cost: O(T d)."""
    T, lags = len(u), b.shape[1]
    x_filtered, *u_filtered = over(a, np.column_stack([x, u])).T
    columns = [-delayed(x_filtered, i + 1) for i in range(len(a))]
    for u_j in u_filtered:
        columns += [delayed(u_j, delay + lag) for lag in range(lags)]
    return np.stack(columns, axis=1) if columns else np.zeros((T, 0))


def initial_slopes(a: np.ndarray, rows: int, n: int) -> np.ndarray:
    """dx/dz (T, n): the impulse response of 1/A, from each of the first n samples on."""
    impulse = over(a, np.eye(1, rows)[0])
    return np.stack([delayed(impulse, j) for j in range(n)], axis=1) if n else np.zeros((rows, 0))


def information(ψ: np.ndarray, seen: np.ndarray, r: np.ndarray | float) -> np.ndarray:
    """Fisher's information of θ in the samples that were seen: Σ ψ ψ' / r, with r (T,), or one for all."""
    return ψ[seen].T @ (ψ[seen] / np.broadcast_to(r, seen.shape)[seen, None])


def _driven(b: np.ndarray, delay: int, u: np.ndarray, z: np.ndarray | None) -> np.ndarray:
    """B u + z."""
    T = len(u)
    driven = np.zeros(T)
    for j, lag in np.ndindex(b.shape):
        driven += b[j, lag] * delayed(u[:, j], delay + lag)
    if z is not None:
        n = min(len(z), T)
        driven[:n] += z[:n]
    return driven


def over(a: np.ndarray, x: np.ndarray) -> np.ndarray:
    """x / A, of x (T,) or of each column of x (T, k); an unstable A overflows to infinity and not to NaN."""
    from scipy.linalg.lapack import dtbtrs  # type: ignore[attr-defined]  scipy.signal takes a second to import

    band = np.repeat(np.append(1.0, a)[: len(x), None], len(x), axis=1)
    found, _ = dtbtrs(band, x, uplo="L", diag="U")
    return found if np.isfinite(found).all() else np.nan_to_num(found, nan=np.inf, posinf=np.inf, neginf=-np.inf)


def delayed(x: np.ndarray, steps: int) -> np.ndarray:
    """z^-steps x, from rest."""
    return np.concatenate([np.zeros(min(steps, len(x))), x[: max(len(x) - steps, 0)]])
