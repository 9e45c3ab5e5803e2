"""An unknown input with finitely many values: the belief is the sum over them."""

import math
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


def weigh(s: Belief, levels: Array, layout: Layout) -> tuple[Belief, dict, Any]:
    """The belief with its oldest input on the levels, where the outputs determine it: the mean and covariance of the sum over the
    levels, each with its probability (G. Ackerson, K. Fu 1970).

    Also the logarithm of the mean of their densities, with which the likelihood is that of an input on one of them. The
    covariance given a level is the same for each: what the sum adds is the spread of the means.
    """
    n, d = layout.n, layout.d
    at = slice(n, n + d)
    L = triangularise(s.factor[at])
    distance = solve_lower(L, (levels - s.mean[at][None, :]).T)
    distance = jnp.sum(distance * distance, axis=0)  # squared, in standard deviations: (q,)
    nearest = jnp.min(distance)
    weight = jnp.exp((nearest - distance) / 2)
    total = jnp.sum(weight)
    w = weight / total
    determined = jnp.sum(s.diffuse[at] ** 2) == 0.0
    prior = s.gaussian if s.drift is None else _with_drift(s)
    exactly = Measurement(jnp.eye(len(prior.m))[at], jnp.zeros(d), jnp.zeros((d, d)))
    seen = jnp.broadcast_to(determined, (d,))
    posts = [correct(prior, exactly, level, seen) for level in levels]
    m = jnp.sum(jnp.stack([w[i] * post.state.m for i, post in enumerate(posts)]), axis=0)
    apart = jnp.stack([jnp.sqrt(w[i]) * (post.state.m - m) for i, post in enumerate(posts)], axis=1)
    post = posts[0]
    Z, X = triangularise(jnp.concatenate([post.state.Z, apart], axis=1)), post.state.X
    known = replace(s, mean=m[: layout.size], factor=Z[: layout.size], diffuse=X[: layout.size])
    if s.drift is not None:
        known = replace(known, drift_mean=m[layout.size :], drift_factor=Z[layout.size :])
    best = jnp.argmin(distance)
    extra = {"level": jnp.where(determined, best, -1), "level_probability": jnp.where(determined, 1 / total, 0.0)}
    own = (distance[0] - nearest) / 2 - math.log(len(levels))  # of the first level's density against the largest
    if (
        layout.freedom == "none"
    ):  # the diffuse likelihood has a factor (2 pi)^(-d/2) for the input, which was not Gaussian
        own = own + d / 2 * math.log(2 * math.pi)
    return known, extra, jnp.where(determined, post.log_likelihood + own + jnp.log(total), 0.0)


def _with_drift(s: Belief) -> Gaussian:
    """The belief about state and process noise: a decided level is information about both."""
    return Gaussian(
        jnp.concatenate([s.mean, s.drift_mean]),
        jnp.concatenate([s.factor, s.drift_factor]),
        jnp.concatenate([s.diffuse, jnp.zeros_like(s.diffuse)]),
        jnp.concatenate([s.size, jnp.zeros_like(s.size)]),
        s.log_scale,
    )
