"""The plant and its actuators in a loop: one step of their motion, with the matrices of the phase."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from ..annotations import Array
from ..frozen import replace
from ..kernels.actuator_motion import ramp, series
from ..kernels.small import apply
from ..models.plant_steps import Motion, Piece, Steps

CONSTANT = ("rest", "limits", "reach", "quantum", "resolution", "rows")  # the same in all phases


def row_of(plant: Steps, k: int | Array) -> Steps:
    """The plant at row k, in one phase; itself where it does not vary from row to row."""
    if plant.rows is None:
        return plant
    phase = plant.rows[k]
    constant = {name: getattr(plant, name) for name in CONSTANT} | {"rows": None}
    varying = jax.tree_util.tree_map(
        lambda stack: jax.lax.dynamic_slice_in_dim(stack, phase, 1) if len(stack) > 1 else stack,
        replace(plant, **dict.fromkeys(CONSTANT)),
    )
    return replace(varying, **constant)


def phase_of(plant: Steps, weight: Array) -> Steps:
    """The plant in the phase whose weight is 1."""

    def chosen(stack: Array) -> Any:
        M = jnp.asarray(stack[0])
        for i in range(1, len(stack)):
            M = jnp.where(weight[i] > 0, jnp.asarray(stack[i]), M)
        return M

    constant = {name: getattr(plant, name) for name in CONSTANT}
    varying = jax.tree_util.tree_map(chosen, replace(plant, **dict.fromkeys(CONSTANT)))
    return replace(varying, **{name: None if M is None else jnp.asarray(M) for name, M in constant.items()})


class MovedPlant(NamedTuple):
    """The next deviation of the state, the positions at the next sample, and those that act at this one, (m,)."""

    x: Any
    position: Any
    acting: Any


def placed(now: Steps, position: Array) -> Any:
    """The positions after a fault has moved them at its onset."""
    if now.motion is None or now.motion.place is None:
        return position
    place = now.motion.place
    return jnp.where(place == place, place, position)


def acting(now: Steps, position: Array) -> Any:
    """The positions with the offsets of faults."""
    return position if now.offset is None else position + now.offset


def effective(now: Steps, position: Array) -> Any:
    """K p + b: the deviation of the input that acts on the plant."""
    scaled = position if now.gain is None else now.gain * position
    return scaled if now.bias is None else scaled + now.bias


def move(now: Steps, x: Array, position: Array, commands: Array, noise: Array) -> MovedPlant:
    """Move the plant and its actuators over a step; `commands` (L, m): the last ones, the newest first."""
    free = apply(now.A, x) + apply(now.W, noise)
    if now.motion is None:
        return MovedPlant(free + apply(now.B, effective(now, commands[0])), commands[0], acting(now, commands[0]))
    end, responses = position, []
    for piece in now.motion.pieces:
        end, response = _moved(now, piece, end, commands)
        responses.append(response)
    if now.mode != "moving":
        input = end if now.mode == "direct" else position
        return MovedPlant(free + apply(now.B, effective(now, input)), end, acting(now, input))
    x = free + sum(responses)
    return MovedPlant(x if now.bias is None else x + apply(now.B, now.bias), end, acting(now, position))


def _moved(now: Steps, piece: Piece, p: Array, commands: Array) -> tuple[Any, Any]:
    """The positions at the end of a part of a step, and the response of the plant at the end of the step."""
    assert now.motion is not None
    c = _towards(now.motion, piece, p, commands)
    K = 1.0 if now.gain is None else now.gain
    if now.motion.rate is None:
        end = c + (p - c) * piece.decay
        return end, None if piece.lag is None else apply(piece.step, K * p) + apply(piece.lag, K * (c - p))
    way = ramp(p, c, now.motion.rate, now.motion.reach, piece.seconds)
    s = piece.scale * way.rest - 1
    end = c + (way.end - c) * series(piece.decay, s)
    if piece.lag is None:
        return end, None
    ramps = apply(piece.ramp - series(piece.ramp_series, s), K * way.speed)
    return end, apply(piece.step, K * p) + ramps + apply(series(piece.lag, s), K * (c - way.end))


def _towards(motion: Motion, piece: Piece, p: Array, commands: Array) -> Any:
    """Where each actuator moves: its delayed command within its limits, or where a fault drives it."""
    c = jnp.sum(piece.late * commands, axis=0) if commands.shape[0] > 1 else commands[0]
    c = jnp.clip(c, motion.lower, motion.upper)
    if motion.driven is None:
        return c
    return jnp.where(motion.driven == 1, motion.target, jnp.where(motion.driven == 2, p, c))
