"""What can happen to a plant and its actuators during a run.

Each event acts from the first sample at or after its `time` [s] on, and names its channel. A later event of the same actuator
replaces an earlier one, except that effect (`Failure`), `Offset` and motion are independent of each other.
"""

from collections.abc import Mapping
from dataclasses import KW_ONLY
from typing import Any, NamedTuple

import numpy as np

from .. import checks
from ..frozen import frozen, replace, set_field, static
from .actuator import Actuator, known_channel, read_bandwidth, read_stops
from .operating_point import PARTS
from .output_error import OutputError, past_states
from .state_space import StateSpace


class Drive(NamedTuple):
    """How a failed actuator moves instead of following its commands: towards `to` (None: not at all) as `actuator` would, from
    `place` (None: from where it is)."""

    to: float | None
    actuator: Actuator
    place: float | None = None


class PlantPhase(NamedTuple):
    """The plant from one event to the next: its model, and for each input its actuator, how it is driven (None: by its
    commands), and the gain and the offset of its effect."""

    model: StateSpace
    actuators: tuple[Actuator, ...]
    drives: tuple[Drive | None, ...]
    gain: np.ndarray
    offset: np.ndarray

    def with_input(self, name: str, **changes: Actuator | Drive | float) -> "PlantPhase":
        """The phase with the entries of one input changed."""
        i = self.model.inputs.index(name)
        changed = {}
        for field, value in changes.items():
            entries = list(getattr(self, field))
            entries[i] = value
            changed[field] = np.array(entries) if isinstance(getattr(self, field), np.ndarray) else tuple(entries)
        return self._replace(**changed)

    def actuator(self, name: str) -> Actuator:
        """The actuator of an input."""
        return self.actuators[self.model.inputs.index(name)]


class Event:
    """Something that happens during a run, from `time` [s] on."""

    time: Any

    def check(self, model: StateSpace, faults: checks.Faults) -> None:
        """Report a fault if the event does not suit the plant."""
        known_channel(type(self).__name__, "input", getattr(self, "input"), model.inputs, faults)  # noqa: B009

    def after(self, phase: PlantPhase) -> PlantPhase:
        """The plant after the event."""
        return phase


def begun(event: Event, faults: checks.Faults, **numbers: Mapping[str, Any] | None) -> dict[str, Any]:
    """The time of an event and its other numbers, checked together."""
    read = {"time": faults.number("time", event.time, lower=0.0, unit="seconds")}
    for name, bounds in numbers.items():
        value = getattr(event, name)
        read[name] = None if value is None and bounds is None else faults.number(name, value, **(bounds or {}))
    return read


@frozen
class Failure(Event):
    """An event of a run: from `time` [s] on, the effect of the inputs is multiplied by `gain`, one number or (m,).

    With `input`, only that input is affected, and earlier failures of the others remain. About an operating point, the gain
    multiplies the position of the actuator, not its deviation.

    >>> Failure(4.5, 0.2).gain.tolist()
    [0.2]
    """

    time: Any
    gain: Any
    input: Any = static(default=None)

    def __post_init__(self):
        faults = checks.Faults()
        read = begun(self, faults)
        gain = faults.array("gain", [self.gain] if checks.depth(self.gain) == 0 else self.gain, "m")
        if self.input is not None and gain is not None and gain.shape != (1,):
            faults.add(f"`gain` must be one number for the input {self.input!r}. Got {len(gain)}.")
        faults.finish()
        set_field(self, gain=gain, **read)

    def check(self, model: StateSpace, faults: checks.Faults) -> None:
        """Check the number of gains, or the name of the input."""
        if self.input is not None:
            super().check(model, faults)
        elif len(self.gain) not in (1, model.m):
            faults.add(
                f"`events`: a Failure has {len(self.gain)} gains, and the model has {checks.counted(model.m, 'input')}."
            )

    def after(self, phase: PlantPhase) -> PlantPhase:
        """The plant after the event."""
        if self.input is not None:
            return phase.with_input(self.input, gain=self.gain[0])
        return phase._replace(gain=np.broadcast_to(self.gain, phase.gain.shape))


@frozen
class Change(Event):
    """An event of a run: from `time` [s] on, the plant follows another `model`. Its state does not jump.

    `model` is a `StateSpace`. If the plant is an `OutputError`, give an `OutputError`: its parameters change, and the past
    outputs and inputs remain. Gains of earlier failures are part of the earlier model.

    >>> Change(10.0, StateSpace([[0.5]], [[1.0]], dt=1)).model.A.tolist()
    [[0.5]]
    """

    time: Any
    model: Any

    def __post_init__(self):
        faults = checks.Faults()
        read = begun(self, faults)
        model = past_states(self.model) if isinstance(self.model, OutputError) else self.model
        faults.instance("model", model, StateSpace)
        faults.finish()
        set_field(self, model=model, **read)

    def check(self, model: StateSpace, faults: checks.Faults) -> None:
        """Check the sizes of the other model."""
        if any(getattr(self.model, name) != getattr(model, name) for name in ("n", "m", "p", "dt")):
            faults.add(
                "`events`: a Change must be to a model with as many states, inputs and outputs, and the same dt."
            )
        elif not model.is_continuous and self.model.G.shape[-1] != model.G.shape[-1]:
            faults.add(
                f"`events`: a Change must be to a model with as many process noises ({model.G.shape[-1]}). It has "
                f"{self.model.G.shape[-1]}: give it `G` and `Q` of that size."
            )
        other, point = self.model.operating_point, model.operating_point
        if other is not None and (
            point is None or any(np.any(getattr(other, part) != getattr(point, part)) for part in PARTS)
        ):
            faults.add("`events`: a Change must be to a model about the operating point of the plant, or without one.")

    def after(self, phase: PlantPhase) -> PlantPhase:
        """The plant after the event."""
        model = replace(self.model, inputs=phase.model.inputs)
        return phase._replace(model=model, gain=np.ones(len(phase.gain)))


@frozen
class Stuck(Event):
    """An event of a run: from `time` [s] on, the actuator of `input` stays at the position `at` (None: where it is).

    >>> Stuck(4.5, "elevator").at is None
    True
    """

    time: Any
    input: str = static()
    at: Any = None

    def __post_init__(self):
        faults = checks.Faults()
        read = begun(self, faults, at=None)
        faults.finish()
        set_field(self, **read)

    def after(self, phase: PlantPhase) -> PlantPhase:
        """The plant after the event."""
        actuator = phase.actuator(self.input)
        at = None if self.at is None else self.at - actuator.operating_point
        return phase.with_input(self.input, drives=Drive(at, Actuator(np.inf), at))


@frozen
class Floating(Event):
    """An event of a run: from `time` [s] on, the actuator of `input` is not driven. Its position decays towards `to` (None:
    where its `Actuator` floats to) with `time_constant` [s]; 0: it jumps.

    >>> Floating(4.5, "elevator").time_constant
    0.1
    """

    time: Any
    input: str = static()
    to: Any = None
    time_constant: Any = 0.1

    def __post_init__(self):
        faults = checks.Faults()
        read = begun(self, faults, to=None, time_constant={"lower": 0.0, "unit": "seconds"})
        faults.finish()
        set_field(self, **read)

    def after(self, phase: PlantPhase) -> PlantPhase:
        """The plant after the event."""
        own = phase.actuator(self.input)
        to = (own.floats_to if self.to is None else self.to) - own.operating_point
        jumps = self.time_constant == 0
        drive = Drive(to, Actuator(np.inf if jumps else 1 / self.time_constant), to if jumps else None)
        return phase.with_input(self.input, drives=drive)


@frozen
class HardOver(Event):
    """An event of a run: from `time` [s] on, the actuator of `input` runs to the position `to` at its rate limit and stays
    there. Without a rate limit it moves there through its lag. Its limits hold.

    >>> HardOver(4.5, "elevator", 25.0).to
    25.0
    """

    time: Any
    input: str = static()
    to: Any

    def __post_init__(self):
        faults = checks.Faults()
        read = begun(self, faults, to={})
        faults.finish()
        set_field(self, **read)

    def after(self, phase: PlantPhase) -> PlantPhase:
        """The plant after the event."""
        own = phase.actuator(self.input)
        to = float(np.clip(self.to - own.operating_point, *own.stops))
        driven = Actuator(own.bandwidth if own.rate is None else np.inf, rate=own.rate)
        return phase.with_input(self.input, drives=Drive(to, driven))


@frozen
class Offset(Event):
    """An event of a run: from `time` [s] on, the position of the actuator of `input` is `by` more than its mechanism says.

    >>> Offset(4.5, "elevator", 1.0).by
    1.0
    """

    time: Any
    input: str = static()
    by: Any

    def __post_init__(self):
        faults = checks.Faults()
        read = begun(self, faults, by={})
        faults.finish()
        set_field(self, **read)

    def after(self, phase: PlantPhase) -> PlantPhase:
        """The plant after the event."""
        return phase.with_input(self.input, offset=self.by)


@frozen
class ActuatorChange(Event):
    """An event of a run: from `time` [s] on, the actuator of `input` has other `limits`, another `rate`, `bandwidth` or
    `delay`; those that are None do not change.

    >>> ActuatorChange(4.5, "elevator", rate=8.0).rate
    8.0
    """

    time: Any
    input: str = static()
    _: KW_ONLY
    limits: Any = None
    rate: Any = None
    bandwidth: Any = None
    delay: Any = None

    def __post_init__(self):
        faults = checks.Faults()
        read = begun(self, faults)
        if all(getattr(self, name) is None for name in ("limits", "rate", "bandwidth", "delay")):
            faults.add("an ActuatorChange must change something: give `limits`, `rate`, `bandwidth` or `delay`.")
        read["limits"] = read_stops(self.limits, faults)
        read["rate"] = None if self.rate is None else faults.number("rate", self.rate, above=0.0)
        read["bandwidth"] = None if self.bandwidth is None else read_bandwidth(self.bandwidth, faults)
        read["delay"] = None if self.delay is None else faults.number("delay", self.delay, lower=0.0, unit="seconds")
        faults.finish()
        set_field(self, **read)

    def after(self, phase: PlantPhase) -> PlantPhase:
        """The plant after the event."""
        given = {name: getattr(self, name) for name in ("limits", "rate", "bandwidth", "delay")}
        changed = {name: value for name, value in given.items() if value is not None}
        return phase.with_input(self.input, actuators=replace(phase.actuator(self.input), **changed))
