"""A plant in a loop: a model with its actuators, and the events that change it during a run."""

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY
from typing import Any

import numpy as np

from .. import checks
from ..annotations import Numbers
from ..frozen import frozen, replace, set_field, static
from .actuator import Actuator, by_input
from .disturbances import Upset
from .events import Change, Event, PlantPhase
from .operating_point import OperatingPoint
from .output_error import OutputError, past_states
from .plant_steps import Steps, steps_of
from .sampled import point_of
from .state_space import StateSpace
from .turbulence import Turbulence


@frozen
class ControlledPlant:
    """A plant for `close_loop`: a model, its actuators, and events during the run, such as failures.

    The inputs of `model` are the positions of the actuators. Without `actuator` they equal the commands of the controller.
    With it, each position follows its command (`Actuator`), and the response of the plant to the moving position is exact.
    Positions are measured. With `held` a position is constant over each sample and jumps at the next.

    Settings:

    - `model`: a `StateSpace`, or an `OutputError`, whose states are past outputs and inputs. With an operating point, all
      signals are in absolute units. It may vary in time, with a row for each sample, or have a `schedule`, whose channels
      `close_loop` then needs. Its matrices at a sample hold until the next one.
    - `actuator`: an `Actuator` for all inputs, {input: Actuator} (the others follow at once), or a bandwidth in 1/s. None: no
      actuator.
    - `held`: True if the position is constant over each sample.
    - `limits` (2,) or (2, m): the smallest and the largest position. `rate`: its largest change per second, one number. An
      `Actuator` has its own.
    - `position_sigma`: the standard deviation of the measured positions, one number or (m,). None: measured without error.
      `Kalman`, `UnknownGain`, `ExtendedKalman` and other filters with a covariance count it as process noise, also inside
      wrappers. Others ignore it. Noise in an input biases its estimated gain towards zero, which sigma does not count: by
      some 1 % where it is a quarter of the rms of the position, and with its square. The commands have no such bias (`Actuated`).
    - `quantum`, (m,) or one number: commands are rounded to multiples of it. `resolution`, (p,) or one number: the same for
      outputs.
    - `turbulence`: a `Turbulence`, which becomes part of `model` (and of the model of each `Change`): its states follow those of
      the aircraft, and begin at zero.
    - `events`: a list of events, in any order: `Failure`, `Change`, `Stuck`, `Floating`, `HardOver`, `Offset`,
      `ActuatorChange`, `Upset`, `Gust`, `SensorFault`.

    >>> model = StateSpace([[-1.0]], [[1.0]], R=[[0.1]], dt=0)
    >>> plant = ControlledPlant(model, actuator=20.0, events=[Failure(1.0, 0.5)])
    >>> plant.steps(0.1).gain.tolist()  # in two phases
    [[1.0], [0.5]]
    """

    model: Any
    _: KW_ONLY
    actuator: Any = None
    held: bool = static(default=False)
    limits: Any = None
    rate: Any = None
    position_sigma: Any = None
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
        rate = None if self.rate is None else faults.number("rate", self.rate, above=0.0)
        limits = read_limits(self.limits, faults)
        actuator = None if self.actuator is None else self._read_actuator(model, limits, rate, faults)
        events = _read_events(given, model, faults)
        quantum, resolution = (_read_steps(name, getattr(self, name), size, faults) for name, size in
                               (("quantum", "m"), ("resolution", "p")))  # fmt: skip
        sigma = _read_steps("position_sigma", self.position_sigma, "m", faults)
        if sigma is not None and self.actuator is None:
            faults.add("`position_sigma` needs an `actuator`, whose position is measured.")
        faults.finish()
        set_field(
            self, model=model, actuator=actuator, rate=rate, limits=limits, quantum=quantum, resolution=resolution,
            events=events, position_sigma=sigma, turbulence=None,
        )  # fmt: skip

    def _read_actuator(
        self, model: StateSpace, limits: np.ndarray | None, rate: float | None, faults: checks.Faults
    ) -> Any:
        """{input: Actuator}."""
        if isinstance(self.actuator, int | float | np.ndarray | np.number):
            bandwidth = faults.number("actuator", self.actuator, above=0.0)
            if bandwidth is None or faults.sentences or not isinstance(model, StateSpace):
                return None
            each = (None,) * model.m if limits is None else limits.T
            return {
                name: Actuator(bandwidth, limits=own, rate=rate) for name, own in zip(model.inputs, each, strict=True)
            }
        if limits is not None or rate is not None:
            faults.add("`limits` and `rate` are those of the Actuator: give them there.")
        return by_input(self.actuator, model.inputs if isinstance(model, StateSpace) else (), "actuator", faults)

    @property
    def mode(self) -> str:
        """How inputs move: "direct" (with the commands), "held" (actuators, held over a sample) or "moving"."""
        return "direct" if self.actuator is None else "held" if self.held else "moving"

    @property
    def hold(self) -> str:
        """How the input varies between samples: "zero_order" or "first_order"."""
        return "first_order" if self.mode == "moving" else "zero_order"

    @property
    def point(self) -> OperatingPoint:
        """The operating point of the model; zero if it has none."""
        return point_of(self.model)

    @property
    def actuators(self) -> tuple[Actuator, ...]:
        """The actuator of each input."""
        if self.actuator is not None:
            return tuple(self.actuator.get(name, Actuator(np.inf)) for name in self.model.inputs)
        each = (None,) * self.model.m if self.limits is None else self.limits.T
        return tuple(Actuator(np.inf, limits=own, rate=self.rate) for own in each)

    def stages(self) -> list[PlantPhase]:
        """The initial plant with its actuators, and both after each event."""
        m = self.model.m
        stages = [PlantPhase(self.model, self.actuators, (None,) * m, np.ones(m), np.zeros(m))]
        for event in self.events:
            stages.append(event.after(stages[-1]))
        return stages

    def plants_at(self, t: np.ndarray) -> tuple[list[PlantPhase], np.ndarray]:
        """The distinct plants of a run with samples at t (T,), with their actuators, and the index of that of each row. The first
        is the plant before any event."""
        stages, phase = self.stages(), self.phase_rows(t)
        if not self.varies:
            return stages, phase
        distinct, rows = [stages[0]._replace(model=stages[0].model.at(0))], np.zeros(len(t), int)
        for i in np.unique(phase):
            model, on = stages[i].model, np.flatnonzero(phase == i)
            table = [np.reshape(getattr(model, name)[on], (len(on), -1)) for name in model.varying]
            _, first, back = np.unique(
                np.concatenate([np.zeros((len(on), 1)), *table], axis=1), axis=0, return_index=True, return_inverse=True
            )
            rows[on] = len(distinct) + back.ravel()
            distinct += [stages[i]._replace(model=model.at(int(k))) for k in on[first]]
        return distinct, rows

    @property
    def varies(self) -> bool:
        """Whether the matrices of the plant vary from row to row."""
        return any(stage.model.varying for stage in self.stages())

    @property
    def scheduled_by(self) -> tuple[str, ...]:
        """The channels that the matrices follow."""
        return tuple(dict.fromkeys(name for stage in self.stages() for name in stage.model.scheduled_by))

    def along(self, values: Mapping[str, Numbers]) -> "ControlledPlant":
        """The plant at given values of the channels of its schedules, as `StateSpace.along`; also the models of its `Change`s."""

        def followed(model: StateSpace) -> StateSpace:
            return model.along({name: values[name] for name in model.scheduled_by})

        events = [
            replace(event, model=followed(event.model)) if isinstance(event, Change) else event for event in self.events
        ]
        model = followed(self.model)
        if any(one.S is not None for one in (model, *(event.model for event in events if isinstance(event, Change)))):
            checks.refuse("`schedule` must not give S: a plant in a loop is without cross noise.")
        return replace(self, model=model, events=tuple(events))

    def phases(self) -> list[StateSpace]:
        """The initial model, and the model after each event, with the gains of its inputs in B and D."""
        return [
            replace(stage.model, B=stage.model.B * stage.gain, D=stage.model.D * stage.gain) for stage in self.stages()
        ]

    def phase_rows(self, t: np.ndarray) -> np.ndarray:
        """The index of the phase of each row, (T,)."""
        return np.sum([t >= event.time - 1e-9 for event in self.events] + [np.zeros(len(t))], axis=0).astype(int)

    def steps(self, dt: float, t: np.ndarray | None = None) -> Steps:
        """The matrices of a step over `dt` seconds, phase by phase. `t` (T,): of the samples, for a plant that varies."""
        faults = checks.Faults()
        faults.number("dt", dt, above=0.0, unit="seconds")
        if t is not None:
            t = faults.array("t", t, "T")
        faults.finish()
        if t is None or not self.varies:
            return steps_of(self.stages(), self, dt)
        plants, rows = self.plants_at(t)
        return steps_of(plants, self, dt, rows)


def _in_turbulence(model: StateSpace, events: Sequence[Event], turbulence: Turbulence) -> tuple[StateSpace, Any]:
    """The model and the events with the states of the turbulence."""
    checks.require(turbulence=(turbulence, Turbulence))
    if isinstance(events, list | tuple):
        events = [_with_gusts(event, model, turbulence) for event in events]
    return turbulence.into(model), events


def _with_gusts(event: Event, model: StateSpace, turbulence: Turbulence) -> Event:
    """The event for the model with the states of the turbulence."""
    if isinstance(event, Change):
        return replace(event, model=turbulence.into(event.model))
    if isinstance(event, Upset) and np.shape(event.by) == (model.n,):
        return replace(event, by=dict(zip(model.states, event.by, strict=True)))
    return event


def _check_model(model: StateSpace, plant: ControlledPlant, faults: checks.Faults) -> None:
    """Check that the model can be the plant of a loop."""
    if model.m == 0:
        faults.add("`model` must have an input to control. It has none.")
    if model.R is None:
        faults.add("`model` must have R, the covariance of the measurement noise. For noise-free outputs give zeros.")
    if model.S is not None or model.B_end is not None:
        faults.add("`model` must be without cross noise S and without B_end.")
    if plant.actuator is not None and not model.is_continuous:
        faults.add("`model` must be continuous (dt = 0), because `actuator` moves between samples.")
    faults.learn("m", model.m, f"the model has {checks.counted(model.m, 'input')}")
    faults.learn("p", model.p, f"the model has {checks.counted(model.p, 'output')}")


def read_limits(limits: Numbers | None, faults: checks.Faults) -> Any:
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


def _read_events(events: Sequence[Event], model: StateSpace, faults: checks.Faults) -> tuple:
    """The events in order of time, checked against the model."""
    if not isinstance(events, list | tuple) or not all(isinstance(event, Event) for event in events):
        faults.add(
            "`events` must be a list of Failure(time, gain), Stuck(time, input) and other events. Got "
            f"{checks.short(events)}."
        )
        return ()
    if isinstance(model, StateSpace):
        for event in events:
            event.check(model, faults)
    return tuple(sorted(events, key=lambda event: event.time))
