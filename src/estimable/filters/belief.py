"""The state of the linear Gaussian filters, and its two steps."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from ..annotations import Array
from ..frozen import frozen
from ..kernels import independent, kalman, smoothing
from ..kernels.joint_gain import block_diagonal
from ..kernels.small import factor, gram, settled
from ..models.prior import Prior, diffuse_columns
from ..models.sampled import SampledModel
from ..results import Sample


@frozen
class Belief:
    """Mean (n,), a factor of the covariance (n, k), and a basis (n, r) of what nothing is known of.

    `size` (n,) is that of the terms whose sum the mean is, and tells its rounding; the basis is in truth `diffuse`
    exp(`log_scale`). After `correct` of a model with cross noise, `drift_mean` and `drift_factor` are those of the process
    noise, of which the outputs have told something. `before` (n, n) is the factor before `correct`.
    """

    mean: Any
    factor: Any
    diffuse: Any
    size: Any
    log_scale: Any
    drift_mean: Any = None
    drift_factor: Any = None
    before: Any = None

    @property
    def covariance(self):
        """The finite part of the covariance, (n, n)."""
        return gram(self.factor)


def believe(prior: Prior, origin: Array | float = 0.0) -> Belief:
    """The belief that a prior states, about deviations from `origin`."""
    mean = jnp.asarray(prior.mean)
    size = jnp.abs(mean) + jnp.abs(origin)
    return Belief(mean - origin, factor(prior.covariance), diffuse_columns(prior), size, jnp.zeros(()))


def side_by_side(a: Belief, b: Belief) -> Belief:
    """The belief about (x, θ) of two independent ones."""
    return Belief(
        jnp.concatenate([a.mean, b.mean]),
        block_diagonal(a.factor, b.factor),
        block_diagonal(a.diffuse, b.diffuse),
        jnp.concatenate([a.size, b.size]),
        jnp.zeros(()),
    )


def correct(
    belief: Belief, model: SampledModel, C: Array, d: Array, Ω: Array | None, sample: Sample
) -> tuple[Belief, kalman.Posterior]:
    """Condition on what was seen of y = C x + d + v; Ω is the part of the process noise that v tells of, or None."""
    if belief.drift_mean is not None:
        raise ValueError("correct was called twice without predict: the cross noise S of a sample can be used once.")
    b, post = belief, posterior(belief, C, d, model.V, Ω, sample, independently=model.independent)
    before = b.factor if b.before is None else b.before
    return Belief(post.m, post.Z, post.X, b.size, b.log_scale, post.drift, post.Z_drift, before), post


def posterior(
    b: Belief, C: Array, d: Array, V: Array, Ω: Array | None, sample: Sample, *, independently: bool
) -> kalman.Posterior:
    """The belief b conditioned on what was seen; `independently`: V is known to be diagonal, and Ω is None."""
    if independently and b.diffuse.shape[1] == 0:
        i = np.arange(C.shape[0])
        return independent.correct(b.mean, b.factor, C, d, V[i, i], sample.y, sample.seen, b.size)
    return kalman.correct(b.mean, b.factor, b.diffuse, C, d, V, Ω, sample.y, sample.seen, b.size, b.log_scale)


def predict(belief: Belief, F: Array, c: Array, W: Array, Ω: Array | None) -> Belief:
    """Move to the next instant; Ω (or None) counts where no `correct` has brought it into the belief."""
    if Ω is not None and belief.drift_mean is None:
        W = jnp.concatenate([Ω, W], axis=1)
    b = belief
    moved = kalman.predict(b.mean, b.factor, b.diffuse, b.drift_mean, b.drift_factor, F, c, W, b.size, b.log_scale)
    if b.before is None or b.before.shape != moved.Z.shape:
        return Belief(*moved)
    return Belief(*moved._replace(Z=settled(moved.Z, b.before)))


def smoothed(predicted: Belief, said: smoothing.Evidence) -> Belief:
    """The belief about (x, δ) from what was `predicted` of x and what this and later samples have `said` of both."""
    unknown = said.H.shape[1] - predicted.mean.shape[0]
    n, zeros = said.H.shape[0], jnp.zeros(unknown)
    flat = Belief(zeros, jnp.zeros((unknown, unknown)), jnp.eye(unknown), zeros, jnp.zeros(()))
    b = side_by_side(predicted, flat) if unknown else predicted
    seen = jnp.max(jnp.abs(said.H), axis=1) > 0
    post = kalman.correct(
        b.mean, b.factor, b.diffuse, said.H, jnp.zeros(n), said.V, None, said.z, seen, b.size, predicted.log_scale
    )
    return Belief(post.m, post.Z, post.X, b.size, predicted.log_scale)
