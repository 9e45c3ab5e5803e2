"""A nonlinear model as the plant of a closed loop."""

from collections.abc import Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .. import checks, forks
from ..annotations import Array, Numbers
from ..frozen import replace
from ..kernels.small import factor
from ..models.actuator import Actuator, Actuators, by_input
from ..models.controlled import ControlledPlant, read_limits
from ..models.disturbances import Gust, Upset
from ..models.event_rows import acts
from ..models.events import Change, Event
from ..models.nonlinear_model import NonlinearModel
from ..protocols import Plant
from .moving_actuators import MovingActuators

Changes = Sequence[tuple[float, Mapping[str, float]]]


class NonlinearPlant(Plant):
    """A `NonlinearModel` with actuators as a plant for `close_loop`, whose loop runs in Python.

    States, inputs and outputs of the loop are deviations from the operating point (`states`, `inputs`), and `linear` is the
    linear model there.

    Settings: `model`: continuous. `states` (n,), `inputs` (m,): an equilibrium. `actuator`: a bandwidth [1/s], an `Actuator` for
    all inputs, or {input: Actuator}; their positions are in absolute units. `limits` (2,) or (2, m): the smallest and the largest
    position, in absolute units, where the Actuators have none. `changes`: [(time [s], {parameter: value}), ..], for faults.
    `events`: as in `ControlledPlant`, except `Change` and `Gust`. `noisy`: whether the process noise of the model acts, with the
    random numbers of the loop.

    The positions are exact. The state is integrated by Runge-Kutta's rule of order 4 with the `substeps` of the model.

    >>> from estimable import plants
    >>> upright = NonlinearPlant(plants.pendulum(), np.zeros(4), [0.0], actuator=50.0)
    >>> upright.linear.model.states
    ('position', 'velocity', 'angle', 'rate')
    """

    def __init__(
        self,
        model: NonlinearModel,
        states: Numbers,
        inputs: Numbers,
        *,
        actuator: float | Actuators,
        limits: Numbers | None = None,
        changes: Changes = (),
        events: Sequence[Event] = (),
        noisy: bool = False,
    ):
        faults = checks.Faults()
        if faults.instance("model", model, NonlinearModel) and not model.is_continuous:
            faults.add("`model` must be continuous (dt = 0).")
        if isinstance(actuator, int | float):
            faults.number("actuator", actuator, above=0.0, unit="1/s")
        faults.flag("noisy", noisy)
        faults.finish()
        about = model.linearised(states, inputs)
        point: Any = about.operating_point
        rates = np.asarray(model.f(jnp.asarray(point.states), jnp.asarray(point.inputs), jnp.asarray(model.parameters)))
        if np.abs(rates).max() > 1e-6 * (1 + np.abs(point.states).max()):
            faults.add(f"`states` and `inputs` must be an equilibrium. There dx/dt = {checks.short(rates.tolist())}.")
        self.changes = _read_changes(model, changes, faults)
        faults.learn("m", model.m, f"the model has {checks.counted(model.m, 'input')}")
        moved = _read_actuators(model, actuator, read_limits(limits, faults), point.inputs, faults)
        faults.finish()
        self.model, self.noisy, self.states, self.inputs = model, noisy, point.states, point.inputs
        self.linear = ControlledPlant(replace(about, operating_point=None), actuator=moved, events=events)
        for event in self.linear.events:
            if isinstance(event, Change | Gust):
                faults.add(f"`events`: a nonlinear plant takes no {type(event).__name__}: give `changes`, or an Upset.")
        faults.finish()

    def __repr__(self) -> str:
        return f"NonlinearPlant({checks.listed(self.model.states)})"

    def begin(self, dt: float) -> "_Run":
        """Begin a run at the equilibrium, with samples `dt` seconds apart."""
        return _Run(self, dt)


class _Run:
    """One run, at its current sample."""

    def __init__(self, plant: NonlinearPlant, dt: float):
        self.plant, self.dt, self.x = plant, dt, plant.states.copy()
        self.actuators = MovingActuators(plant.linear, dt)
        self.upsets = [event for event in plant.linear.events if isinstance(event, Upset)]
        self.rest = np.asarray(plant.model.h(plant.states, plant.inputs, plant.model.parameters))

    @property
    def state(self) -> np.ndarray:
        """The state about the equilibrium."""
        return self.x - self.plant.states

    @property
    def input(self) -> np.ndarray:
        """The positions of the actuators about the equilibrium."""
        return self.actuators.acting

    @property
    def output(self) -> np.ndarray:
        """The outputs about the equilibrium, without noise."""
        model, u = self.plant.model, self._effective(self.actuators.position)
        return np.asarray(_output(model, self.x, u, self._parameters)) - self.rest

    @property
    def _parameters(self) -> np.ndarray:
        now = self.actuators.samples * self.dt + 1e-9
        return ([self.plant.model.parameters] + [θ for time, θ in self.plant.changes if time <= now])[-1]

    def _effective(self, position: np.ndarray) -> np.ndarray:
        """The inputs that act on the plant, in absolute units."""
        stage = self.actuators.stage
        return stage.gain * (position + self.plant.inputs + stage.offset)

    def move(self, command: Array, e: Array) -> None:
        """Move one sample under a held command (m,), with unit normal numbers e (n,)."""
        plant, model, t = self.plant, self.plant.model, np.array([self.actuators.samples * self.dt])
        parameters, S = self._parameters, model.substeps or 8
        nodes = []  # of each substep: the input at its beginning, in its middle and at its end
        for _ in range(S):
            halves = []
            for _ in range(2):
                halves += [self.actuators.move(command, self.dt / (2 * S)).begin, self.actuators.position]
            nodes.append([self._effective(p) for p in (halves[0], halves[2], halves[3])])
        upset = sum((event.rates(plant.linear.model) for event in self.upsets if acts(event, t)[0]), np.zeros(model.n))
        self.x = np.asarray(
            _step(
                replace(model, parameters=parameters),
                self.x,
                np.array(nodes),
                upset,
                self.dt,
                e if plant.noisy else 0.0 * e,
            )
        )
        self.actuators.end_sample()


@forks.jit
def _output(model: NonlinearModel, x: Array, u: Array, parameters: Array) -> Any:
    return model.h(x, u, parameters)


@forks.jit
def _step(model: NonlinearModel, x: Array, nodes: Array, upset: Array, dt: float, e: Array) -> Any:
    """The state a sample later: Runge-Kutta with the inputs (S, 3, m) at the nodes of each substep, then the noise."""
    h = dt / nodes.shape[0]

    def f(x: Array, u: Array):
        return model.f(x, u, model.parameters) + upset

    def substep(x: Array, u: Array):
        k1 = f(x, u[0])
        k2 = f(x + h / 2 * k1, u[1])
        k3 = f(x + h / 2 * k2, u[1])
        k4 = f(x + h * k3, u[2])
        return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4), None

    x, _ = jax.lax.scan(substep, x, nodes)
    G = jnp.asarray(model.G if model.noise_input is None else model.noise_input(x, nodes[-1, 2], model.parameters))
    return x + factor(dt * G @ jnp.asarray(model.Q) @ G.T) @ e


def _read_actuators(
    model: NonlinearModel, given: float | Actuators, limits: np.ndarray | None, rest: np.ndarray, faults: checks.Faults
) -> dict[str, Actuator]:
    """{input: Actuator}, about the equilibrium."""
    if isinstance(given, int | float):
        if faults.sentences:
            return {}
        each = (None,) * model.m if limits is None else limits.T
        read = {name: Actuator(given, limits=own) for name, own in zip(model.inputs, each, strict=True)}
    else:
        read = by_input(given, model.inputs, "actuator", faults)
        if limits is not None:
            faults.add("`limits` are those of the Actuator: give them there.")
    return {name: replace(one, operating_point=rest[model.inputs.index(name)]) for name, one in read.items()}


def _read_changes(model: NonlinearModel, changes: Changes, faults: checks.Faults) -> list[tuple[float, np.ndarray]]:
    """[(time, parameters)] in order of time; each change keeps those before it."""
    found, θ = [], dict(zip(model.parameter_names, model.parameters, strict=True))
    for time, values in sorted(changes, key=lambda change: change[0]):
        faults.number("time of a change", time, lower=0.0, unit="seconds")
        for name in values:
            if name not in θ:
                near = checks.suggestion(name, model.parameter_names)
                faults.add(
                    f"`changes`: the model has no parameter {name!r}: {checks.listed(model.parameter_names)}.{near}"
                )
        θ = {**θ, **values}
        found.append((float(time), np.array(list(θ.values()), float)))
    return found
