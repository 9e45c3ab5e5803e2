"""The measurement noise of one sample."""

import jax.numpy as jnp

from ..annotations import Array
from ..results import Sample


def noise_of(V: Array, sample: Sample) -> Array:
    """The factor V (p, p) of R, with the standard deviations that the sample gives and the correlations of the model."""
    if sample.sigma is None:
        return V
    sigma = jnp.asarray(sample.sigma)
    own = jnp.sqrt(jnp.sum(V * V, axis=1))
    noisy = own > 0
    unit = jnp.where(noisy[:, None], V / jnp.where(noisy, own, 1.0)[:, None], jnp.eye(len(own)))
    return jnp.where(jnp.isnan(sigma)[:, None], V, unit * jnp.where(jnp.isnan(sigma), 0.0, sigma)[:, None])
