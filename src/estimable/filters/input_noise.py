"""Process noise due to an uncertain input between two samples (`Interval.u_covariance`, `u_diffusion`)."""

import jax.numpy as jnp

from .. import checks
from ..annotations import Array
from ..kernels.joint_gain import effects
from ..kernels.small import factor, product
from ..models.sampled import SampledModel
from ..results import Interval


def with_input_noise(W: Array, model: SampledModel, interval: Interval, gains: Array) -> Array:
    """W (n, q) with columns added for the effect of input errors on the next state; W itself where the input is known.

    B = [B0 B1 ..] side by side acts as B(θ) = Σ θ~_i B_i with θ~ = (1, θ); `gains` (blocks, l) is a factor of E[θ~ θ~'], or 1
    where no gain is estimated. An error e that is constant over the step adds (B(θ) + B_end(θ)) e. A random walk adds
    Σ_k Ψ_k(θ) e_k, Ψ of `SampledModel.wandering`. Cost: m (1 + n) l times that of B u.
    """
    if interval.u_covariance is None and interval.u_diffusion is None:
        return W
    moves = []
    if interval.u_covariance is not None:
        B = model.B if model.B_end is None else model.B + model.B_end
        L = factor(jnp.asarray(interval.u_covariance))
        moves += [(B, L[:, j]) for j in range(L.shape[1])]
    if interval.u_diffusion is not None:
        if model.wandering is None:
            checks.refuse(
                "`u_diffusion` needs a continuous model (dt = 0) and a clock made with wanders=True: a discrete model does not "
                "describe its input between samples."
            )
        sd = jnp.sqrt(jnp.asarray(interval.u_diffusion))
        moves += [(Ψ, sd[j] * jnp.eye(len(sd))[j]) for Ψ in model.wandering for j in range(len(sd))]
    columns = [product(effects(blocks, e, gains.shape[0]), gains) for blocks, e in moves]
    return jnp.concatenate([W, *columns], axis=1)


def refuse_wandering_input(interval: Interval) -> None:
    """For steps in which an input error is constant."""
    if interval.u_diffusion is not None:
        checks.refuse(
            "this needs an input that does not wander between samples, but an interval has `u_diffusion`. Give "
            "`u_covariance`, the covariance of an error that is constant over the interval."
        )


def refuse_unknown_input(interval: Interval) -> None:
    """For steps that need to know the input."""
    if interval.u_covariance is not None or interval.u_diffusion is not None:
        checks.refuse(
            "this needs an input that is known between samples, but an interval has `u_covariance` or `u_diffusion`."
        )
