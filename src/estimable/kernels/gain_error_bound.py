"""The Cramér-Rao bound of constant gains, and the dither needed to determine them. NumPy, outside jit.

Letters: ζ = (x[0], θ), n + p unknowns; F with F'F the information about them. A prior is (L, D): a covariance L L', and
directions D of infinite variance. In a factor of n + 2 p columns the last p are those of a dither. A dither a times as large
adds a times these columns to those of θ.

The outputs are linear in ζ and Gaussian, so the best unbiased estimate attains the bound.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from .echelon import echelon
from .gain_fisher_information import posterior

Real = np.ndarray
Belief = tuple[Real, Real]  # (L, D)
SILENT = 1e-8       # share of a gain in a direction, in units of the known part, below which it counts as zero
ROUNDING = 1e-13    # of an input and a dither that cancel: the remainder is rounding
GRID = 400          # amplitudes tried below a sufficient one, as the bound need not fall monotonically
DOUBLINGS = 30      # of the amplitude, after which no amplitude is taken to be enough


def belief(P: Real, D: Real | None) -> Belief:
    """A prior of covariance P, which may be singular, and directions D of infinite variance."""
    λ, V = np.linalg.eigh(P)
    return V * np.sqrt(np.maximum(λ, 0.0)), np.zeros((len(P), 0)) if D is None else D


def no_belief(size: int) -> Belief:
    """A prior without any information."""
    return np.zeros((size, 0)), np.eye(size)


def with_dither(factor: Real, n: int, p: int, a: float) -> Real:
    """F (.., n + p) with the dither a times as large."""
    F = factor[:, : n + p]
    if factor.shape[1] == n + p:
        return F
    added = np.hstack([np.zeros((len(F), n)), a * factor[:, n + p :]])
    terms = np.linalg.norm(F, axis=0) + np.linalg.norm(added, axis=0)
    F = F + added
    return np.where(np.linalg.norm(F, axis=0) > ROUNDING * terms, F, 0.0)


def bound(F: Real, of_state: Belief, of_gain: Belief) -> tuple[Real, Real]:
    """The covariance (p, p) of the best unbiased estimate of θ, infinite where F and the priors determine nothing, and the
    directions (r, p) of θ about which F carries no information."""
    n, p = len(of_state[0]), len(of_gain[0])
    hidden = _of_gains(posterior(F, *_joint(of_state, no_belief(p)))[1], F, n)
    P, left = posterior(F, *_joint(of_state, of_gain))
    silent = np.abs(_of_gains(left, F, n)).max(axis=0, initial=0.0) > SILENT
    P = np.where(silent[:, None] | silent, 0.0, P[n:, n:])
    P[silent, silent] = np.inf
    return P, hidden


def _joint(of_state: Belief, of_gain: Belief) -> tuple[Any, Any]:
    from scipy.linalg import block_diag

    (L, D), (M, H) = of_state, of_gain
    return block_diag(L, M), block_diag(D, H)


def _of_gains(Z: Real, F: Real, n: int) -> Real:
    """The part of θ in directions Z (n + p, r) of ζ, rows of norm 1."""
    size = np.linalg.norm(F, axis=0)
    size = np.where(size > 0, size, 1.0)
    scaled = Z * size[:, None]
    scaled = scaled / np.maximum(np.linalg.norm(scaled, axis=0), np.finfo(float).tiny)
    U, s, _ = np.linalg.svd(scaled[n:], full_matrices=False)
    basis = U[:, s > SILENT] / size[n:, None]
    return echelon(basis / np.linalg.norm(basis, axis=0)).T


def first_amplitude(factor: Real, p: int, σ: Real) -> float:
    """The a at which the dither outweighs the input, and that would be enough for σ (p,) if only θ were unknown."""
    of_input, of_dither = np.linalg.norm(factor[:, -2 * p : -p], axis=0), np.linalg.norm(factor[:, -p:], axis=0)
    some = of_dither > 0
    return float(np.max((4 * of_input[some] + 1 / σ[some]) / of_dither[some], initial=0.0)) or 1.0


def smallest_amplitude(worst: Callable[[float], float], start: float) -> float | None:
    """The a above which worst(a) stays at most 1, searched below the first doubling of `start` that meets this."""
    from scipy.optimize import brentq

    enough = next((start * 2.0**k for k in range(DOUBLINGS) if worst(start * 2.0**k) <= 1), None)
    if enough is None:
        return None
    tried = np.linspace(0.0, enough, GRID)
    short = [i for i, a in enumerate(tried[:-1]) if worst(a) > 1]
    if not short:
        return 0.0
    lower, upper = tried[short[-1]], tried[short[-1] + 1]
    root: Any = brentq(lambda a: min(worst(a), 1e6) - 1, lower, upper, xtol=1e-14 * enough)
    return float(root)
