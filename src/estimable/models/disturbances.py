"""Disturbances and failures of sensors during a run."""

from collections.abc import Mapping
from dataclasses import KW_ONLY
from typing import Any

import numpy as np

from .. import checks
from ..frozen import frozen, set_field, static
from .actuator import known_channel
from .events import Event, begun
from .state_space import StateSpace

SHAPES = ("one_minus_cosine", "step")
KINDS = ("bias", "scale", "frozen", "dropout", "drift", "noise")
NEED_VALUE = ("bias", "scale", "drift", "noise")


def until_of(event: "Upset | SensorFault", faults: checks.Faults) -> Any:
    """The end of an event, None: the end of the run."""
    if event.until is None:
        return None
    until = faults.number("until", event.until, unit="seconds")
    if until is not None and isinstance(event.time, int | float) and until <= event.time:
        faults.add(f"`until` must be after `time` = {event.time:g} s. Got {until:g}.")
    return until


@frozen
class Upset(Event):
    """An event of a run: from `time` to `until` [s] (None: the end), `by` is added to the derivatives of the states, per second:
    one number for each state, (n,), or {state: number}.

    >>> Upset(4.5, {"pitch_rate": 24.0}).by
    {'pitch_rate': 24.0}
    """

    time: Any
    by: Any
    until: Any = None

    def __post_init__(self):
        faults = checks.Faults()
        read = begun(self, faults)
        read["until"] = until_of(self, faults)
        if isinstance(self.by, Mapping):
            read["by"] = {name: faults.number(f"by {name}", value) for name, value in self.by.items()}
        else:
            read["by"] = faults.array("by", self.by, "n")
        faults.finish()
        set_field(self, **read)

    def check(self, model: StateSpace, faults: checks.Faults) -> None:
        """Check the states."""
        if isinstance(self.by, Mapping):
            for name in self.by:
                known_channel("Upset", "state", name, model.states, faults)
        elif len(self.by) != model.n:
            faults.add(
                f"`by` of an Upset must be (n,) = ({model.n},): the model has {checks.counted(model.n, 'state')}. Got "
                f"({len(self.by)},)."
            )

    def rates(self, model: StateSpace) -> np.ndarray:
        """What is added to the derivative of each state, (n,)."""
        if isinstance(self.by, Mapping):
            return np.array([self.by.get(name, 0.0) for name in model.states], float)
        return np.asarray(self.by, float)


@frozen
class Gust(Event):
    """An event of a run: from `time` [s] on, a gust of `amplitude` acts for `seconds`, in the unit of a `state` that is measured
    relative to the air, such as the angle of attack.

    Model: dx/dt = A (x + e g(t)) + .., y = C (x + e g(t)) + .., with e the unit vector of the state. `shape`
    "one_minus_cosine": g = amplitude (1 - cos(2π (t - time) / seconds)) / 2; "step": g = amplitude. `state` None: the first
    one. `vanes`: the outputs that are measured relative to the air (None: all that contain the state; (): none, as for inertial
    sensors).

    >>> Gust(4.5, 1.5, 0.5).shape
    'one_minus_cosine'
    """

    time: Any
    amplitude: Any
    seconds: Any
    shape: str = static(default="one_minus_cosine")
    _: KW_ONLY
    state: str | None = static(default=None)
    vanes: tuple[str, ...] | None = static(default=None)

    def __post_init__(self):
        faults = checks.Faults()
        read = begun(self, faults, amplitude={}, seconds={"above": 0.0, "unit": "seconds"})
        faults.choice("shape", self.shape, SHAPES)
        faults.finish()
        set_field(self, vanes=None if self.vanes is None else tuple(self.vanes), **read)

    def check(self, model: StateSpace, faults: checks.Faults) -> None:
        """Check the state and the outputs."""
        if self.state is not None:
            known_channel("Gust", "state", self.state, model.states, faults)
        for name in self.vanes or ():
            known_channel("Gust", "output", name, model.outputs, faults)


@frozen
class SensorFault(Event):
    """An event of a run: from `time` to `until` [s] (None: the end), the sensor of `output` fails. The estimator and the
    controller receive what it reads. With the kind "dropout" it may be an input: the position of that actuator, or its command,
    is then not known, and `gaps` of `close_loop` says what the estimator does.

    `kind`: "bias": `value` is added; "scale": multiplied by `value`; "drift": `value` per second is added, from `time` on;
    "noise": white noise with the standard deviation `value` is added; "frozen": it repeats its last reading, or `value`;
    "dropout": nothing is read, or `value`.

    >>> SensorFault(4.5, "pitch_rate_deg_s", "bias", 1.0).value
    1.0
    """

    time: Any
    output: str = static()
    kind: str = static()
    value: Any = None
    until: Any = None

    def __post_init__(self):
        faults = checks.Faults()
        read = begun(self, faults, value=None)
        read["until"] = until_of(self, faults)
        if faults.choice("kind", self.kind, KINDS) and self.kind in NEED_VALUE and self.value is None:
            faults.add(f'`value` must be given for the kind "{self.kind}".')
        if self.kind == "noise" and read["value"] is not None and read["value"] < 0:
            faults.add(f"`value` must be at least 0 for noise: it is a standard deviation. Got {read['value']:g}.")
        faults.finish()
        set_field(self, **read)

    def check(self, model: StateSpace, faults: checks.Faults) -> None:
        """Check the output; of an input only a dropout is possible."""
        positions = model.inputs if self.kind == "dropout" and self.value is None else ()
        known_channel("SensorFault", "output", self.output, (*model.outputs, *positions), faults)
