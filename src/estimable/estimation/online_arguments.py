"""The arguments of a run sample by sample: its known inputs, and the length of a step."""

from typing import Any

import numpy as np

from .. import checks
from ..annotations import Array, Numbers
from ..data.record_arguments import UNIFORM
from ..models.nonlinear_model import NonlinearModel
from ..models.state_space import StateSpace
from ..protocols import Algorithm
from .binding import model_of


class KnownInputs:
    """The columns of the known inputs in the model (all but those of an `UnknownInput`), and their values at rest."""

    def __init__(self, algorithm: Algorithm[Any]):
        model = model_of(algorithm)
        self.columns = [model.inputs.index(name) for name in algorithm.names.inputs]
        known = "" if len(self.columns) == model.m else "known "
        self.counted = checks.counted(len(self.columns), f"{known}input")
        point = model.operating_point
        self.rest = np.zeros(len(self.columns)) if point is None else point.inputs[self.columns]
        self.direct = bool(model.feeds_through(self.columns))
        self.any_fate = algorithm.takes_unknown_arrivals

    def applied(
        self, u: Numbers, arrived: Numbers | None, lost: Array | float, faults: checks.Faults, *, nan: bool
    ) -> Any:
        """The input that the actuator applies: u where it arrived, else `lost`. `nan`: an input may be unknown."""
        faults.learn("m", len(self.columns), f"the model has {self.counted}")
        sent = faults.array("u", u, "m", nan=nan)
        if arrived is None or sent is None:
            return sent
        fate = faults.array("arrived", arrived, "m", nan=True)
        if self.any_fate:
            return sent
        if fate is not None and not np.all((fate == 0) | (fate == 1)):
            faults.add("`arrived` must be 1 (applied) or 0 (lost): this algorithm needs every input.")
        return np.where(fate == 1, sent, lost)


def step_length(
    model: StateSpace | NonlinearModel, dt: float | None, last: float | None, faults: checks.Faults, *, several: bool
) -> Any:
    """The length of a step in seconds: as given, or that of a discrete model, or of the `last` step of a continuous one.

    `several`: it may be several steps of a discrete model.
    """
    if dt is None:
        if model.is_continuous and last is None:
            faults.add("`dt` must be given to the first predict, in seconds: the model is continuous.")
        return last if model.is_continuous else model.dt
    dt = faults.number("dt", dt, above=0.0, unit="seconds")
    if dt is None or model.dt is None or model.is_continuous:
        return dt
    steps = max(round(dt / model.dt), 1) if several else 1
    if abs(dt - steps * model.dt) > UNIFORM * model.dt:
        faults.add(f"`dt` = {dt:g} s, but the model is discrete with dt = {model.dt:g} s: a continuous one is needed.")
    return dt
