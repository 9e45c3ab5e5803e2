"""Unknown samples of a stationary series, given those around them.

Letters: r_k the autocovariance at lag k, from all pairs of known samples; of a run of unknown samples x with known neighbours z:
E[x | z] = μ + Σ_xz Σ_zz^-1 (z - μ), var[x | z] = r_0 - diag(Σ_xz Σ_zz^-1 Σ_zx). A series that holds its values between jumps is
not Gaussian: where the neighbours differ, x equals one or the other, and its variance is at least (z_1 - z_2)² / 4.
Reference: P. Brockwell, R. Davis, Time Series: Theory and Methods (1991), §2.4.
"""

from collections.abc import Sequence

import numpy as np

from .shapes import Float

NEIGHBOURS = 2  # known samples on each side of a run
ROUNDING = 1e-9  # of r_0, so that Σ_zz has an inverse


def runs_of(mask: np.ndarray) -> list[tuple[int, int]]:
    """First and last + 1 of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def spacing(masks: Sequence[np.ndarray]) -> int:
    """The greatest common divisor of the distances between the seen rows of records; 1 where few are seen."""
    distances = np.concatenate([np.diff(np.flatnonzero(mask)) for mask in masks])
    return int(np.gcd.reduce(distances)) if len(distances) else 1


def autocovariance(x: Float[np.ndarray, " T"], lags: int) -> Float[np.ndarray, " lags"]:
    """r_0 .. of a series with gaps; each lag by its own pairs, and smaller the fewer there are."""
    d = np.nan_to_num(x - np.nanmean(x))
    known = int((~np.isnan(x)).sum())
    return np.array([d[k:] @ d[: len(d) - k] / known for k in range(lags)])


def conditional(x: Float[np.ndarray, " T"]) -> tuple[Float[np.ndarray, " T"], Float[np.ndarray, " T"]]:
    """Means and variances (0 where known) of the samples of a series, NaN where unknown; some sample must be known."""
    unknown = np.isnan(x)
    mean, variance = x.copy(), np.zeros(len(x))
    runs = runs_of(unknown)
    if not runs:
        return mean, variance
    μ, positions = np.nanmean(x), np.flatnonzero(~unknown)
    longest = max(stop - first for first, stop in runs)
    r = autocovariance(x, min(longest + 4 * NEIGHBOURS, len(x)))
    share = np.array([1.0 if k == 0 else _pairs(unknown, k) for k in range(len(r))])
    r = np.where(share > 0, r / np.maximum(share, 1e-3), 0.0)
    for first, stop in runs:
        at = np.searchsorted(positions, first)
        z = positions[max(at - NEIGHBOURS, 0) : at + NEIGHBOURS]
        z = z[np.abs(z - (first + stop - 1) / 2) <= len(r) / 2]
        inside = np.arange(first, stop)
        Σ = _lagged(r, z[:, None] - z[None]) + ROUNDING * max(r[0], 1e-300) * np.eye(len(z))
        cross = _lagged(r, inside[:, None] - z[None])
        K = np.linalg.solve(Σ, cross.T).T if len(z) else np.zeros((len(inside), 0))
        mean[inside] = μ + K @ (x[z] - μ)
        spread = np.clip(r[0] - np.sum(K * cross, axis=1), 0.0, r[0])
        toss = (x[stop] - x[first - 1]) ** 2 / 4 if first > 0 and stop < len(x) else 0.0
        variance[inside] = np.maximum(spread, toss)
    return mean, variance


def _pairs(unknown: np.ndarray, k: int) -> float:
    """The pairs at lag k that are known, relative to the known samples."""
    known = ~unknown
    return float(np.sum(known[k:] & known[: len(known) - k]) / known.sum())


def _lagged(r: np.ndarray, lag: np.ndarray) -> np.ndarray:
    lag = np.abs(lag)
    return np.where(lag < len(r), r[np.minimum(lag, len(r) - 1)], 0.0)
