"""A nonlinear model as the plant of a closed loop."""

from collections.abc import Mapping, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np

from .. import checks, forks
from ..annotations import Array, Numbers
from ..frozen import replace
from ..kernels.flow import runge_kutta
from ..kernels.small import factor
from ..models.controlled import ControlledPlant, read_limits
from ..models.nonlinear_model import NonlinearModel
from ..protocols import Plant

Changes = Sequence[tuple[float, Mapping[str, float]]]


class NonlinearPlant(Plant):
    """A `NonlinearModel` with actuators as a plant for `close_loop`, whose loop runs in Python.

    States and inputs of the loop are deviations from the operating point (`states`, `inputs`), and `linear` is the linear model
    there.
    The position i of an actuator follows its command by di/dt = `actuator` (command - i).

    Settings: `model`: continuous. `states` (n,), `inputs` (m,): an equilibrium. `actuator` [1/s]. `limits` (2,) or (2, m): the
    smallest and the largest command, in absolute units. `changes`: [(time [s], {parameter: value}), ..], for faults. `noisy`:
    whether the process noise of the model acts, with the random numbers of the loop.

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
        actuator: float,
        limits: Numbers | None = None,
        changes: Changes = (),
        noisy: bool = False,
    ):
        faults = checks.Faults()
        if faults.instance("model", model, NonlinearModel) and not model.is_continuous:
            faults.add("`model` must be continuous (dt = 0).")
        self.bandwidth = faults.number("actuator", actuator, above=0.0, unit="1/s")
        faults.flag("noisy", noisy)
        faults.finish()
        about = model.linearised(states, inputs)
        point: Any = about.operating_point
        rates = np.asarray(model.f(jnp.asarray(point.states), jnp.asarray(point.inputs), jnp.asarray(model.parameters)))
        if np.abs(rates).max() > 1e-6 * (1 + np.abs(point.states).max()):
            faults.add(f"`states` and `inputs` must be an equilibrium. There dx/dt = {checks.short(rates.tolist())}.")
        self.changes = _read_changes(model, changes, faults)
        faults.learn("m", model.m, f"the model has {checks.counted(model.m, 'input')}")
        own = read_limits(limits, faults)
        faults.finish()
        self.model, self.noisy, self.states, self.inputs = model, noisy, point.states, point.inputs
        self.linear = ControlledPlant(
            replace(about, operating_point=None),
            actuator=self.bandwidth,
            limits=None if own is None else own - point.inputs,
        )

    def __repr__(self) -> str:
        return f"NonlinearPlant({checks.listed(self.model.states)})"

    def begin(self, dt: float) -> "_Run":
        """Begin a run at the equilibrium, with samples `dt` seconds apart."""
        return _Run(self, dt)


class _Run:
    """One run, at its current sample."""

    def __init__(self, plant: NonlinearPlant, dt: float):
        self.plant, self.dt, self.samples = plant, dt, 0
        self.x, self.position = plant.states.copy(), plant.inputs.copy()

    @property
    def state(self) -> np.ndarray:
        """The state about the equilibrium."""
        return self.x - self.plant.states

    @property
    def input(self) -> np.ndarray:
        """The positions of the actuators about the equilibrium."""
        return self.position - self.plant.inputs

    def move(self, command: Array, e: Array) -> None:
        """Move one sample under a held command (m,), with unit normal numbers e (n,)."""
        plant, model = self.plant, self.plant.model
        now = [θ for time, θ in plant.changes if time <= self.samples * self.dt + 1e-9]
        parameters = now[-1] if now else model.parameters
        after = _step(replace(model, parameters=parameters), self.x, self.position, command + plant.inputs, plant.bandwidth,
                      self.dt, e if plant.noisy else np.zeros(model.n))  # fmt: skip
        self.x, self.position = (np.asarray(part) for part in after)
        self.samples += 1


@forks.jit
def _step(
    model: NonlinearModel, x: Array, position: Array, command: Array, bandwidth: float, dt: float, e: Array
) -> tuple[Any, Any]:
    """The state and the positions a sample later: exact positions, Runge-Kutta for the state, then its noise."""

    def f(t: Array, x: Array):
        moved = command + (position - command) * jnp.exp(-bandwidth * t)
        return model.f(x, moved, model.parameters)

    x = runge_kutta(f, x, dt, model.substeps or 8)
    G = jnp.asarray(model.G if model.noise_input is None else model.noise_input(x, command, model.parameters))
    return x + factor(dt * G @ jnp.asarray(model.Q) @ G.T) @ e, command + (position - command) * jnp.exp(
        -bandwidth * dt
    )


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
