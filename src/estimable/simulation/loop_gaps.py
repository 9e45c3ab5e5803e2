"""The inputs that an estimator in a closed loop does not know: what it takes for them, and with which variance."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from .. import checks
from ..estimation.gap_numbers import Known
from ..estimation.gapped import restarts_of
from ..estimation.gaps import SHARE, Gaps, Given, read
from ..estimation.online_gaps import settings_of
from ..filters.actuated import Actuated
from ..filters.belief import Belief
from ..frozen import frozen
from ..models.controlled import ControlledPlant
from ..models.event_rows import unmeasured
from ..protocols import Algorithm


@frozen
class UnknownInputs:
    """Of each row: which inputs are unknown at the sample and at the next one (2, m), the variance (m,) of the error of what is
    taken for them over the interval, and whether the state restarts at its end."""

    unknown: Any
    variance: Any
    restart: Any


class LoopGaps(NamedTuple):
    """The rows with unknown inputs, and the belief after a break."""

    rows: UnknownInputs
    fresh: Belief | tuple[Belief, ...] | None


def check_gaps(
    plants: Sequence[tuple[ControlledPlant, Any]], estimator: Algorithm[Any], gaps: Given, late: bool
) -> Gaps | None:
    """The settings where a position is not measured for a time; None where all are always known."""
    faults = checks.Faults()
    settings = read(gaps, len(estimator.names.inputs), faults)
    faults.finish()
    lost = [
        (plant, simulator)
        for plant, simulator in plants
        if unmeasured(plant.events, plant.model, np.zeros(1)) is not None
    ]
    if not lost:
        return None
    if isinstance(estimator, Actuated):
        faults.add(
            "Actuated computes the positions from the commands, and reads no position: leave out its SensorFault."
        )
    if any(simulator is not None for _, simulator in lost):
        faults.add("the positions of a simulator are always known: leave out the SensorFault of an input.")
    if late:
        faults.add('a position that is not measured and late="use" cannot be combined: give late="drop".')
    if settings.how == "refuse":
        faults.add('an input is not measured for a time (SensorFault): give gaps = "bridge", "break" or "auto".')
    if settings.how == "bridge" and not estimator.innermost.takes_uncertain_inputs:
        name = type(estimator.innermost).__name__
        faults.add(f'{name} counts no errors of inputs: give gaps = "break", or an estimator such as Kalman.')
    faults.finish()
    return settings_of(settings, estimator, faults)


def planned(
    plant: ControlledPlant, estimator: Algorithm[Any], settings: Gaps, t: np.ndarray, step: float, hold: str
) -> LoopGaps | None:
    """What is done in each row; None for a plant whose positions are always measured.

    Until a position is measured again it is taken for constant. Its error is a Brownian motion. In the i-th interval, which
    ends s seconds after the last known input, it counts as constant with variance i g s, as in `online`.
    """
    missing = unmeasured(plant.events, plant.model, np.append(t, t[-1] + step))
    if missing is None:
        return None
    known = Known(estimator, hold, settings, False)
    m, moving = missing.shape[1], hold == "first_order"
    known.moves = np.zeros(m) if settings.diffusion is None else settings.diffusion
    unknown = np.stack([missing[:-1], missing[1:]], axis=1)
    inside = missing[:-1] | missing[1:] if moving else missing[:-1]  # (T, m): unknown in the interval after the row
    variance, restart, steps, last = np.zeros(inside.shape), np.zeros(len(t), bool), 0, 0
    for k, mask in enumerate(inside):
        if not mask.any():
            steps, last = 0, k if not moving else k + 1
            continue
        last = k if moving and not unknown[k, 0].any() else last
        steps, since = steps + 1, (k + 1 - last) * step
        restart[k] = bool(_why_break(known, settings, since, (k + 1) * step))
        variance[k] = 0.0 if restart[k] else steps * since * known.moves * mask
    fresh = restarts_of(known, settings) if restart.any() else None
    return LoopGaps(UnknownInputs(unknown.astype(float), variance, restart.astype(float)), fresh)


def _why_break(known: Known, settings: Gaps, since: float, elapsed: float) -> str:
    """Why the state restarts; empty for a bridge."""
    if settings.how != "auto":
        return "as asked" if settings.how == "break" else ""
    if settings.diffusion is None or not known.algorithm.innermost.takes_uncertain_inputs:
        return "the variance of the input is not given"
    return known.why_break(since, settings.diffusion, elapsed, SHARE)
