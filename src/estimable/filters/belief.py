"""The state of the linear Gaussian filters, and its two steps."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jax.lax import stop_gradient

from ..annotations import Array
from ..frozen import frozen, replace
from ..kernels import all_outputs, independent, kalman, schmidt
from ..kernels.joint_gain import block_diagonal
from ..kernels.kalman import Drift, Gaussian, Measurement, Posterior, Transition
from ..kernels.later_information import Later, unit_noise
from ..kernels.small import factor, gram, settled
from ..kernels.smoothing import Evidence
from ..models.markov_disturbance import with_disturbances
from ..models.prior import Prior, diffuse_columns
from ..results import Sample


@frozen
class Belief:
    """Mean (n,), a factor (n, k) of the finite part of the covariance, and the directions (n, r) of infinite variance.

    `size` (n,) is the size of the terms that sum to the mean: it bounds the rounding of the mean. The directions are
    `diffuse` exp(`log_scale`). After `correct` of a model with cross noise, `drift_mean` and `drift_factor` are those of the
    process noise given the outputs. `before` (n, n) is the factor before `correct`.
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

    @property
    def gaussian(self) -> Gaussian:
        """The belief about the state, for the kernels."""
        return Gaussian(self.mean, self.factor, self.diffuse, self.size, self.log_scale)

    @property
    def drift(self) -> Drift | None:
        """The belief about the process noise, for the kernels; None where the outputs carried no information about it."""
        return None if self.drift_mean is None else Drift(self.drift_mean, self.drift_factor)


def believe(prior: Prior, origin: Array | float = 0.0, added: Array | None = None) -> Belief:
    """The belief of a prior, about deviations from `origin`. `added`: the variances of disturbances that it may leave out."""
    if added is not None:
        prior = with_disturbances(prior, added, np.shape(origin)[-1])
    mean = jnp.asarray(prior.mean)
    size = stop_gradient(jnp.abs(mean) + jnp.abs(origin))
    return Belief(mean - origin, factor(prior.covariance), diffuse_columns(prior), size, jnp.zeros(()))


def side_by_side(a: Belief, b: Belief) -> Belief:
    """The joint belief about (x, θ) from two independent beliefs."""
    return Belief(
        jnp.concatenate([a.mean, b.mean]),
        block_diagonal(a.factor, b.factor),
        block_diagonal(a.diffuse, b.diffuse),
        jnp.concatenate([a.size, b.size]),
        jnp.zeros(()),
    )


def correct(
    belief: Belief, measurement: Measurement, sample: Sample, *, independently: bool, considered: slice | None = None
) -> tuple[Belief, Posterior]:
    """Condition on the seen outputs; `independently` and `considered` as in `posterior`."""
    if belief.drift is not None:
        raise ValueError(
            "correct was called twice without predict: the cross noise S of a sample can be used only once."
        )
    post = posterior(belief, measurement, sample, independently=independently, considered=considered)
    before = belief.factor if belief.before is None else belief.before
    return Belief(*post.state, *(post.drift or (None, None)), before), post


def posterior(
    belief: Belief, measurement: Measurement, sample: Sample, *, independently: bool, considered: slice | None = None
) -> Posterior:
    """The belief given the seen outputs; `independently`: V is known to be diagonal, and Ω is None. `considered`: the states that
    are not estimated.
    """
    if considered is not None:
        return schmidt.correct(belief.gaussian, measurement, sample.y, sample.seen, considered)
    update = kalman.correct
    if independently and belief.diffuse.shape[1] == 0:
        p, n = measurement.C.shape
        update = (all_outputs if all_outputs.is_faster(n, p) else independent).correct
    return update(belief.gaussian, measurement, sample.y, sample.seen)


def predict(belief: Belief, transition: Transition, Ω: Array | None) -> Belief:
    """Move to the next instant; the cross noise Ω (or None) is process noise where no `correct` has used it."""
    if Ω is not None and belief.drift is None:
        transition = transition._replace(W=jnp.concatenate([Ω, transition.W], axis=1))
    state = kalman.predict(belief.gaussian, transition, belief.drift)
    if belief.before is None or belief.before.shape != state.Z.shape:
        return Belief(*state)
    return Belief(*state._replace(Z=settled(state.Z, belief.before)))


def smoothed(predicted: Belief, later: Evidence | Later) -> Belief:
    """The belief about (x, δ) from the `predicted` belief about x and the data about both from this and later samples."""
    if isinstance(later, Evidence):
        return _smoothed(predicted, later)
    about_m = replace(predicted, mean=predicted.mean - later.m)
    every = jnp.ones(len(later.ζ), bool)
    state = posterior(about_m, unit_noise(later), Sample(later.ζ, every, None), independently=True).state
    return Belief(*state._replace(m=later.m + state.m))


def _smoothed(predicted: Belief, evidence: Evidence) -> Belief:
    unknown = evidence.H.shape[1] - predicted.mean.shape[0]
    n, zeros = evidence.H.shape[0], jnp.zeros(unknown)
    flat = Belief(zeros, jnp.zeros((unknown, unknown)), jnp.eye(unknown), zeros, jnp.zeros(()))
    b = side_by_side(predicted, flat) if unknown else predicted
    seen = jnp.max(jnp.abs(evidence.H), axis=1) > 0
    prior = b.gaussian._replace(log_scale=predicted.log_scale)
    return Belief(*kalman.correct(prior, Measurement(evidence.H, jnp.zeros(n), evidence.V), evidence.z, seen).state)
