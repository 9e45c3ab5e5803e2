"""An algorithm whose state restarts where a record breaks: gains, parameters and unknown inputs go on."""

from typing import Any, Self

import jax
import jax.numpy as jnp

from .. import checks
from ..annotations import Array, Tree
from ..frozen import frozen, replace
from ..kernels.joint_gain import block_diagonal
from ..kernels.kalman import Transition
from ..kernels.small import triangularise
from ..kernels.smoothing import Instant
from ..models.prior import Prior, diffuse_columns
from ..protocols import Wrapper
from ..results import Interval, Sample
from .belief import Belief
from .mixture import Mixture


@frozen
class Restarting(Wrapper[Any]):
    """A wrapper around a sampled algorithm: at an interval with `restart`, x at its end is drawn from `fresh`, independently.

    `fresh`: the belief about x, as a deviation from the operating point. The other quantities move as over any interval.
    """

    algorithm: Any
    fresh: Belief

    def at(self, k: int | Array) -> Self:
        """The same wrapper around the algorithm at row k."""
        return replace(self, algorithm=self.algorithm.at(k))

    def init(self, prior: Prior) -> Any:
        """The state before y[0], with room for the diffuse directions of a restart."""
        missing = self.fresh.diffuse.shape[1] - diffuse_columns(prior).shape[1]
        if missing > 0:
            room = jnp.zeros((prior.mean.shape[0], missing))
            prior = replace(prior, diffuse=jnp.concatenate([diffuse_columns(prior), room], axis=1))
        return self.algorithm.init(prior)

    def predict(self, state: Tree, interval: Interval) -> Any:
        """Move to the next sample, or restart there."""
        moved = self.algorithm.predict(state, replace(interval, restart=None))
        fresh = self.algorithm.restarted(moved, lambda tree: restarted(tree, self.fresh))
        return jax.tree_util.tree_map(lambda a, b: jnp.where(interval.restart, a, b), fresh, moved)

    def instant(self, sample: Sample, interval: Interval) -> Instant:
        """The model of this row, for the smoother."""
        return self._broken(self.algorithm.instant(sample, replace(interval, restart=None)), interval)

    def instant_about(self, sample: Sample, interval: Interval, predicted: Belief, filtered: Belief) -> Instant:
        """The model of this row, linearised, for the smoother."""
        inside = replace(interval, restart=None)
        return self._broken(self.algorithm.instant_about(sample, inside, predicted, filtered), interval)

    def tell(self, state: Belief) -> Any:
        """The report of a smoothed belief, which ends with the diffuse directions of a restart."""
        size = state.mean.shape[0] - self.fresh.diffuse.shape[1]
        cut = {name: getattr(state, name)[:size] for name in ("mean", "factor", "diffuse", "size")}
        return self.algorithm.tell(replace(state, **cut))

    def _broken(self, instant: Instant, interval: Interval) -> Instant:
        """x+ drawn from `fresh` where the record breaks: its diffuse directions are an unknown input."""
        (F, c, W), fresh, n = instant.transition, self.fresh, self.fresh.mean.shape[0]
        size, r = len(F), fresh.diffuse.shape[1]
        state = jnp.arange(size) < n

        def rows(M: Array) -> Array:
            return jnp.concatenate([M, jnp.zeros((size - n, M.shape[1]))])

        broken = interval.restart & state
        F = jnp.where(broken[:, None], 0.0, F)
        c = jnp.where(broken, jnp.concatenate([fresh.mean, jnp.zeros(size - n)]), c)
        W = jnp.concatenate(
            [jnp.where(broken[:, None], 0.0, W), jnp.where(interval.restart, rows(fresh.factor), 0.0)], axis=1
        )
        E = instant.E
        if r:
            E = jnp.where(interval.restart, rows(fresh.diffuse), 0.0)
            if instant.E is not None:
                E = jnp.concatenate([jnp.where(broken[:, None], 0.0, instant.E), E], axis=1)
        return instant._replace(transition=Transition(F, c, W), E=E)


def restarting(algorithm: Any, fresh: Belief | tuple[Belief, ...]) -> Any:
    """A sampled algorithm that restarts. `fresh` is a tuple for a `Mixture`: each of its algorithms restarts by itself."""
    if not isinstance(fresh, tuple):
        return Restarting(algorithm, fresh)
    if isinstance(algorithm, Mixture):
        members = zip(algorithm.algorithms, fresh, strict=True)
        return replace(algorithm, algorithms=tuple(Restarting(one, anew) for one, anew in members))
    return replace(algorithm, algorithm=restarting(algorithm.algorithm, fresh))


def restarted(tree: Tree, fresh: Belief) -> Any:
    """Each belief of a state with x from `fresh`; the state may hold several side by side."""

    def of_one(b: Belief) -> Belief:
        if b.mean.ndim == 2:
            return jax.vmap(lambda one: _joint(one, fresh))(b)
        return _joint(b, fresh)

    def is_belief(node: Tree) -> bool:
        return isinstance(node, Belief)

    leaves, structure = jax.tree_util.tree_flatten(tree, is_leaf=is_belief)
    if not any(map(is_belief, leaves)):
        checks.refuse('this algorithm cannot restart at a break: use gaps = "bridge", or run the parts one by one.')
    return jax.tree_util.tree_unflatten(structure, [of_one(leaf) if is_belief(leaf) else leaf for leaf in leaves])


def _joint(moved: Belief, fresh: Belief) -> Belief:
    """x from `fresh`, and independently of it the other quantities of a belief."""
    n, size, (k, r) = fresh.mean.shape[0], moved.mean.shape[0], (moved.factor.shape[1], moved.diffuse.shape[1])
    diffuse, rest = fresh.diffuse, moved.diffuse[n:] * jnp.exp(moved.log_scale)
    room = r - diffuse.shape[1]
    if size > n and room < size - n and room > 0:
        checks.refuse('some gains are diffuse, and others are not, where the record breaks: use gaps = "bridge".')
    rest = triangularise(rest) if room and size > n else jnp.zeros((size - n, max(room, 0)))
    if rest.shape[1] < room:
        rest = jnp.concatenate([rest, jnp.zeros((size - n, room - rest.shape[1]))], axis=1)
    factor = block_diagonal(fresh.factor, triangularise(moved.factor[n:]) if size > n else jnp.zeros((0, 0)))
    factor = jnp.concatenate([factor, jnp.zeros((size, k - factor.shape[1]))], axis=1)
    mean, sizes = (jnp.concatenate([getattr(fresh, name), getattr(moved, name)[n:]]) for name in ("mean", "size"))
    diffuse, scale = block_diagonal(diffuse, rest)[:, :r], 0.0 * moved.log_scale
    return replace(moved, mean=mean, factor=factor, size=sizes, diffuse=diffuse, log_scale=scale)
