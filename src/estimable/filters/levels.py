"""An unknown input that takes one of finitely many values: decide which, then know it."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from .. import checks
from ..annotations import Array, Numbers
from ..frozen import replace
from ..kernels import kalman
from ..kernels.small import solve_lower, triangularise
from .belief import Belief
from .unknown_layout import Layout


def read(given: Numbers, faults: checks.Faults) -> Any:
    """The levels as (q, d)."""
    if checks.is_traced(given):
        return given
    if np.size(np.asarray(given, object)) == 0:
        faults.add("`levels` must hold at least one value.")
        return None
    if np.ndim(np.asarray(given, object)) == 1 and faults.sizes.get("d") == 1:
        given = [[value] for value in given]
    return faults.array("levels", given, "q d")


def decide(s: Belief, levels: Array, layout: Layout) -> tuple[Belief, dict, Any]:
    """The belief with its oldest input at the likeliest level, where the outputs have told of it, and the probability.

    Also the log-density of the decided level, which makes the likelihood that of a known input.
    """
    n, d = layout.n, layout.d
    at = slice(n, n + d)
    L = triangularise(s.factor[at])
    distance = solve_lower(L, (levels - s.mean[at][None, :]).T)
    distance = jnp.sum(distance * distance, axis=0)  # squared, in standard deviations: (q,)
    best = jnp.argmin(distance)
    told = jnp.sum(s.diffuse[at] ** 2) == 0.0
    weight = jnp.exp((jnp.min(distance) - distance) / 2)
    m, Z, X, size = s.mean, s.factor, s.diffuse, s.size
    if s.drift_mean is not None:  # the drift too is told of by the decision
        m, Z = jnp.concatenate([m, s.drift_mean]), jnp.concatenate([Z, s.drift_factor])
        X, size = jnp.concatenate([X, jnp.zeros_like(X)]), jnp.concatenate([size, jnp.zeros_like(size)])
    C = jnp.eye(len(m))[at]
    post = kalman.correct(
        m, Z, X, C, jnp.zeros(d), jnp.zeros((d, d)), None, levels[best], jnp.broadcast_to(told, (d,)), size, s.log_scale
    )
    known = replace(s, mean=post.m[: layout.size], factor=post.Z[: layout.size], diffuse=post.X[: layout.size])
    if s.drift_mean is not None:
        known = replace(known, drift_mean=post.m[layout.size :], drift_factor=post.Z[layout.size :])
    extra = {"level": jnp.where(told, best, -1), "level_probability": jnp.where(told, 1 / jnp.sum(weight), 0.0)}
    return known, extra, post.log_likelihood
