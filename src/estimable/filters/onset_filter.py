"""A filter that assumes no recent jump of a gain, with the response of its innovations to a jump at each onset."""

from typing import Any

import jax
import jax.numpy as jnp

from ..annotations import Array
from ..frozen import frozen, replace
from ..kernels import jumps, onset_grid
from ..kernels.small import factor, product, triangularise
from ..protocols import JumpingGains
from ..results import Info, Interval, Sample
from .belief import Belief


@frozen
class OnsetFilter:
    """A filter that assumes no recent jump, and the effect of each possible jump on it.

    Of a jump of 1 of gain j at onset r: `response` (n + p, p, r), of the mean. `score` (p, r) and `information` (p, p, r): of its
    size. `drift_response`, between `correct` and `predict` of a model with cross noise: that of the drift.
    """

    belief: Belief
    response: Any
    score: Any
    information: Any
    drift_response: Any = None


def learn(
    algorithm: JumpingGains[Belief], track: OnsetFilter, sample: Sample
) -> tuple[OnsetFilter, Info, Array, Array]:
    """The track after a sample, the report of its filter, and the responses of the white innovations, and these innovations."""
    belief, info = algorithm.correct(track.belief, sample)
    J, J_drift, E, white = _sensitivities(algorithm, track.belief, sample)
    G = jumps.whitened(track.response, E)
    score, information = jumps.learn(track.score, track.information, G, white)
    moved = OnsetFilter(
        belief, _of_each(J, track.response), score, information,
        drift_response=None if J_drift is None else _of_each(J_drift, track.response),
    )  # fmt: skip
    return moved, info, G, white


def _of_each(J: Array, response: Array) -> Array:
    """J times the response to each jump."""
    return product(J, response.reshape(response.shape[0], -1)).reshape(J.shape[0], *response.shape[1:])


def _sensitivities(algorithm: JumpingGains[Belief], belief: Belief, sample: Sample):
    """Derivatives with respect to the predicted mean: of the updated mean, of the drift, and of the whitened innovations;
    and these innovations."""

    def after(mean: Array):
        moved, post = algorithm.condition(replace(belief, mean=mean), sample, belief)
        informed = ~jnp.isnan(post.error)
        white = jnp.where(informed, post.error, 0.0) / jnp.sqrt(jnp.where(informed, post.variance, 1.0))
        return (moved.mean, moved.drift_mean, white), white

    (J, J_drift, E), white = jax.jacfwd(after, has_aux=True)(belief.mean)
    return J, J_drift, E, white


def moved(
    algorithm: JumpingGains[Belief], track: OnsetFilter, interval: Interval, move: onset_grid.Move
) -> OnsetFilter:
    """The track at the next sample."""

    def after(mean: Array, drift_mean: Array):
        return algorithm.predict(replace(track.belief, mean=mean, drift_mean=drift_mean), interval).mean

    belief, (n, p, _) = track.belief, track.response.shape
    response = _of_each(jax.jacfwd(after)(belief.mean, belief.drift_mean), track.response)
    if track.drift_response is not None:
        response = response + _of_each(jax.jacfwd(after, 1)(belief.mean, belief.drift_mean), track.drift_response)
    return OnsetFilter(
        algorithm.predict(belief, interval),
        onset_grid.moved(response, jnp.eye(n)[:, n - p :], move),
        onset_grid.moved(track.score, jnp.zeros(p), move),
        onset_grid.moved(track.information, jnp.zeros((p, p)), move),
    )


def averaged(track: OnsetFilter, jump: jumps.JumpMoments) -> OnsetFilter:
    """The belief averaged over the jumps, with the covariance of that mixture."""
    belief, n = track.belief, track.belief.mean.shape[0]
    if belief.drift_mean is None:
        response, Z = track.response, belief.factor
    else:
        response = jnp.concatenate([track.response, track.drift_response])
        Z = jnp.concatenate([belief.factor, belief.drift_factor])
    shift, spread = jumps.mixture(response, jump)
    L = triangularise(Z, factor(spread))
    Z = jnp.concatenate([L, jnp.zeros((len(L), Z.shape[1] - len(L)))], axis=1)
    belief = replace(belief, mean=belief.mean + shift[:n], factor=Z[:n])
    if belief.drift_mean is not None:
        belief = replace(belief, drift_mean=belief.drift_mean + shift[n:], drift_factor=Z[n:])
    return replace(track, belief=belief, score=0 * track.score, information=0 * track.information)


def with_room(track: OnsetFilter) -> OnsetFilter:
    """The track with columns of zeros where the factor of state and drift together needs more of them."""
    belief = track.belief
    if belief.drift_mean is None:
        return track
    room = jnp.zeros((len(belief.mean), 2 * len(belief.mean)))
    factors = {name: jnp.concatenate([getattr(belief, name), room], axis=1) for name in ("factor", "drift_factor")}
    return replace(track, belief=replace(belief, **factors))
