# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
"""Run an algorithm one sample at a time."""

from typing import Any

import numpy as np

from .. import checks
from ..data.record import LOST
from ..engines import choice
from ..models.discretisation import HOLDS
from ..models.prior import Prior
from ..models.sampled import Clock
from ..protocols import Algorithm
from .binding import check_algorithm, check_hold, check_prior, check_prior_kind, model_of
from .following import nominal
from .gaps import Given as GivenGaps
from .online_gaps import OnlineGaps, settings_of
from .online_run import Online, Progress, init

__all__ = ["Online", "Progress", "online"]


def online(
    algorithm: Algorithm[Any],
    *,
    prior: Prior | None,
    engine: str = "auto",
    hold: str = "zero_order",
    lost: str = "zero",
    gaps: GivenGaps = "refuse",
) -> Online:
    """Start an algorithm that runs one sample at a time. Its results equal those of `estimate` to rounding.

    Then, for each sample, call `.correct(y)` and `.predict(u)`. `.info` is the last report and `.engine` the engine that
    runs. `.save(path)` stores the run, and `load(path)` resumes it.

    - `prior`: the `Prior` of the state at the first sample.
    - `engine`: "native", machine code for small models on a CPU: about two microseconds per sample where y and u are float64
      arrays, or lists of floats; "xla": some hundreds of microseconds; "auto": the first of these that can run the algorithm.
    - `hold`: how the input moves between samples, "zero_order" or "first_order".
    - `lost`: what the actuator does when a packet is lost, "zero" or "hold".
    - `gaps`: what to do where an input is unknown, given as NaN to `predict`, or where a step is longer than 1.5 regular ones.
      "refuse": an error. A run does not know how its inputs move, so a bridge needs `Gaps("bridge", diffusion=...)`; then the
      results are those of `estimate` with the same `Gaps`. "break" uses no such number. `.gaps` says what was done. A run with
      `gaps` checks every sample, which takes some tens of microseconds.

    Returns an `Online`. Raises `InputError` for a wrong call, `RunError` where the numbers fail.
    """
    faults = checks.Faults()
    choice.check(engine, faults)
    faults.choice("hold", hold, HOLDS)
    faults.choice("lost", lost, LOST)
    check_algorithm(algorithm, faults)
    check_prior_kind(algorithm, prior, faults)
    faults.finish()
    model = model_of(algorithm)
    if algorithm.has_state_prior:
        check_prior(prior, model, faults)
    check_hold(model, hold, faults)
    faults.finish()
    settings = settings_of(gaps, algorithm, faults)
    ready = nominal(algorithm).sampled(Clock.every(model.dt, hold))
    if settings is not None:
        ready = OnlineGaps(algorithm, settings, hold).with_room(ready)
    held = np.zeros(len(algorithm.names.inputs))
    return Online(Progress(algorithm, init(ready, prior), held, hold=hold, lost=lost, gaps=settings), engine)
