"""An unknown input with finitely many values: decide which, then use it as known."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from .. import checks
from ..annotations import Array, Numbers
from ..frozen import replace
from ..kernels.kalman import Gaussian, Measurement, correct
from ..kernels.small import solve_lower, triangularise
from .belief import Belief
from .unknown_layout import Layout


def read(given: Numbers, faults: checks.Faults) -> Any:
    """The levels as (q, d)."""
    if checks.is_traced(given):
        return given
    values = np.asarray(given, object)
    if np.size(values) == 0:
        faults.add("`levels` must hold at least one value.")
        return None
    if checks.depth(values) == 1 and faults.sizes.get("d") == 1:
        given = [[value] for value in values]
    return faults.array("levels", given, "q d")


def decide(s: Belief, levels: Array, layout: Layout) -> tuple[Belief, dict, Any]:
    """The belief with its oldest input at the likeliest level, where the outputs determine it, and the probability.

    Also the log-density of the decided level, with which the likelihood is that of a known input.
    """
    n, d = layout.n, layout.d
    at = slice(n, n + d)
    L = triangularise(s.factor[at])
    distance = solve_lower(L, (levels - s.mean[at][None, :]).T)
    distance = jnp.sum(distance * distance, axis=0)  # squared, in standard deviations: (q,)
    best = jnp.argmin(distance)
    determined = jnp.sum(s.diffuse[at] ** 2) == 0.0
    weight = jnp.exp((jnp.min(distance) - distance) / 2)
    prior = s.gaussian if s.drift is None else _with_drift(s)
    exactly = Measurement(jnp.eye(len(prior.m))[at], jnp.zeros(d), jnp.zeros((d, d)))
    post = correct(prior, exactly, levels[best], jnp.broadcast_to(determined, (d,)))
    m, Z, X, _, _ = post.state
    known = replace(s, mean=m[: layout.size], factor=Z[: layout.size], diffuse=X[: layout.size])
    if s.drift is not None:
        known = replace(known, drift_mean=m[layout.size :], drift_factor=Z[layout.size :])
    probability = jnp.where(determined, 1 / jnp.sum(weight), 0.0)
    extra = {"level": jnp.where(determined, best, -1), "level_probability": probability}
    return known, extra, post.log_likelihood


def _with_drift(s: Belief) -> Gaussian:
    """The belief about state and process noise: a decided level is information about both."""
    return Gaussian(
        jnp.concatenate([s.mean, s.drift_mean]),
        jnp.concatenate([s.factor, s.drift_factor]),
        jnp.concatenate([s.diffuse, jnp.zeros_like(s.diffuse)]),
        jnp.concatenate([s.size, jnp.zeros_like(s.size)]),
        s.log_scale,
    )
