"""Outputs that arrive late: an estimator that goes back to the sample of a late packet and runs again from there."""

from typing import Any, Self

import jax
import jax.numpy as jnp

from ..annotations import Array
from ..frozen import frozen, replace, static
from ..models.prior import Prior
from ..networks.links import DelayLink
from ..networks.trace import Trace
from ..protocols import Link, Wrapper
from ..results import Info, Interval, Sample


def longest_delay(link: Link | None) -> int:
    """The longest delay, in steps, of a packet that is used; 0 where late packets are dropped."""
    if isinstance(link, DelayLink) and link.late == "use":
        return len(link.delays) - 1
    return link.longest if isinstance(link, Trace) else 0


@frozen
class Awaited:
    """The belief before the oldest sample that may still arrive; the last L samples and intervals, the newest first, and how
    many of them there are; the present sample."""

    belief: Any
    samples: Any
    delays: Any
    intervals: Any
    count: Any
    now: Any


@frozen
class Reordered(Wrapper[Awaited]):
    """A wrapper that estimates from all outputs that have arrived, each at the sample at which it was measured.

    `Sample.extra` (p,): the delays of the outputs in steps. An output with a delay above `longest` is never used. At each
    sample the last `longest` samples are filtered again with what has arrived of them. Cost: 1 + `longest` times that of the
    algorithm.
    """

    algorithm: Any
    longest: int = static()
    inputs: int = static()
    outputs: int = static()

    def init(self, prior: Prior) -> Awaited:
        """No sample yet."""
        L, m, p = self.longest, self.inputs, self.outputs
        blank = jnp.zeros((L, m))
        return Awaited(
            self.algorithm.init(prior), Sample(jnp.zeros((L, p)), jnp.zeros((L, p), bool), blank), jnp.zeros((L, p)),
            Interval(blank, blank, None, jnp.zeros(L)), jnp.zeros(()),
            (Sample(jnp.zeros(p), jnp.zeros(p, bool), jnp.zeros(m)), jnp.zeros(p)),
        )  # fmt: skip

    def correct(self, state: Awaited, sample: Sample) -> tuple[Awaited, Info]:
        """Filter the last samples again, then this one."""
        belief, oldest = state.belief, state.belief
        for age in range(self.longest, 0, -1):
            past, interval = (
                jax.tree_util.tree_map(lambda leaf, i=age - 1: leaf[i], part)
                for part in (state.samples, state.intervals)
            )
            come = past.seen & (state.delays[age - 1] <= age)
            corrected, _ = self.algorithm.correct(belief, replace(past, y=jnp.where(come, past.y, 0.0), seen=come))
            moved = self.algorithm.predict(corrected, interval)
            exists = state.count >= age
            belief = jax.tree_util.tree_map(lambda new, old, exists=exists: jnp.where(exists, new, old), moved, belief)
            oldest = belief if age == self.longest else oldest
        delay, sample = sample.extra, replace(sample, extra=None)
        come = sample.seen & (delay == 0)
        _, info = self.algorithm.correct(belief, replace(sample, y=jnp.where(come, sample.y, 0.0), seen=come))
        return replace(state, belief=oldest, now=(sample, delay)), info

    def predict(self, state: Awaited, interval: Interval) -> Awaited:
        """Put the sample and its interval first among the last ones."""
        sample, delay = state.now
        count = jnp.minimum(state.count + 1, float(self.longest))
        samples, delays, intervals = (
            jax.tree_util.tree_map(_pushed, new, old)
            for new, old in ((sample, state.samples), (delay, state.delays), (interval, state.intervals))
        )
        return replace(state, samples=samples, delays=delays, intervals=intervals, count=count)

    def at(self, k: int | Array) -> Self:
        """The same: the algorithm is constant."""
        return self


def _pushed(new: Array, old: Array) -> Any:
    return jnp.concatenate([jnp.asarray(new)[None], old[:-1]])
