"""The judgement of simulations on held-out rows: whether one explains the outputs, and whether two are equally good.

Letters: y an output, x a simulation of it, e = y - x. All rows may be missing (NaN).
"""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..kernels.coloured_noise import colour

EXPLAINED = 5.0  # per cent of fit
SIGNIFICANT = 3.0  # t of the regression of y on x
ROUNDS = 4  # of generalised least squares
SEGMENTS = 10
DIVERGED = 2.0  # rms error in spreads of the output
FEWEST = 2  # rows of a segment


class Behind(NamedTuple):
    """By how much one simulation is worse than another: t of bounded differences over segments, and the ratio of errors."""

    t: float
    ratio: float


def fit_percent(e: np.ndarray, y: np.ndarray) -> np.ndarray:
    """100 (1 - |e| / |y - mean|) of each output, over the seen samples; -inf where the simulation overflows."""
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        spread = np.sqrt(np.nansum((y - np.nanmean(y, axis=0)) ** 2, axis=0))
        found = 100 * (1 - np.sqrt(np.sum(_squares(e, y), axis=0)) / np.where(spread > 0, spread, np.finfo(float).tiny))
    return np.where(np.isnan(found), -np.inf, found)


def _squares(e: np.ndarray, y: np.ndarray) -> np.ndarray:
    """e² where y was seen, infinite where e is not a number there."""
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        squares = np.where(np.isfinite(e), e, np.inf) ** 2
    return np.where(np.isnan(y), 0.0, squares)


def diverged(e: np.ndarray, y: np.ndarray) -> bool:
    """Whether a simulation ran away in some output: its rms error exceeds twice the spread of that output."""
    return bool(np.any(fit_percent(e, y) < 100 * (1 - DIVERGED)))


def behind(e: np.ndarray, best: np.ndarray, y: np.ndarray, ends: Sequence[int] = ()) -> Behind:
    """How far the errors e (T, p) exceed the errors `best`.

    The rows are divided into segments of equal shares of rows and of energy, which end where a record does (`ends`). Of each,
    (E - E*) / (E + E*) is at most 1, so that the explosion of a simulation cannot inflate its own standard error (paired
    differences: Diebold & Mariano 1995).
    """
    variance = np.maximum(np.nanvar(y, axis=0), np.finfo(float).tiny)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        E, E_best = (np.sum(_squares(one, y) / variance, axis=1) for one in (e, best))
        d = []
        for rows in _segments(y, ends):
            one, other = E[rows].sum(), E_best[rows].sum()
            d.append(1.0 if not np.isfinite(one) else 0.0 if one + other == 0 else (one - other) / (one + other))
        ratio = E.sum() / E_best.sum() if E_best.sum() > 0 else (1.0 if E.sum() == 0 else np.inf)
    ratio = np.inf if np.isnan(ratio) else float(ratio)
    spread = np.std(d, ddof=1) / np.sqrt(len(d)) if len(d) > 1 else 0.0
    mean = float(np.mean(d)) if d else 0.0
    return Behind(float(mean / spread) if spread > 0 else (0.0 if mean == 0 else float(np.copysign(1e6, mean))), ratio)


def _segments(y: np.ndarray, ends: Sequence[int]) -> list[slice]:
    """Cuts after equal shares of half rows, half energy."""
    centred = np.nan_to_num(y - np.nanmean(y, axis=0))
    energy = np.sum(centred**2 / np.maximum(np.nanvar(y, axis=0), np.finfo(float).tiny), axis=1)
    share = np.cumsum(0.5 / len(y) + 0.5 * energy / max(energy.sum(), np.finfo(float).tiny))
    cuts = np.unique(np.searchsorted(share, share[-1] * np.arange(1, SEGMENTS) / SEGMENTS))
    ends = [0, *ends, len(y)]
    edges = sorted({*ends, *(int(cut) for cut in cuts if np.abs(np.array(ends) - cut).min() >= FEWEST)})
    return [slice(a, b) for a, b in itertools.pairwise(edges) if b > a]


def explained(e: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Whether the simulation explains each output: it fits more than 5 %, and y depends on it significantly."""
    fits = fit_percent(e, y)
    return np.array([
        bool(fits[i] > EXPLAINED and significance(y[:, i] - e[:, i], y[:, i]) > SIGNIFICANT) for i in range(y.shape[1])
    ])  # fmt: skip


def significance(x: np.ndarray, y: np.ndarray) -> float:
    """t of g in y = c + g x + w, w an autoregression of an order chosen by BIC, by generalised least squares."""
    seen = np.isfinite(x) & np.isfinite(y)
    size = np.std(x[seen]) if seen.sum() > 4 else 0.0
    if not 0 < size < np.inf:
        return 0.0
    X = np.column_stack([np.ones(len(x)), np.where(seen, x / size, np.nan)])
    target, a = np.where(seen, y, np.nan), np.zeros(0)
    t = 0.0
    for _ in range(ROUNDS):
        white, driven = _filtered(a, target), np.column_stack([_filtered(a, column) for column in X.T])
        rows = np.isfinite(white) & np.isfinite(driven).all(axis=1)
        if rows.sum() < 5:
            return t
        g, *_ = np.linalg.lstsq(driven[rows], white[rows], rcond=None)
        residual = white[rows] - driven[rows] @ g
        inverse = np.linalg.pinv(driven[rows].T @ driven[rows])
        scale = np.sqrt(max(residual @ residual / max(rows.sum() - 2, 1) * inverse[1, 1], np.finfo(float).tiny))
        left = target - X @ g
        at = np.flatnonzero(np.isfinite(left))
        t, a = float(g[1] / scale), colour(left[at], at).a
    return t


def _filtered(a: np.ndarray, x: np.ndarray) -> np.ndarray:
    """A(z) x; NaN where a value is missing. The first rows are as they are where A is 1."""
    found = x.copy()
    for lag, one in enumerate(a, 1):
        found = found + one * np.concatenate([np.full(lag, np.nan), x[:-lag]])
    return found
