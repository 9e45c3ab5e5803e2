"""Quantiles of mixtures of Gaussian distributions.

Reference: M. Abramowitz, I. A. Stegun, Handbook of Mathematical Functions (1964), 7.1.28: the error function to 3e-7 by products
alone, which processors compute side by side; errors of a quantile are then below 3e-6 standard deviations.
"""

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from jax import lax

from .shapes import Float
from .small import Real

LEVELS = np.array([0.025, 0.16, 0.5, 0.84, 0.975])
SCORES = np.array([-1.959963984540054, -0.994457883209753, 0.0, 0.994457883209753, 1.959963984540054])  # of N(0, 1)
TAIL = (0.0705230784, 0.0422820123, 0.0092705272, 0.0001520143, 0.0002765672, 0.0000430638)  # 7.1.28
HALVINGS = 22  # of an interval that holds the quantile
NARROWEST = 1e-12  # standard deviation of a component that is a number, relative to the widest
SIXTEENTH = 4  # squarings


def normal_distribution(z: Float[Real, "..."]) -> Float[Real, "..."]:
    """P(N(0, 1) <= z) by 7.1.28."""
    x, power = jnp.abs(z) * np.sqrt(0.5), 0.0
    for a in reversed(TAIL):
        power = (power + a) * x
    power = 1 + power
    for _ in range(SIXTEENTH):
        power = power * power
    tail = 0.5 / power
    return jnp.where(z < 0, tail, 1 - tail)


def quantiles(
    mean: Float[Real, "g k"], variance: Float[Real, "g k"], weight: Float[Real, " k"]
) -> Float[Real, "g q"]:
    """The quantiles `LEVELS` of g mixtures of k Gaussians; the weights sum to one. By bisection between those of the components.

    Cost: `HALVINGS` q g k evaluations of a normal distribution.
    """
    sd = jnp.sqrt(jnp.maximum(variance, 0.0))
    held = weight > 0
    there = mean[:, None] + SCORES[None, :, None] * sd[:, None]                    # (g, q, k)
    low = jnp.min(jnp.where(held[None, None], there, jnp.inf), axis=2)
    high = jnp.max(jnp.where(held[None, None], there, -jnp.inf), axis=2)
    widest = jnp.max(jnp.where(held[None], sd, 0.0), axis=1, keepdims=True)
    inverse = 1 / jnp.maximum(sd, NARROWEST * widest + 1e-300)

    def distribution(x: Real) -> Real:
        """The weighted sum of the normal distributions at x (g, q)."""
        z = (x[:, :, None] - mean[:, None]) * inverse[:, None]
        return jnp.sum(weight[None, None] * normal_distribution(z), axis=2)

    return inverted(distribution, low, high)


def inverted(
    distribution: Callable[[Real], Real], low: Float[Real, "g q"], high: Float[Real, "g q"]
) -> Float[Real, "g q"]:
    """The numbers at which the distribution of each row is `LEVELS`, by bisection between `low` and `high`."""

    def halve(_: int | Real, ends: tuple[Real, Real]) -> tuple[Real, Real]:
        """The half of each interval that holds its number."""
        low, high = ends
        middle = (low + high) / 2
        right = distribution(middle) < LEVELS[None]
        return jnp.where(right, middle, low), jnp.where(right, high, middle)

    low, high = lax.fori_loop(0, HALVINGS, halve, (low, high))
    return (low + high) / 2
