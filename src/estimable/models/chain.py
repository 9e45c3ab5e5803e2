"""Healthy actuators between the logged commands and the inputs of a model, step by step."""

from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np

from .. import checks
from ..annotations import Array, Numbers
from ..frozen import frozen, static
from ..kernels.actuator_motion import glide
from .actuator import Actuator, ages, parts_of
from .sampled import Clock


@frozen
class ChainState:
    """The positions (m,), the last commands (L, m), the newest first, and 1 once the first command has come."""

    position: Any
    commands: Any
    begun: Any


@frozen
class Chain:
    """The actuators of all inputs, (m,) each. `moves`: 1 for an input that has one. `parts`: (seconds, ages) of the parts of a
    step; None: one part, of the length of the step."""

    bandwidth: Any
    rate: Any
    reach: Any
    lower: Any
    upper: Any
    moves: Any
    start: Any
    parts: Any
    history: int = static(default=1)

    def init(self) -> ChainState:
        """At `start`; None: where the first command holds the actuators."""
        m = np.shape(self.bandwidth)[-1]
        rest = jnp.zeros(m) if self.start is None else jnp.asarray(self.start)
        begun = jnp.asarray(0.0 if self.start is None else 1.0)
        return ChainState(rest, jnp.broadcast_to(rest, (self.history, m)), begun)

    def position(self, state: ChainState, command: Array) -> Any:
        """The inputs at a sample: the positions of the actuators, and the commands of inputs without one."""
        settled = jnp.where(state.begun > 0, state.position, self._within(command))
        return jnp.where(jnp.asarray(self.moves) > 0, settled, command)

    def step(self, state: ChainState, command: Array, dt: Array) -> tuple[ChainState, Any]:
        """The state after an interval under a held command, and the mean of the positions over it."""
        p, held = self.position(state, command), jnp.broadcast_to(command, state.commands.shape)
        p = jnp.where(jnp.asarray(self.moves) > 0, p, command)
        commands = jnp.where(state.begun > 0, jnp.concatenate([command[None], state.commands[:-1]]), held)
        total = jnp.zeros(p.shape)
        for seconds, age in ((jnp.broadcast_to(dt, p.shape), None),) if self.parts is None else self.parts:
            c = self._within(command if age is None else jnp.sum(jnp.asarray(age) * commands, axis=0))
            p, integral = glide(
                p, c, jnp.asarray(self.bandwidth), jnp.asarray(self.rate), jnp.asarray(self.reach), seconds
            )
            total = total + integral
        return ChainState(p, commands, jnp.ones(())), total / dt

    def _within(self, command: Array) -> Any:
        return jnp.clip(command, self.lower, self.upper)


def chain(actuators: Mapping[str, Actuator], inputs: tuple[str, ...], start: Numbers | None, clock: Clock) -> Chain:
    """The actuators of the inputs, for the steps of a record. Raises `InputError` for delays in a record of unequal steps."""
    each = [actuators.get(name, Actuator(np.inf)) for name in inputs]
    lower, upper, rate, reach, bandwidth, delay = (
        np.stack(np.broadcast_arrays(*values), axis=-1).astype(float)
        for values in (
            *zip(*(actuator.stops for actuator in each), strict=True),
            *([getattr(actuator, name) for actuator in each] for name in ("fastest", "reach", "bandwidth", "delay")),
        )
    )
    parts, history = None, 1
    if np.any(delay):
        lengths = np.unique(np.asarray(clock.lengths))
        if len(lengths) > 1:
            checks.refuse(
                f"an actuator has a delay, and the steps vary from {lengths[0]:g} to {lengths[-1]:g} s: a delay needs equal "
                "steps. Resample the record."
            )
        found = parts_of(delay, float(lengths[0]))
        chosen = ages(found)
        parts, history = (
            tuple((part.seconds, age) for part, age in zip(found, chosen, strict=True)),
            chosen[0].shape[-2],
        )
    moves = np.array([float(name in actuators) for name in inputs])
    shape = bandwidth.shape
    return Chain(
        bandwidth, np.minimum(rate, 1e300), reach, lower, upper, np.broadcast_to(moves, shape),
        None if start is None else np.broadcast_to(start, shape), parts, history,
    )  # fmt: skip
