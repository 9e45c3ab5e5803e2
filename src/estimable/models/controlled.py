"""A plant in a loop: a model with its actuators, and the events that change it during a run."""

from collections.abc import Sequence
from dataclasses import KW_ONLY
from typing import Any

import numpy as np

from .. import checks
from ..annotations import Numbers
from ..frozen import frozen, replace, set_field, static
from ..kernels.small import factors
from .output_error import OutputError, past_states
from .state_space import StateSpace
from .turbulence import Turbulence


@frozen
class Failure:
    """An event of a run: from `time` [s] on, the effect of the inputs is multiplied by `gain`, one number or (m,).

    >>> Failure(4.5, 0.2).gain.tolist()
    [0.2]
    """

    time: Any
    gain: Any

    def __post_init__(self):
        faults = checks.Faults()
        time = faults.number("time", self.time, lower=0.0, unit="seconds")
        gain = faults.array("gain", [self.gain] if checks.depth(self.gain) == 0 else self.gain, "m")
        faults.finish()
        set_field(self, time=time, gain=gain)

    def after(self, model: StateSpace) -> StateSpace:
        """The model after the event."""
        return replace(model, B=model.B * self.gain, D=model.D * self.gain)


@frozen
class Change:
    """An event of a run: from `time` [s] on, the plant follows another `model`. Its state does not jump.

    `model` is a `StateSpace`. If the plant is an `OutputError`, give an `OutputError`: its parameters change, and the past
    outputs and inputs remain.

    >>> Change(10.0, StateSpace([[0.5]], [[1.0]], dt=1)).model.A.tolist()
    [[0.5]]
    """

    time: Any
    model: Any

    def __post_init__(self):
        faults = checks.Faults()
        time = faults.number("time", self.time, lower=0.0, unit="seconds")
        model = past_states(self.model) if isinstance(self.model, OutputError) else self.model
        faults.instance("model", model, StateSpace)
        faults.finish()
        set_field(self, time=time, model=model)

    def after(self, model: StateSpace) -> StateSpace:
        """The model after the event."""
        return self.model


Event = Failure | Change


@frozen
class ControlledPlant:
    """A plant for `close_loop`: a model, its actuators, and events during the run, such as failures.

    The inputs of `model` are the positions of the actuators. Without `actuator` they equal the commands of the controller.
    With it, the position i of an actuator follows its command by di/dt = `actuator` (command - i). The position is measured
    without error. It moves between samples; with `held` it is constant over each sample and jumps at the next.

    Settings:

    - `model`: a `StateSpace`, or an `OutputError`, whose states are past outputs and inputs.
    - `actuator`: the bandwidth in 1/s, one number. None: no actuator.
    - `held`: True if the position is constant over each sample.
    - `limits` (2,) or (2, m): the smallest and the largest command. `rate`: the largest change of a command per second, one
      number. Both limit the position as well, which follows the command.
    - `quantum`, (m,) or one number: commands are rounded to multiples of it. `resolution`, (p,) or one number: the same for
      outputs.
    - `turbulence`: a `Turbulence`, which becomes part of `model` (and of the model of each `Change`): its states follow those of
      the aircraft, and begin at zero.
    - `events`: a list of `Failure`s and `Change`s, in any order.

    >>> model = StateSpace([[-1.0]], [[1.0]], R=[[0.1]], dt=0)
    >>> plant = ControlledPlant(model, actuator=20.0, events=[Failure(1.0, 0.5)])
    >>> plant.steps(0.1).A.shape  # two phases, a state and an actuator
    (2, 2, 2)
    """

    model: Any
    _: KW_ONLY
    actuator: Any = None
    held: bool = static(default=False)
    limits: Any = None
    rate: Any = None
    quantum: Any = None
    resolution: Any = None
    events: Any = ()
    turbulence: Any = None

    def __post_init__(self):
        faults = checks.Faults()
        model, given = past_states(self.model) if isinstance(self.model, OutputError) else self.model, self.events
        if self.turbulence is not None:
            model, given = _in_turbulence(model, given, self.turbulence)
        if faults.instance("model", model, StateSpace):
            _check_model(model, self, faults)
        actuator = None if self.actuator is None else faults.number("actuator", self.actuator, above=0.0)
        rate = None if self.rate is None else faults.number("rate", self.rate, above=0.0)
        limits, events = read_limits(self.limits, faults), _read_events(given, model, faults)
        quantum, resolution = (_read_steps(name, getattr(self, name), size, faults) for name, size in
                               (("quantum", "m"), ("resolution", "p")))  # fmt: skip
        faults.finish()
        set_field(
            self, model=model, actuator=actuator, rate=rate, limits=limits, quantum=quantum, resolution=resolution,
            events=events, turbulence=None,
        )  # fmt: skip

    @property
    def hold(self) -> str:
        """How the input varies between samples: "zero_order" or "first_order"."""
        return "zero_order" if self.actuator is None or self.held else "first_order"

    def phases(self) -> list[StateSpace]:
        """The initial model, and the model after each event."""
        models = [self.model]
        for event in self.events:
            models.append(event.after(models[-1]) if isinstance(event, Change) else self._failed(event, models))
        return models

    def _failed(self, event: Failure, models: list[StateSpace]) -> StateSpace:
        """The model of the last `Change`, with its inputs scaled by the gain of the failure."""
        changed = [e.model for e in self.events[: len(models) - 1] if isinstance(e, Change)]
        return event.after(changed[-1] if changed else self.model)

    def phase_rows(self, t: np.ndarray) -> np.ndarray:
        """The index of the phase of each row, (T,)."""
        return np.sum([t >= event.time - 1e-9 for event in self.events] + [np.zeros(len(t))], axis=0).astype(int)

    def steps(self, dt: float) -> "Steps":
        """The matrices of a step over `dt` seconds, phase by phase."""
        each = [_step(model, self, dt) for model in self.phases()]
        A, B, C, W = (np.stack(matrices) for matrices in zip(*each, strict=True))
        m, n = self.model.m, self.model.n
        return Steps(
            A, B, C, np.stack([model.D for model in self.phases()]), W, np.asarray(factors(self.model.R)),
            None if self.actuator is None else np.eye(m, n + m, n), self.limits, _reach(self, dt), self.quantum,
            self.resolution,
        )  # fmt: skip


@frozen
class Steps:
    """x+ = A x + B c + W e', y = C x + D c + V e, i = L x (None: i = c), phase by phase; c within `limits` and within
    `reach` of i; c rounded to `quantum`, y to `resolution`."""

    A: Any
    B: Any
    C: Any
    D: Any
    W: Any
    V: Any
    L: Any
    limits: Any
    reach: Any
    quantum: Any
    resolution: Any


def _reach(plant: ControlledPlant, dt: float) -> float | None:
    """How far a command may be from the input: the initial speed of the actuator is then its largest rate."""
    if plant.rate is None:
        return None
    return plant.rate * dt if plant.actuator is None else plant.rate / plant.actuator


def _step(model: StateSpace, plant: ControlledPlant, dt: float):
    """A, B, C and W over a step: of the plant, or of plant and actuators together."""
    n, m, p = model.n, model.m, model.p
    if plant.actuator is None:
        now = model.discretise(dt) if model.is_continuous else model
        return now.A, now.B, now.C, now.G @ np.asarray(factors(now.Q))
    C = np.hstack([model.C, np.zeros((p, m))])
    if plant.held:
        now, decay = model.discretise(dt), np.exp(-plant.actuator * dt)
        A = np.block([[now.A, now.B], [np.zeros((m, n)), decay * np.eye(m)]])
        B = np.vstack([np.zeros((n, m)), (1 - decay) * np.eye(m)])
        return A, B, C, np.vstack([np.asarray(factors(now.Q)), np.zeros((m, n))])
    both = StateSpace(
        np.block([[model.A, model.B], [np.zeros((m, n)), -plant.actuator * np.eye(m)]]),
        np.vstack([np.zeros((n, m)), plant.actuator * np.eye(m)]), G=np.vstack([model.G, np.zeros((m, model.G.shape[1]))]),
        Q=model.Q, dt=0,
    ).discretise(dt)  # fmt: skip
    return both.A, both.B, C, np.asarray(factors(both.Q))


def _in_turbulence(model: StateSpace, events: Sequence[Event], turbulence: Turbulence) -> tuple[StateSpace, Any]:
    """The model and the events with the states of the turbulence."""
    checks.require(turbulence=(turbulence, Turbulence))
    if isinstance(events, list | tuple):
        events = [
            replace(event, model=turbulence.into(event.model)) if isinstance(event, Change) else event
            for event in events
        ]
    return turbulence.into(model), events


def _check_model(model: StateSpace, plant: ControlledPlant, faults: checks.Faults) -> None:
    """Check that the model can be the plant of a loop."""
    if model.m == 0:
        faults.add("`model` must have an input to control. It has none.")
    if model.R is None:
        faults.add("`model` must have R, the covariance of the measurement noise. For noise-free outputs give zeros.")
    if model.schedule:
        faults.add(
            "`model` must be constant: give model.along({channel: value}), and a `Change` to another value during the run."
        )
    if model.varying or model.S is not None or model.B_end is not None:
        faults.add("`model` must be constant, without cross noise S and without B_end.")
    if model.operating_point is not None:
        faults.add("`model` must be a model of deviations: leave out `operating_point`, and give deviations from it.")
    if plant.actuator is not None and not model.is_continuous:
        faults.add("`model` must be continuous (dt = 0), because `actuator` moves between samples.")
    faults.learn("m", model.m, f"the model has {checks.counted(model.m, 'input')}")
    faults.learn("p", model.p, f"the model has {checks.counted(model.p, 'output')}")


def read_limits(limits: Numbers, faults: checks.Faults) -> Any:
    """Smallest and largest input, (2, m), from one number each or (m,)."""
    if limits is None or checks.is_traced(limits):
        return limits
    m = faults.sizes.get("m", 1)
    each = [[limit] * m for limit in np.asarray(limits, object)] if checks.depth(limits) == 1 else limits
    read = faults.array("limits", each, "2 m")
    if read is not None and np.any(read[0] >= read[1]):
        faults.add(f"`limits` must be (smallest, largest), the first below the second. Got {checks.short(limits)}.")
    return read


def _read_steps(name: str, given: Numbers, size: str, faults: checks.Faults) -> Any:
    """The rounding steps of the channels, from one number or one for each."""
    if given is None or checks.is_traced(given):
        return given
    count = faults.sizes.get(size, 1)
    steps = faults.array(name, [given] * count if checks.depth(given) == 0 else given, size)
    if steps is not None and np.any(steps <= 0):
        faults.add(f"`{name}` must be greater than 0. Got {checks.short(given)}.")
    return steps


def _read_events(events: Any, model: StateSpace, faults: checks.Faults) -> tuple:
    """The events in order of time, checked against the model."""
    if not isinstance(events, list | tuple) or not all(isinstance(event, Failure | Change) for event in events):
        faults.add(
            f"`events` must be a list of Failure(time, gain) and Change(time, model). Got {checks.short(events)}."
        )
        return ()
    for event in events:
        if isinstance(event, Failure) and len(event.gain) not in (1, faults.sizes.get("m", 1)):
            faults.add(f"`events`: a Failure has {len(event.gain)} gains, and {faults.sources['m']}.")
        if isinstance(event, Change) and _sizes(event.model) != _sizes(model):
            faults.add(
                "`events`: a Change must be to a model with as many states, inputs and outputs, and the same dt."
            )
    return tuple(sorted(events, key=lambda event: event.time))


def _sizes(model: StateSpace) -> tuple:
    return tuple(getattr(model, name, None) for name in ("n", "m", "p", "dt"))
