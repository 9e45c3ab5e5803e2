"""Tests of one assumption at a time by the residuals of a fit. NumPy, outside jit.

Letters: e (N,) the residuals of the seen rows, r their variance, J (N, d) the derivatives of the fit, z (N,) what a failed
assumption would add to the outputs, z~ = z less its projection on J. h the impulse response of the fit.
Reference: C. R. Rao (1948) for the score; W. Newey, K. West (1987) for the sums over lags.
"""

from typing import NamedTuple

import numpy as np

from .coloured_noise import colour, moments
from .regression import regress

LAGS = 10  # of Bartlett's weights
MOST = 3.0  # exponent of the mixture, so that one sample does not decide
ROUNDS = 3  # of weighted least squares
GONE = 1e-6  # of the size of z: what J leaves of it is rounding


def scores(Z: np.ndarray, J: np.ndarray, e: np.ndarray, at: np.ndarray) -> np.ndarray:
    """t = z~'e / sqrt(z~'R z~) of each column of Z (N, q), R of the spectrum of e; 0 for what the fit contains."""
    size = np.linalg.norm(J, axis=0)
    scaled = J / np.where(size > 0, size, 1.0)
    own = Z - scaled @ np.linalg.lstsq(scaled, Z, rcond=1e-12)[0]
    r = float(e @ e) / max(len(e) - J.shape[1], 1)
    variance = r * np.diagonal(moments(own, at, colour(e, at)))
    known = (np.linalg.norm(own, axis=0) > GONE * np.linalg.norm(Z, axis=0)) & (variance > 0)
    return np.where(known, own.T @ e / np.sqrt(np.where(known, variance, 1.0)), 0.0)


def dependence(seen: np.ndarray, x: np.ndarray) -> float:
    """t of the correlation between which rows were seen and x (T,)."""
    s = seen - seen.mean()
    terms = s * (x - x.mean())
    variance = long_run(terms - terms.mean())
    return float(terms.sum() / np.sqrt(len(terms) * variance)) if variance > 0 else 0.0


def long_run(terms: np.ndarray) -> float:
    """The variance of the sum of a series of mean zero, per row, with Bartlett's weights."""
    N = len(terms)
    found = float(terms @ terms) / N
    for lag in range(1, min(LAGS, N - 1) + 1):
        found += 2 * (1 - lag / (LAGS + 1)) * float(terms[lag:] @ terms[:-lag]) / N
    return max(found, 0.0)


def stale(e: np.ndarray, D: np.ndarray) -> float:
    """t of the mixture score of samples that repeat the one before: there e is about D = x[k-1] - x[k].

    w = exp((e D - D²/2) / s²) - 1, less the same with -e, which has mean zero for symmetric noise.
    """
    s2 = min(float(np.mean(e**2)), float(1.4826 * np.median(np.abs(e))) ** 2)
    if not s2 > 0:
        return 0.0
    w, mirrored = (np.exp(np.minimum((sign * e * D - D**2 / 2) / s2, MOST)) for sign in (1, -1))
    terms = w - mirrored
    spread = float(np.std(terms))
    return float(terms.mean() / spread * np.sqrt(len(terms))) if spread > 0 else 0.0


class Losses(NamedTuple):
    """(1 - λ) / λ of the rate λ at which inputs arrive, and its standard deviation."""

    β: float
    sigma: float


def losses(e: np.ndarray, S: np.ndarray) -> Losses | None:
    """The regression of e² (N,) on S = Σ_j h_j² u²[k-j] and 1: independent losses give e² the mean β S + s²."""
    if not np.std(S) > 1e-6 * max(float(np.mean(S)), np.finfo(float).tiny):
        return None
    X, weight = np.column_stack([S, np.ones(len(S))]), np.ones(len(S))
    found = regress(X, e**2)
    for _ in range(ROUNDS - 1):
        weight = 1 / np.maximum(X @ found.θ, 0.1 * np.mean(e**2))
        found = regress(X * weight[:, None], e**2 * weight)
    left = (e**2 - X @ found.θ) * weight
    terms = (X * weight[:, None] * left[:, None]) @ found.inverse[0]
    return Losses(float(found.θ[0]), float(np.sqrt(len(terms) * long_run(terms))))
