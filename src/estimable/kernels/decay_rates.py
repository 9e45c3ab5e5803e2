"""Overshoot and decay rate, for every rate that the norms of a `Course` prove. NumPy, outside jit.

Letters: a the norms at times t, h between them; λ the factor in a sample (continuous: in a second); γ the overshoot, the
smallest for which a <= γ λ^t. Between two times at a distance h a straight line times e^{αt} is at most e^{(αh)²/8} above
its ends (Hoeffding's lemma).
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from .decay import Course

SEARCH = 1e-10  # relative tolerance of the best rate


class DecayRates:
    """γ and the decay rate as functions of λ: a_N <= λ^t at the last norm bounds all that follow."""

    def __init__(self, course: Course, continuous: bool):
        self.course, self.continuous = course, continuous
        self.t, self.log_a, self.h = course.t, log(course.a), np.diff(course.t)
        self.ends = [log(a + course.ε) for a in (course.a[:-1], course.a[1:])]
        self.dead = course.a[1] == 0
        self.slowest = float(np.min(self.log_a[1:] / self.t[1:]))  # log λ of the fastest decay that is proven
        self.lowest = float(np.exp(self.slowest))

    def decay(self, λ: float) -> float:
        """The decay rate of λ, per sample or per second."""
        return -np.log(λ) if self.continuous else 1 - λ

    def overshoot(self, λ: float) -> float:
        """The smallest γ for which the norms stay below γ λ^t."""
        if λ == 0:
            return 1.0
        α = -np.log(λ)
        at = self.log_a + α * self.t
        if not self.continuous:
            return float(np.exp(np.max(at)))
        line = np.maximum(self.ends[0] + α * self.t[:-1], self.ends[1] + α * self.t[1:]) + (α * self.h) ** 2 / 8
        growing = at[:-1] + max(self.course.ω + α, 0.0) * self.h
        return float(np.exp(max(np.max(at), np.max(np.minimum(line, growing)))))

    def best(self, value: Callable[[float], float]) -> float:
        """The λ with the largest `value`, which has a single maximum."""
        from scipy.optimize import minimize_scalar

        def at(s: float) -> float:
            return np.exp(self.slowest * (1 - s)) if self.continuous else self.lowest + s * (1 - self.lowest)

        found: Any = minimize_scalar(
            lambda s: -value(at(s)), bounds=(0, 1 - 1e-12), method="bounded", options={"xatol": SEARCH}
        )
        return max((λ for λ in (at(float(found.x)), at(0.0)) if λ > 0 or self.dead), key=value)


def log(a: float | np.ndarray) -> Any:
    """The logarithm; minus infinity of 0."""
    with np.errstate(divide="ignore"):
        return np.log(a)
