"""Tests of a model by the innovations of its filter. Each family of tests is one p-value, of which every test has a share."""

from collections.abc import Iterable

import numpy as np

from . import chi_squared

LAGS = (1, 2, 3, 5, 8)
BLOCKS = (10, 30, 100)  # samples that are summed
BURSTS = (1.0, 3.0)  # seconds over which the size is looked at
FEWEST = 8  # blocks or pairs that a test needs
RANK = 1e-6  # of the largest eigenvalue of the scaled information
MOST_ALARMS = 1e-5  # probability of as many false alarms, below which they count against the model


def whitened(e: np.ndarray, S: np.ndarray) -> np.ndarray:
    """Independent innovations (T, p) of unit variance, output by output, NaN where an output is missing or known exactly.

    Each is what an output adds to those before it: L^-1 e with S = L L'.
    """
    seen = np.isfinite(e) & (np.einsum("tii->ti", np.nan_to_num(S)) > 0)
    pair = seen[:, :, None] & seen[:, None, :]
    L = np.linalg.cholesky(np.where(pair, S, np.eye(e.shape[1])))
    ε = np.linalg.solve(L, np.where(seen, e, 0.0)[..., None])[..., 0]
    return np.where(seen, ε, np.nan)


def size(ε: np.ndarray) -> float:
    """The p-value of the mean square of all innovations, on both sides: too large is as wrong as too small."""
    return both_sides(float(np.nansum(ε**2)), int(np.isfinite(ε).sum()))


def both_sides(value: float, degrees: int) -> float:
    """The p-value of χ² with these degrees of freedom, on both sides."""
    above = float(chi_squared.exceeded(value, degrees)) if degrees else 0.5
    return min(1.0, 2 * min(above, 1 - above))


def shared(found: Iterable[float]) -> float:
    """The p-value of the smallest of several tests (Bonferroni)."""
    values = list(found)
    return min(1.0, len(values) * min(values)) if values else 1.0


def whiteness(ε: np.ndarray) -> float:
    """The p-value of correlations in time, of slow parts, and of correlations between the outputs."""
    columns = [ε[:, i] for i in range(ε.shape[1])]
    slow = (_slow(one, length) for one in columns for length in BLOCKS)
    late = (_product(one[lag:], one[:-lag]) for one in columns for lag in LAGS)
    across = (_product(columns[i], columns[j]) for i in range(len(columns)) for j in range(i))
    return shared(p for p in (*slow, *late, *across) if p is not None)


def _product(a: np.ndarray, b: np.ndarray) -> float | None:
    """The p-value of the mean product of two series, which is normal; None with too few pairs."""
    both = np.isfinite(a) & np.isfinite(b)
    if both.sum() < FEWEST:
        return None
    return normal(float(a[both] @ b[both] / np.sqrt(both.sum())))


def normal(z: float) -> float:
    """The p-value of a standard normal number, on both sides."""
    return float(chi_squared.exceeded(z * z, 1))


def _slow(ε: np.ndarray, length: int) -> float | None:
    """The p-value of the sums over blocks of samples: their squares are χ² with as many degrees of freedom as blocks."""
    blocks = len(ε) // length
    if blocks < FEWEST:
        return None
    parts = ε[: blocks * length].reshape(blocks, length)
    count = np.isfinite(parts).sum(axis=1)
    sums = np.nansum(parts, axis=1)[count > 0] / np.sqrt(count[count > 0])
    return both_sides(float(sums @ sums), len(sums))


def bursts(ε: np.ndarray, step: float) -> float:
    """The p-value of the largest mean square over 1 s and over 3 s; 1 for a record without length."""
    if step <= 0:
        return 1.0
    return shared(
        p for seconds in BURSTS for p in _largest(ε, max(round(seconds / step), 1)) if len(ε) * step > 2 * seconds
    )


def _largest(ε: np.ndarray, length: int) -> list[float]:
    blocks = len(ε) // length
    parts = ε[: blocks * length].reshape(blocks, length * ε.shape[1])
    degrees = np.isfinite(parts).sum(axis=1)
    return [
        float(chi_squared.exceeded(value, k))
        for value, k in zip(np.nansum(parts**2, axis=1), degrees, strict=True)
        if k
    ]


def joint_score(score: np.ndarray, information: np.ndarray) -> float:
    """The p-value of Rao's score test of all directions together: s' H^+ s is χ² of the rank of H."""
    scale = np.sqrt(np.maximum(np.diag(information), 0.0))
    known = scale > 0
    if not known.any():
        return 1.0
    g, H = score[known] / scale[known], information[np.ix_(known, known)] / np.outer(scale[known], scale[known])
    values, vectors = np.linalg.eigh(H)
    kept = values > RANK * values[-1]
    along = (vectors.T @ g)[kept]
    return float(chi_squared.exceeded(float(along @ (along / values[kept])), int(kept.sum())))


def single_scores(score: np.ndarray, information: np.ndarray) -> np.ndarray:
    """The score of each direction by itself in standard deviations (d,), zero for one without information."""
    scale = np.sqrt(np.maximum(np.diag(information), 0.0))
    return np.where(scale > 0, score / np.where(scale > 0, scale, 1.0), 0.0)


def alarms(count: int, seconds: float, between: float) -> float:
    """The p-value of as many alarms, where one in `between` seconds is the most that is false; 1 above `MOST_ALARMS`."""
    from scipy.special import gammainc

    p = float(gammainc(count, seconds / between)) if count else 1.0
    return p if p < MOST_ALARMS else 1.0
