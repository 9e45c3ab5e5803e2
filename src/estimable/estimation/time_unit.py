"""Whether the steps of a record can be in seconds: a model's modes say how long a second is."""

import logging

import numpy as np

from .. import checks
from ..data.one_grid import placing_warnings
from ..data.record import Record
from ..identifiers.channels import Channels
from ..models.nonlinear_model import NonlinearModel
from ..models.state_space import StateSpace

UNITS = ((1e3, "milliseconds"), (1e6, "microseconds"), (1e9, "nanoseconds"))
GROWTH = 5.0  # an unstable mode that grows by e^5 in a step cannot be followed by samples
DECAY = 20.0  # where every mode turns or decays by 20 time constants in a step, no sample has information about the next state
FITS = 1.0  # at most: modulus of the fastest mode times the step, in the likely unit
log = logging.getLogger("estimable.estimation")


def check_time_unit(model: StateSpace, record: Record, faults: checks.Faults) -> None:
    """Note a time that is in a smaller unit than seconds; only log it where `dt` was given."""
    if (
        not isinstance(model, StateSpace)
        or not model.is_continuous
        or model.varying
        or record.t is None
        or len(record) < 2
    ):
        return
    step = float(np.median(np.diff(np.asarray(record.t, float))))
    A = np.asarray(model.A)
    if np.linalg.norm(A) * step <= GROWTH:  # no mode is faster than the norm
        return
    sentence = too_long(np.linalg.eigvals(A), step)
    if sentence and record.timed:
        faults.add(sentence)
    elif sentence:
        log.warning(sentence)


def warn_of_placing(model: StateSpace | NonlinearModel | Channels, outputs: tuple[str, ...], record: Record) -> None:
    """Warn of outputs that placing on a grid moved by a good part of their noise. An identifier has a check for it."""
    if not record.placing or isinstance(model, Channels) or model.R is None or checks.is_traced(model.R):
        return
    variance = np.diagonal(np.asarray(model.R), axis1=-2, axis2=-1).reshape(-1, model.p).min(axis=0)
    for sentence in placing_warnings(record.placing, dict(zip(outputs, np.sqrt(variance), strict=True))):
        log.warning(sentence)


def too_long(modes: np.ndarray, step: float) -> str:
    """Why a step cannot be in seconds, with the likely unit; empty where it can."""
    moving = modes[np.abs(modes) > 1e-13 * np.abs(modes).max(initial=0.0)]
    if not len(moving):
        return ""
    grows, slowest, fastest = np.max(np.real(moving)) * step, np.abs(moving).min() * step, np.abs(moving).max() * step
    unit = next(((factor, name) for factor, name in UNITS if fastest / factor <= FITS), None)
    if unit is None or (grows <= GROWTH and slowest <= DECAY):
        return ""
    factor, name = unit
    shortest = step / fastest
    return (
        f"the record's step is {step:g} s, and the model's fastest time constant is {shortest:.3g} s: the time is in {name}, "
        f"probably. Divide it by {factor:g}, or give `dt` in seconds."
    )
