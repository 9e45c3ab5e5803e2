"""The motion of a plant in a simulation: one row of time, with noises drawn as unit white numbers."""

from typing import Any

import jax.numpy as jnp

from .. import checks
from ..annotations import Array
from ..kernels.flow import runge_kutta
from ..kernels.small import apply
from ..models.nonlinear_model import NonlinearModel
from ..models.plant import Functions, plant
from ..models.sampled import Clock, SampledModel, sample
from ..models.state_space import StateSpace
from ..results import Interval

PIECES = 8  # parts of a step of a continuous model with an adaptive integrator, with noise added after each


def ready(model: StateSpace | NonlinearModel, clock: Clock) -> SampledModel | Functions:
    """`model` prepared for the steps of `clock`."""
    if isinstance(model, StateSpace):
        return sample(model, clock)
    made = plant(model, clock)
    if not isinstance(made, Functions):
        checks.refuse(f"`model` cannot be simulated. Got {type(model).__name__}.")
    return made


def origin(model: SampledModel | Functions) -> Any:
    """The origin of the states, (n,)."""
    return model.origin if isinstance(model, Functions) else model.point.states


def noises(model: SampledModel | Functions) -> int:
    """The number of unit white numbers per row."""
    if isinstance(model, Functions):
        return model.V.shape[-1] + model.white.shape[-1] * _pieces(model)
    return model.V.shape[-1] + model.W.shape[-1]


def _pieces(model: Functions) -> int:
    return 1 if not model.continuous else PIECES if model.substeps is None else model.substeps


def move(model: SampledModel | Functions, x: Array, k: int | Array, interval: Interval, e: Array) -> tuple[Any, Any]:
    """The next state and the present output, (n,) and (p,); states are relative to `origin`."""
    if isinstance(model, Functions):
        return _move_functions(model, x, interval, e)
    now, point, p = model.at(k), model.point, model.V.shape[-1]
    u, e, e_free = interval.u - point.inputs, e[:p], e[p:]
    y = point.outputs + apply(now.C, x) + apply(now.D, u) + apply(now.V, e)
    x_next = apply(now.A, x) + apply(now.B, u) + apply(now.W, e_free)
    if now.B_end is not None:
        x_next = x_next + apply(now.B_end, interval.u_end - point.inputs)
    return (x_next if now.Ω is None else x_next + apply(now.Ω, e)), y


def _move_functions(model: Functions, x: Array, interval: Interval, e: Array) -> tuple[Any, Any]:
    """Discrete: exact. Continuous: the drift by Runge-Kutta, the noise added piece by piece (Euler-Maruyama)."""
    p, pieces, θ = model.V.shape[-1], _pieces(model), model.θ
    y = model.output(x, θ, interval.u) + apply(model.V, e[:p])
    white = e[p:].reshape(pieces, -1)
    if not model.continuous:
        return model.next_state(x, θ, interval) + apply(model.noise(x, θ, interval.u), white[0]), y
    f, h = model.derivative(interval), interval.dt / pieces
    for i in range(pieces):
        W = model.noise(x, θ, interval.u)
        x = runge_kutta(lambda t, x, i=i: f(x, θ, i * h + t), x, h, 1) + jnp.sqrt(h) * apply(W, white[i])
    return x, y
