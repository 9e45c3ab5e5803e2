"""Comparison of a linear model with a record: simulation, one-step predictions, and tests of their residuals."""

from collections.abc import Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from ..data.record import Record
from ..diagnostics.innovations import in_sigmas
from ..kernels.innovations_form import System, initial_state, predictions, response
from ..models.armax import ARMAX
from ..models.arx import ARX
from ..models.output_error import OutputError
from ..models.state_space import StateSpace
from ..results import Check, Validation
from .residuals import residual_checks
from .validation import fit_percent

LinearModel: TypeAlias = StateSpace | ARX | ARMAX | OutputError


class Standing(NamedTuple):
    """Outputs minus the model's, (T, p), NaN where not seen: simulated from the inputs alone, and predicted one step ahead.

    `standardised`: the second divided by their standard deviations, (T, p). `outputs` (T, p) of the simulation,
    from `state` (n,), a deviation from the operating point.
    """

    simulated: np.ndarray
    one_step: np.ndarray
    standardised: np.ndarray
    outputs: Any = None
    state: Any = None


def state_space_of(model: LinearModel) -> StateSpace:
    """A model of any kind as a state-space model."""
    return model if isinstance(model, StateSpace) else model.to_state_space()


def standing(model: StateSpace, record: Record, rows: int | None = None) -> Standing:
    """Compare a discrete model with a record.

    The simulation starts from the state at row 0 with which it is nearest to the first `rows` rows (None: all); later rows have
    no effect on it. An unknown input is replaced by the value before it.
    """
    system = system_of(model)
    u, y = held(record.applied()), record.y
    if model.operating_point is not None:
        u, y = u - model.operating_point.inputs, y - model.operating_point.outputs
    x = initial_state(system, u[:rows], y[:rows])
    simulated, _ = response(system, u, x)
    predicted, V, _ = predictions(system, u, y, x, np.zeros((len(x), len(x))))
    level = 0.0 if model.operating_point is None else model.operating_point.outputs
    if record.sigma is not None:  # methods that weigh samples have no process noise: V is R
        own = np.diagonal(V, axis1=1, axis2=2)
        V = V + np.eye(len(system.C)) * np.where(np.isnan(record.sigma), 0.0, record.sigma**2 - own)[:, None]
    return Standing(y - simulated, y - predicted, in_sigmas(y - predicted, V), simulated + level, x)


def system_of(model: StateSpace) -> System:
    """The matrices of a constant model, with the noise as it enters the state."""
    G, S = np.asarray(model.G), model.S
    cross = np.zeros((model.n, model.p)) if S is None else G @ S
    Q = np.zeros((model.n, model.n)) if model.Q is None else G @ model.Q @ G.T
    return System(model.A, model.B, model.C, model.D, Q, model.R, cross)


def held(u: np.ndarray) -> np.ndarray:
    """The inputs; an unknown one is replaced by the value before it (0 at the start)."""
    rows = np.maximum.accumulate(np.where(np.isnan(u), 0, np.arange(len(u))[:, None]), axis=0)
    return np.nan_to_num(np.take_along_axis(u, rows, axis=0))


def validation_of(
    model: LinearModel, records: Sequence[Record], extra: Sequence[Check] = (), coloured: str = ""
) -> Validation:
    """Compare a model with the records it was fitted to: the residuals are those of the simulation.

    `coloured`: what predictable residuals mean for this method, in place of the general advice.
    """
    found = [standing(state_space_of(model), record) for record in records]
    residuals, one_step = tuple(one.simulated for one in found), tuple(one.one_step for one in found)
    direct = bool(np.any(state_space_of(model).D))
    white = residual_checks([one.standardised for one in found], records, coloured, direct=direct)
    return Validation(
        residuals, fit_percent(residuals, records), (*extra, *white), fit_percent(one_step, records), one_step
    )
