"""Moments and quantiles of a mixture of distributions that are known by theirs.

Letters: w (K,) weights; m (K, n) and P (K, n, n) means and covariances of the members.
"""

import jax.numpy as jnp
import numpy as np

from .mixture_quantiles import SCORES, inverted, normal_distribution
from .shapes import Float
from .small import Real

NARROWEST = 1e-300


def merged(w: Float[Real, " K"], m: Float[Real, "K n"], P: Float[Real, "K n n"]) -> tuple[Real, Real]:
    """The mean and covariance of the mixture: the mean of the covariances, and the covariance of the means."""
    mean = jnp.sum(w[:, None] * m, axis=0)
    apart = m - mean[None]
    return mean, jnp.sum(w[:, None, None] * (P + apart[:, :, None] * apart[:, None, :]), axis=0)


def merged_quantiles(w: Float[Real, " K"], x: Float[Real, "K g q"]) -> Float[Real, "g q"]:
    """The quantiles `LEVELS` of the mixture of distributions with the quantiles x.

    Between its quantiles, and beyond them, the normal score of a member is linear: exact for a Gaussian.
    """
    held = (w > 0)[:, None, None]
    low = jnp.min(jnp.where(held, x, jnp.inf), axis=0)
    high = jnp.max(jnp.where(held, x, -jnp.inf), axis=0)
    slope = np.diff(SCORES)[None, None] / jnp.maximum(x[..., 1:] - x[..., :-1], NARROWEST)

    return inverted(lambda at: jnp.sum(w[:, None, None] * normal_distribution(_score(at, x, slope)), axis=0), low, high)


def _score(at: Float[Real, "g q"], x: Float[Real, "K g q"], slope: Float[Real, "K g r"]) -> Float[Real, "K g q"]:
    """The normal score of each member at each number: through (x_i, SCORES_i), by the segment that holds it."""
    at = at[None]
    score = SCORES[0] + slope[..., :1] * (at - x[..., :1])
    for i in range(1, len(SCORES) - 1):
        score = jnp.where(at > x[..., i : i + 1], SCORES[i] + slope[..., i : i + 1] * (at - x[..., i : i + 1]), score)
    return score


def gaussian_quantiles(mean: Float[Real, " g"], covariance: Float[Real, "g g"]) -> Float[Real, "g q"]:
    """The quantiles of each of some Gaussian numbers."""
    sd = jnp.sqrt(jnp.sum(covariance * jnp.eye(len(mean)), axis=1))
    return mean[:, None] + sd[:, None] * SCORES[None]
