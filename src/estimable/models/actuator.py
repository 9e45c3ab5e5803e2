"""An actuator between a command and an input of a plant."""

from collections.abc import Mapping
from dataclasses import KW_ONLY
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from .. import checks
from ..annotations import Numbers
from ..frozen import frozen, set_field

ROUND = 1e-6  # of a step: a delay this near to an integer number of steps is one


@frozen
class Actuator:
    """An actuator: its position p follows a command c with a delay, within limits, at a limited rate and with a lag.

    Model: dp/dt = `bandwidth` (c(t - `delay`) - p), with c clipped to `limits` and |dp/dt| <= `rate`. Commands are held from
    sample to sample. The simulation is exact: the same closed form serves `ControlledPlant`, `Actuated` and
    `through_actuators`.

    Settings:

    - `bandwidth` in 1/s; `np.inf`: no lag.
    - `limits`: the smallest and the largest position (default None: no limits). `rate`: the largest speed, per second (default
      None: no limit). `delay` in seconds (default 0).
    - `operating_point`: the position at which the input of the model is zero, for a model of deviations (default 0). `limits`,
      `floats_to` and the positions of events are positions; commands and inputs are position - `operating_point`.
    - `floats_to`: the position to which a floating actuator moves (`Floating`).

    >>> Actuator(20.0, limits=(-25, 25), rate=60.0).rate
    60.0
    """

    bandwidth: Any
    _: KW_ONLY
    limits: Any = None
    rate: Any = None
    delay: Any = 0.0
    operating_point: Any = 0.0
    floats_to: Any = 0.0

    def __post_init__(self):
        faults = checks.Faults()
        read = {
            "bandwidth": read_bandwidth(self.bandwidth, faults),
            "limits": read_stops(self.limits, faults),
            "rate": None if self.rate is None else faults.number("rate", self.rate, above=0.0),
            "delay": faults.number("delay", self.delay, lower=0.0, unit="seconds"),
            "operating_point": faults.number("operating_point", self.operating_point),
            "floats_to": faults.number("floats_to", self.floats_to),
        }
        faults.finish()
        set_field(self, **read)

    @property
    def stops(self) -> tuple[Any, Any]:
        """The smallest and the largest input: the limits less the operating point."""
        limits = np.array([-np.inf, np.inf]) if self.limits is None else np.asarray(self.limits)
        return limits[..., 0] - self.operating_point, limits[..., 1] - self.operating_point

    @property
    def fastest(self) -> Any:
        """The largest speed; infinite without a limit."""
        return np.inf if self.rate is None else self.rate

    @property
    def reach(self) -> Any:
        """The distance from the command below which the lag is slower than the rate limit."""
        if self.rate is None:
            return np.inf
        return np.where(np.isinf(self.bandwidth), 0.0, self.rate / np.asarray(self.bandwidth))


class StepPart(NamedTuple):
    """A part of a step in which each command is constant: its length (.., m), the time from it to the end of the step, and the
    age in steps of the command that acts."""

    seconds: np.ndarray
    after: np.ndarray
    age: np.ndarray


def parts_of(delay: np.ndarray, dt: float, *, held: bool = False) -> list[StepPart]:
    """The parts of a step of `dt` seconds under delays (.., m): two where a delay is not an integer number of steps.

    `held`: positions are held over a step, so that delays are rounded up to steps.
    """
    steps = delay / dt
    age = np.floor(steps + ROUND).astype(int)
    rest = np.where(steps - age > ROUND, (steps - age) * dt, 0.0)
    if held:
        age, rest = age + (rest > 0), np.zeros(rest.shape)
    whole = StepPart(dt - rest, np.zeros(rest.shape), age)
    return [StepPart(rest, dt - rest, age + 1), whole] if np.any(rest) else [whole]


def ages(parts: list[StepPart]) -> list[np.ndarray]:
    """For each part, 1 for the command that acts among the last L, the newest first, (.., L, m)."""
    count = 1 + max(int(part.age.max()) for part in parts)
    return [(np.arange(count)[:, None] == part.age[..., None, :]).astype(float) for part in parts]


Actuators: TypeAlias = Mapping[str, Actuator] | Actuator


def read_bandwidth(value: Numbers, faults: checks.Faults) -> Any:
    """A bandwidth in 1/s, finite or infinite."""
    if isinstance(value, int | float) and value == np.inf:
        return np.inf
    return faults.number("bandwidth", value, above=0.0, unit="1/s")


def read_stops(limits: Numbers, faults: checks.Faults) -> Any:
    """The smallest and the largest position, (2,)."""
    if limits is None or checks.is_traced(limits):
        return limits
    read = faults.array("limits", limits, "2")
    if read is not None and read[0] >= read[1]:
        faults.add(f"`limits` must be (smallest, largest), the first below the second. Got {checks.short(limits)}.")
    return read


def by_input(given: Actuators, inputs: tuple[str, ...], argument: str, faults: checks.Faults) -> dict[str, Actuator]:
    """The actuators by input: one `Actuator` for all inputs, or {input: Actuator}."""
    if isinstance(given, Actuator):
        return dict.fromkeys(inputs, given)
    if not isinstance(given, Mapping) or not given:
        faults.add(f"`{argument}` must be an Actuator, or {{input: Actuator}}. Got {checks.short(given)}.")
        return {}
    for name, actuator in given.items():
        known_channel(argument, "input", name, inputs, faults)
        if not isinstance(actuator, Actuator):
            faults.add(f"`{argument}` must hold an Actuator for {name!r}. Got {checks.short(actuator)}.")
    return {name: given[name] for name in inputs if isinstance(given.get(name), Actuator)}


def known_channel(who: str, kind: str, name: str | None, names: tuple[str, ...], faults: checks.Faults) -> None:
    """Check that `name` is one of the channels of a kind ("input", "output", "state")."""
    if name not in names:
        near = checks.suggestion(name, names)
        faults.add(f"`{who}` names the {kind} {name!r}, but the {kind}s are {checks.listed(names)}.{near}")


NONE = Actuator(np.inf)  # an input that follows its command at once
