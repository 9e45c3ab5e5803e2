"""The update of a filter that takes some of its states into account without estimating them.

The rows of the filter gain of the considered states φ are zero. In the array form of `kalman`, whose columns are unit variables,
that leaves the rows of φ as they were: with them, Z Z' is Joseph's form of the covariance for that gain.

Reference: S. F. Schmidt, Advances in Control Systems 3 (1966) 293-340; G. J. Bierman, Factorization Methods (1977), ch. VIII.
"""

import jax.numpy as jnp

from . import kalman
from .kalman import Gaussian, Measurement, Posterior
from .shapes import Bool, Float
from .small import Real


def correct(
    prior: Gaussian, measurement: Measurement, y: Float[Real, " p"], seen: Bool[Real, " p"], rows: slice
) -> Posterior:
    """Condition the belief on the entries of y that were seen; the states in `rows` are considered."""
    post = kalman.correct(prior, measurement, y, seen)
    return post._replace(state=unmoved(post.state, prior, rows))


def unmoved(post: Gaussian, prior: Gaussian, rows: slice) -> Gaussian:
    """The posterior with the rows of the prior for the considered states; the first columns of both Z are the same variables."""
    before = jnp.concatenate([prior.Z, jnp.zeros((len(prior.m), post.Z.shape[1] - prior.Z.shape[1]))], axis=1)
    own = jnp.arange(len(prior.m))
    considered = (own >= rows.start) & (own < rows.stop)
    return post._replace(
        m=jnp.where(considered, prior.m, post.m),
        Z=jnp.where(considered[:, None], before, post.Z),
        X=jnp.where(considered[:, None], prior.X, post.X),
    )
