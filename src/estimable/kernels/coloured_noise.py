"""The covariance of a fit by least squares whose residuals are coloured. NumPy, outside jit.

Letters: e (N,) the residuals of the rows seen at times `at` (N,); A(z) e = white, ρ_l their autocorrelation; J (N, d) the
derivatives of the model in these rows; H = Σ_k J_k'J_k, M = Σ_l ρ_l Σ_k J_k'J_(k+l) over pairs of seen rows, both signs of l.
Reference: L. Ljung, System Identification (1999), ch. 9; E. Morelli, V. Klein, J. Guidance, Control and Dynamics 20 (1997).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .output_error_response import over

ORDERS = 10  # most of the autoregression of the residuals
ROUNDING = 1e-7  # of the derivatives with unit columns
ROWS = 10  # residuals for each of its coefficients, at least


class Colour(NamedTuple):
    """a (p,) of A(z) = 1 + a_1 z^-1 + .., and the autocorrelation ρ_0 = 1 .. ρ_p that it reproduces."""

    a: np.ndarray
    ρ: np.ndarray

    def correlation(self, length: int) -> np.ndarray:
        """ρ_0 .. ρ_(length-1): A(z) ρ_l = 0 beyond lag p."""
        driven = np.zeros(max(length, len(self.ρ)))
        driven[: len(self.ρ)] = np.convolve(np.append(1.0, self.a), self.ρ)[: len(self.ρ)]
        return over(self.a, driven)[:length]


WHITE = Colour(np.zeros(0), np.ones(1))


def colour(e: np.ndarray, at: np.ndarray) -> Colour:
    """The stable autoregression of the residuals, from pairwise autocovariances, of an order p of at most 10 by BIC."""
    N = len(e)
    most = min(ORDERS, N // ROWS)
    if most < 1 or not 0 < e @ e < np.inf:
        return WHITE
    r = _autocovariance(e, at, most)
    best, found, a, variance = np.log(r[0]), 0, np.zeros(0), r[0]
    fits = [a]
    for p in range(1, most + 1):  # Levinson's recursion
        k = -(r[p] + a @ r[p - 1 : 0 : -1]) / variance
        if abs(k) >= 1:  # not stable: the pairs of few rows are no autocovariance
            break
        a = np.append(a + k * a[::-1], k)
        variance = variance * (1 - k * k)
        fits.append(a)
        bic = np.log(max(variance, np.finfo(float).tiny)) + p * np.log(N) / N
        if bic < best:
            best, found = bic, p
    return Colour(fits[found], r[: found + 1] / r[0])


def _autocovariance(e: np.ndarray, at: np.ndarray, lags: int) -> np.ndarray:
    """r_0 .. r_lags, each over its own pairs, times 1 - l/T: positive definite where no row is missing."""
    full, seen = _spread(e[:, None], at)[:, 0], _spread(np.ones((len(e), 1)), at)[:, 0]
    T = len(full)
    pairs = [seen[lag:] @ seen[: max(T - lag, 0)] for lag in range(lags + 1)]
    return np.array([
        full[lag:] @ full[: max(T - lag, 0)] / n * (T - lag) / T if n else 0.0 for lag, n in enumerate(pairs)
    ])  # fmt: skip


def moments(J: np.ndarray, at: np.ndarray, noise: Colour) -> np.ndarray:
    """M (d, d), by one convolution of each column with ρ. Cost: O(d T log T + d² N)."""
    if not len(noise.a):
        return J.T @ J
    full = _spread(J, at)
    T = len(full)
    ρ, size = noise.correlation(T), 1 << (2 * T - 1).bit_length()
    circle = np.zeros(size)  # both signs of the lag
    circle[:T], circle[size - T + 1 :] = ρ, ρ[:0:-1]
    ρJ = np.fft.irfft(np.fft.rfft(full, size, axis=0) * np.fft.rfft(circle)[:, None], size, axis=0)[:T]
    M = J.T @ ρJ[at - at[0]]
    return (M + M.T) / 2


def _spread(X: np.ndarray, at: np.ndarray) -> np.ndarray:
    """The rows at their times, zero between them."""
    full = np.zeros((int(at[-1] - at[0]) + 1, X.shape[1]))
    full[at - at[0]] = X
    return full


def times(masks: Sequence[np.ndarray]) -> np.ndarray:
    """The times of the seen rows of records with these masks, which lie so far apart that their rows do not correlate."""
    found, start = [], 0
    for seen in masks:
        found.append(np.flatnonzero(seen) + start)
        start += 2 * len(seen) + ORDERS
    return np.concatenate(found)


def beyond(J: np.ndarray, others: np.ndarray) -> np.ndarray:
    """J (N, d) less its projection on the columns of `others` (N, q), which are estimated too; zero along a direction
    where only rounding remains."""
    if not others.shape[1]:
        return J
    size, own = (np.maximum(np.linalg.norm(X, axis=0), np.finfo(float).tiny) for X in (others, J))
    scaled, J = others / size, J / own
    U, s, V = np.linalg.svd(J - scaled @ np.linalg.lstsq(scaled, J, rcond=1e-12)[0], full_matrices=False)
    return (U * np.where(s > ROUNDING, s, 0.0)) @ V * own
