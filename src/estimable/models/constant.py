"""Checks of a model for steady-state analysis."""

import numpy as np

from .. import checks
from .state_space import StateSpace


def check_constant(model: StateSpace, faults: checks.Faults) -> None:
    """Add a fault if the matrices of the model vary in time."""
    if model.varying:
        faults.add(
            f"a steady-state analysis needs a constant model: {checks.listed(model.varying)} of `model` "
            f"{'has' if len(model.varying) == 1 else 'have'} {model.steps} rows in time."
        )


def check_noise(model: StateSpace, faults: checks.Faults) -> None:
    """Add a fault if R is missing, or if R of a continuous model is singular: an output would be known exactly at all times."""
    if model.R is None:
        faults.add("`model` has no R: give the covariance of the measurement noise, StateSpace(..., R=...).")
    elif model.is_continuous:
        for R in np.reshape(model.R, (-1, model.p, model.p)):
            if not faults.positive_definite("R", R):
                break
