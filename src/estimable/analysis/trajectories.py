"""A nonlinear model along a trajectory: its tangents as the stages of a covariance analysis."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .. import forks
from ..kernels import flow
from ..kernels.step_factors import semidefinite_factor
from ..models.nonlinear_model import NonlinearModel
from .covariance_problem import Stage, blocks, factors

Real = np.ndarray


def stages_along(
    model: NonlinearModel, x0: Real, θ: Real, u: Real, seen: Real, dt: float, *, free: bool
) -> list[Stage]:
    """A stage for each row of u (T, m), at the outputs `seen` (T, p), along the path from x0 without noise.

    `free`: whether the parameters θ are states too. The tangents are those of (x, θ) by derivatives of f and h. Between the
    samples of a continuous model they are integrated together with the path, as is the process noise.
    """
    n, k = model.n, len(θ) if free else 0
    run = forks.jit(lambda start, rows: jax.lax.scan(_row(model, θ, dt, k), start, rows))
    start = jnp.concatenate([jnp.asarray(x0, float), jnp.asarray(θ, float)]) if free else jnp.asarray(x0, float)
    found = [np.asarray(part) for part in run(start, jnp.asarray(u))[1]]
    R, groups = np.asarray(model.R), blocks(np.asarray(model.R))
    V, stages = factors(R, groups), []
    A, g = np.eye(n + k), np.zeros((n + k, 0))
    for C, now, Φ, noise in zip(found[0], seen, *found[1:], strict=True):
        stages.append(Stage(A, [g], C[now], [half[now] for half in V]))
        A, g = Φ, semidefinite_factor(noise)
    return stages


def _row(model: NonlinearModel, θ: Real, dt: float, k: int) -> Callable[..., Any]:
    """One row: z = (x, θ) or x, then the tangents C of its output, Φ of the step, and the noise of the step."""
    n = model.n

    def parts(z: jax.Array) -> tuple[jax.Array, jax.Array]:
        return z[:n], z[n:] if k else jnp.asarray(θ)

    def noise_input(z: jax.Array, u: jax.Array) -> Any:
        G = model.G if model.noise_input is None else model.noise_input(parts(z)[0], u, parts(z)[1])
        half = jnp.asarray(G) @ jnp.asarray(semidefinite_factor(np.asarray(model.Q)))
        return jnp.concatenate([half, jnp.zeros((k, half.shape[1]))])

    def row(z: jax.Array, u: jax.Array) -> tuple[Any, tuple[Any, Any, Any]]:
        def move(w: jax.Array) -> jax.Array:
            rate = model.f(parts(w)[0], u, parts(w)[1])
            still = jnp.zeros(k) if model.is_continuous else w[n:]
            return jnp.concatenate([rate, still])

        C = jax.jacfwd(lambda w: model.h(parts(w)[0], u, parts(w)[1]))(z)
        if not model.is_continuous:
            W = noise_input(z, u)
            return move(z), (C, jax.jacfwd(move)(z), W @ W.T)
        derivative = flow.moment_derivative(lambda w, t: move(w), lambda w, t: noise_input(w, u), 1)
        begin = flow.Moments(z, jnp.eye(n + k), jnp.zeros((n + k, n + k)))
        (end, Φ, noise), _ = flow.integrate(derivative, begin, dt, model.substeps)
        return end, (C, Φ, noise)

    return row
