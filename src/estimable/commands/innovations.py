"""Whether the innovations of a result are what its covariances say."""

from typing import Any

import numpy as np

from ..diagnostics.consistency import Consistency, nis

NOTHING = "no innovation to judge by: no output was seen with noise"


def innovation_check(result: Any) -> Consistency | None:
    """The normalised innovations squared of a result; None where there is nothing to judge by.

    Samples predicted from a state or gain of which nothing was known yet (a diffuse prior) are left out: their
    innovations have no finite covariance.
    """
    if result.innovation is None or result.innovation_covariance is None:
        return None
    known = ~_predicted_from_nothing(result)
    if not np.any(~np.isnan(result.innovation[known])):
        return None
    check = nis(result.innovation[known], result.innovation_covariance[known])
    return check if np.isfinite(check.mean) else None


def described(check: Consistency | None) -> dict[str, Any] | None:
    """A check as JSON holds it."""
    return None if check is None else {**check._asdict(), "consistent": check.consistent, "sentence": check.sentence}


def sentence(check: Consistency | None) -> str:
    """A check in words."""
    return f"Innovation check (NIS): {NOTHING if check is None else check.sentence}."


def _predicted_from_nothing(result: Any) -> np.ndarray:
    """Rows whose prediction had a diffuse part: the first, and those after a row that still has one."""
    parts = [result.diffuse_covariance, result.extra.get("gain_diffuse_covariance")]
    diffuse = np.zeros(len(result.innovation), bool)
    for part in parts:
        if part is not None and part.shape[-1]:
            after = np.any(part != 0, axis=(-2, -1))
            diffuse |= np.concatenate([[True], after[:-1]])
    return diffuse
