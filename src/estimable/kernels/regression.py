"""Linear least squares that reports the undetermined directions. NumPy, outside jit.

Letters: y = Φ θ + e, Φ (N, d). Cost: 4 N d² by the singular value decomposition of R in Φ = Q R.
"""

from typing import NamedTuple

import numpy as np

UNDETERMINED = 1e-11  # singular value of Φ with unit columns, relative to the largest, below which a direction is undetermined


class Regression(NamedTuple):
    """θ (d,) of least norm, (Φ'Φ)^+ (d, d), a basis (d, r) of the undetermined directions, residuals e (N,), Φ'Φ."""

    θ: np.ndarray
    inverse: np.ndarray
    undetermined: np.ndarray
    e: np.ndarray
    information: np.ndarray

    @property
    def spare(self) -> int:
        """Rows beyond those that θ needs."""
        return len(self.e) - (len(self.θ) - self.undetermined.shape[1])

    @property
    def variance(self) -> float:
        """The variance of e: e'e / (N - d); without spare rows, the mean square."""
        return float(self.e @ self.e) / max(self.spare, 1)


def regress(Φ: np.ndarray, y: np.ndarray) -> Regression:
    """The least-squares fit of y (N,) by the columns of Φ (N, d)."""
    d = Φ.shape[1]
    size = np.linalg.norm(Φ, axis=0)
    scale = 1 / np.where(size > 0, size, 1.0)
    Q, R = np.linalg.qr(Φ * scale)
    left, s, right = np.linalg.svd(R, full_matrices=True)
    clear = np.zeros(d, bool)
    clear[: len(s)] = s > UNDETERMINED * max(s.max(initial=0.0), np.finfo(float).tiny)
    s_clear = s[clear[: len(s)]]
    determined = right[clear].T
    θ = scale * (determined @ ((left[:, : len(s)].T @ (Q.T @ y))[clear[: len(s)]] / s_clear))
    inverse = (determined / s_clear**2) @ determined.T * np.outer(scale, scale)
    undetermined = np.linalg.qr(scale[:, None] * right[~clear].T)[0]
    return Regression(θ, inverse, undetermined, y - Φ @ θ, Φ.T @ Φ)


def lagged(x: np.ndarray, lags: range) -> np.ndarray:
    """x[k - lag] (T, lags) of x (T,); NaN before the record."""
    T = len(x)
    columns = [np.concatenate([np.full(min(lag, T), np.nan), x[: max(T - lag, 0)]]) for lag in lags]
    return np.stack(columns, axis=1) if columns else np.zeros((T, 0))
