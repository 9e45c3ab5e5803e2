"""Thresholds of rank decisions: yes, no or borderline, by sizes relative to the largest."""

import numpy as np

from .. import checks
from ..kernels.reach import DOUBTFUL, ZERO

MOST_STATES = 500
MOST_WORK = 3e11  # multiplications: some tens of seconds
MOST_STEPS = 200_000  # each costs some 30 µs, even with one state


def judged(ratio: float) -> str:
    """ "no" where a ratio to the largest is rounding (below 1e-12), "borderline" below 1e-8, else "yes".

    >>> judged(0.3), judged(1e-10), judged(0.0)
    ('yes', 'borderline', 'no')
    """
    return "no" if not ratio > ZERO else "borderline" if ratio < DOUBTFUL else "yes"


def scale(variance: np.ndarray) -> np.ndarray:
    """Standard deviations, with 1 instead of 0: divided by them, states and outputs have no units."""
    return np.where(variance > 0, np.sqrt(np.maximum(variance, 0.0)), 1.0)


def check_size(n: int, faults: checks.Faults, *, steps: int = 0) -> None:
    """Report a problem that would take minutes."""
    if n > MOST_STATES:
        faults.add(
            f"`model` must have at most {MOST_STATES} states. Got {n}. Reduce it first, or analyse a part of it."
        )
    elif steps > (most := min(MOST_STEPS, int(MOST_WORK / (30 * max(n, 1) ** 3)))):
        faults.add(f"`horizon` may be at most {most} steps with {checks.counted(n, 'state')}. Got {steps}.")
