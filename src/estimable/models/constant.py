"""What an answer in steady state asks of a model."""

import numpy as np

from .. import checks
from .state_space import StateSpace


def check_constant(model: StateSpace, faults: checks.Faults) -> None:
    """Note a model whose matrices vary in time."""
    if model.varying:
        faults.add(
            f"a stationary answer needs a constant model: {checks.listed(model.varying)} of `model` "
            f"{'has' if len(model.varying) == 1 else 'have'} {model.steps} rows in time."
        )


def check_noise(model: StateSpace, faults: checks.Faults) -> None:
    """Note a model without R, and a continuous one whose R is singular: an output known exactly at every instant."""
    if model.R is None:
        faults.add("`model` has no R: give the covariance of the measurement noise, StateSpace(..., R=...).")
    elif model.is_continuous:
        for R in np.reshape(model.R, (-1, model.p, model.p)):
            if not faults.positive_definite("R", R):
                break
