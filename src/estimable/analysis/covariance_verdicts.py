"""When a requirement is met, and the verdict on each quantity."""

import numpy as np

from . import covariance_courses as courses
from .covariance_models import ArrayQuestion

Real = np.ndarray
EQUAL = 1e-12  # relative excess over a requirement that is rounding


def times(asked: ArrayQuestion, found: courses.Spreads, h: float) -> Real:
    """The time from which on each requirement is met, exact to the sample; NaN where it is not met at the end."""
    return np.array([_time(asked, found, i, h) for i in range(len(asked.names))])


def _time(asked: ArrayQuestion, found: courses.Spreads, i: int, h: float) -> float:
    r = asked.requirement[i]
    unmet = np.flatnonzero(~(found.sigma[:, i] <= r * (1 + EQUAL)))
    if not np.isfinite(r) or (len(unmet) and unmet[-1] == len(found.steps) - 1):
        return float("nan")
    if len(unmet) == 0:
        return found.steps[0] * h
    low, high = found.steps[unmet[-1]], found.steps[unmet[-1] + 1]
    if high == low + 1:
        return high * h
    one = courses.of_quantity(asked.question, i)
    return h * courses.first_met(one, h, low, high, lambda σ: bool(σ[0] <= r * (1 + EQUAL)))


def judge(
    found: courses.Spreads, requirement: Real, since: Real, learnt: float, horizon: float | None
) -> tuple[str, ...]:
    """A verdict on each quantity."""
    return tuple(_verdict(found, i, requirement[i], since[i], learnt, horizon) for i in range(len(requirement)))


def _verdict(found: courses.Spreads, i: int, r: float, since: float, learnt: float, horizon: float | None) -> str:
    σ, σ0 = found.sigma[:, i], found.open[:, i]
    if np.all(σ0 == 0) or (np.isfinite(r) and np.all(σ0 <= r * (1 + EQUAL))):
        return "known already"
    if np.isfinite(since):
        return "known"
    if np.any(σ <= r * (1 + EQUAL)):
        return "lost again"
    with np.errstate(invalid="ignore"):
        left = 1.0 if np.isinf(σ[-1]) else σ[-1] / σ0[-1]
    unbounded = found.hidden[i] and not found.settled[i]
    if left >= 1 - learnt or (found.hidden[i] and np.isfinite(r)) or (unbounded and horizon is None):
        return "never"
    if np.isnan(r):
        return "known"
    return "improves no further" if found.settled[i] and found.limit[i] > r else "still improving"
