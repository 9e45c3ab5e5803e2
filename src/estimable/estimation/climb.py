"""The search for the maximum of a likelihood: Fisher scoring with the damping of Levenberg and Marquardt.

Reference: D. W. Marquardt, J. SIAM 11 (1963) 431-441; R. I. Jennrich, P. F. Sampson, Technometrics 18 (1976) 11-17 (scoring).
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from .slopes import Ascent

MOST = 200  # steps, accepted or not
FIRST_DAMPING = 1e-4
EASED, HARDENED = 0.1, 8.0  # damping after a step that rose, and after one that did not
FIRMEST = 1e12  # damping: a step is then rounding
RISEN = 1e-8  # rise of the log-likelihood that counts as none
FORESEEN = 1e-7  # rise that the information promises, that counts as none
NEAR = 1e-4  # rise that the information still promises: .014 standard deviations from the maximum
TINY = 1e-300  # room that a bound leaves, instead of none
NULL = 1e-14  # of the largest eigenvalue of the scaled information: the step is zero along directions below it


class Limits(NamedTuple):
    """Bounds of the unknowns (d,), and how far each moves in one step (d,)."""

    lower: np.ndarray
    upper: np.ndarray
    step: np.ndarray


class Climbed(NamedTuple):
    """The end of a search: the unknowns, what the likelihood is there, the number of steps, and whether it has converged.

    It has where the information promises no rise above `NEAR`.
    """

    θ: np.ndarray
    end: Ascent
    steps: int
    converged: bool


def climb(
    at: Callable[[np.ndarray], Ascent],
    start: np.ndarray,
    limits: Limits,
    advance: Callable[[int], object] | None = None,
) -> Climbed:
    """The maximum that is reached from `start`. A trial that fails, or does not rise, is rejected.

    `advance(1)` is called at each step.
    """
    θ, damping = np.clip(start, limits.lower, limits.upper), FIRST_DAMPING
    here = at(θ)
    for count in range(MOST):
        if advance is not None:
            advance(1)
        δ = _step(θ, here, damping, limits)
        if _promise(here, δ) < FORESEEN and damping <= 1:
            return Climbed(θ, here, count, True)
        there = at(θ + δ)
        if not _rises(here, there):
            damping *= HARDENED
            if damping > FIRMEST:
                return Climbed(θ, here, count, _near(θ, here, limits))
            continue
        rise = there.log_likelihood - here.log_likelihood
        θ, here, damping = θ + δ, there, damping * EASED
        if rise < RISEN and _promise(here, _step(θ, here, damping, limits)) < FORESEEN:
            return Climbed(θ, here, count + 1, True)
    return Climbed(θ, here, MOST, _near(θ, here, limits))


def _near(θ: np.ndarray, here: Ascent, limits: Limits) -> bool:
    return _promise(here, _step(θ, here, 0.0, limits._replace(step=np.full(len(θ), np.inf)))) < NEAR


def _rises(here: Ascent, there: Ascent) -> bool:
    """Whether the trial is a number, and no worse."""
    finite = np.isfinite(there.log_likelihood) and np.isfinite(there.score).all() and not there.code
    return bool(finite) and there.log_likelihood >= here.log_likelihood - RISEN


def _step(θ: np.ndarray, here: Ascent, damping: float, limits: Limits) -> np.ndarray:
    """The maximum of the damped parabola in the box of the limits: (H + damping diag H) δ = g where no side holds δ.

    The unknown that goes furthest beyond its side is held there, and the others are solved for again.
    """
    low, high = np.maximum(limits.lower - θ, -limits.step), np.minimum(limits.upper - θ, limits.step)
    g, H = here.score, here.information + damping * np.diag(np.diag(here.information))
    δ, free = np.zeros(len(θ)), np.diag(H) > 0
    while free.any():
        δ[free] = _solved(H[np.ix_(free, free)], g[free] - H[np.ix_(free, ~free)] @ δ[~free])
        with np.errstate(over="ignore"):  # far beyond a bound without room
            beyond = np.where(
                free, np.maximum(δ / np.where(high > 0, high, TINY), δ / np.where(low < 0, low, -TINY)), 0.0
            )
        worst = int(np.argmax(beyond))
        if beyond[worst] <= 1:
            break
        δ[worst], free[worst] = (high if δ[worst] > 0 else low)[worst], False
    return δ


def _solved(H: np.ndarray, g: np.ndarray) -> np.ndarray:
    """The solution of H δ = g of least norm, in units in which H has a unit diagonal."""
    size = np.sqrt(np.diag(H))
    values, vectors = np.linalg.eigh(H / np.outer(size, size))
    known = values > NULL * values.max(initial=0.0)
    along = vectors.T @ (g / size)
    return vectors @ np.where(known, along / np.where(known, values, 1.0), 0.0) / size


def _promise(here: Ascent, δ: np.ndarray) -> float:
    """The rise along δ of the parabola with this score and information."""
    return float(here.score @ δ - δ @ here.information @ δ / 2)
