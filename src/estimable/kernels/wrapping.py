"""Angles: differences to the nearest turn, and values in their range. A period of zero marks a quantity that is no angle."""

import jax.numpy as jnp
import numpy as np

from .shapes import Float
from .small import Real


def nearest(difference: Float[Real, "..."], period: Float[Real, "..."] | None) -> Float[Real, "..."]:
    """The difference less whole periods: from -P/2 to P/2. None: nothing here is an angle."""
    if period is None:
        return difference
    period = jnp.asarray(period)
    return difference - period * jnp.round(difference / jnp.where(period > 0, period, 1.0))


def in_range(value: Float[Real, "..."], lower: Float[Real, "..."], period: Float[Real, "..."]) -> Float[Real, "..."]:
    """The value in [lower, lower + P); for JAX and NumPy."""
    xp = np if isinstance(value, np.ndarray) else jnp
    return value - period * xp.floor((value - lower) / np.where(np.asarray(period) > 0, period, 1.0))
