"""Linear least squares that says what the data do not tell. NumPy, outside jit.

Letters: y = Φ θ + e, Φ (N, d). Cost: 4 N d² by the singular value decomposition of R in Φ = Q R.
"""

from typing import NamedTuple

import numpy as np

UNTOLD = 1e-11  # singular value of Φ with columns of norm one, of the largest, below which a direction is not told of


class Regression(NamedTuple):
    """θ (d,) of least norm, (Φ'Φ)^+ (d, d), the basis (d, r) of what is not told of, residuals e (N,), Φ'Φ."""

    θ: np.ndarray
    inverse: np.ndarray
    untold: np.ndarray
    e: np.ndarray
    information: np.ndarray

    @property
    def spare(self) -> int:
        """Rows beyond what θ uses up."""
        return len(self.e) - (len(self.θ) - self.untold.shape[1])

    @property
    def variance(self) -> float:
        """Of e: e'e / (N - d); of rows that are all used up, their mean square."""
        return float(self.e @ self.e) / max(self.spare, 1)


def regress(Φ: np.ndarray, y: np.ndarray) -> Regression:
    """The least-squares fit of y (N,) by the columns of Φ (N, d)."""
    d = Φ.shape[1]
    size = np.linalg.norm(Φ, axis=0)
    scale = 1 / np.where(size > 0, size, 1.0)
    Q, R = np.linalg.qr(Φ * scale)
    left, s, right = np.linalg.svd(R, full_matrices=True)
    kept = np.zeros(d, bool)
    kept[: len(s)] = s > UNTOLD * max(s.max(initial=0.0), np.finfo(float).tiny)
    s_kept = s[kept[: len(s)]]
    told = right[kept].T
    θ = scale * (told @ ((left[:, : len(s)].T @ (Q.T @ y))[kept[: len(s)]] / s_kept))
    inverse = (told / s_kept**2) @ told.T * np.outer(scale, scale)
    untold = np.linalg.qr(scale[:, None] * right[~kept].T)[0]
    return Regression(θ, inverse, untold, y - Φ @ θ, Φ.T @ Φ)


def lagged(x: np.ndarray, lags: range) -> np.ndarray:
    """x[k - lag] (T, lags) of x (T,); NaN before the record."""
    T = len(x)
    columns = [np.concatenate([np.full(min(lag, T), np.nan), x[: max(T - lag, 0)]]) for lag in lags]
    return np.stack(columns, axis=1) if columns else np.zeros((T, 0))
