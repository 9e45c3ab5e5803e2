"""Full windows of a linear Gaussian filter over whole records, at a cost independent of their length.

A record is cut into blocks as long as a window. A window is then the end of a block and the beginning of the next: a backward
pass gathers the ends, a forward pass the beginnings, and both together are one window (`kernels.stretch`).
"""

from typing import Any, Self

import jax
import jax.numpy as jnp
import numpy as np

from ..annotations import Array, Tree
from ..engines import choice
from ..filters.belief import Belief
from ..filters.kalman_filter import Kalman
from ..filters.unknown_gain import UnknownGain
from ..frozen import frozen, replace
from ..kernels import stretch
from ..models.prior import Prior
from ..protocols import Algorithm
from ..results import Info, Interval, Sample
from .binding import select as keep_of

MOST = 3  # states and gains, or outputs: above this, compilation takes longer than it saves on a record or two
AT_ONCE = 128  # runs whose beliefs between the passes fit in the processor's cache


def fits(algorithm: Algorithm[Any]) -> bool:
    """Whether stretches describe the filter: linear and constant, every output with its own nonzero noise and no angle, no
    forgetting."""
    if not isinstance(algorithm, Kalman | UnknownGain) or np.any(algorithm.forgetting != 1.0):
        return False
    ready: Any = algorithm.ready
    noises = np.diagonal(np.asarray(ready.V), axis1=-2, axis2=-1)
    return (
        ready.independent
        and not ready.varying
        and ready.period is None
        and bool((noises > 0).all())
        and max(_sizes(algorithm)[1:]) <= MOST
    )


def _sizes(algorithm: Kalman | UnknownGain) -> tuple[int, int, int]:
    """The numbers of states, of states and gains, and of outputs."""
    gains = len(algorithm.gain.mean.T) if isinstance(algorithm, UnknownGain) else 0
    ready: Any = algorithm.ready
    p, n = np.shape(ready.C)[-2:]
    return n, n + gains, p


def scan_bank(
    engine: str,
    algorithm: Algorithm[Any],
    length: int,
    prior: Prior,
    samples: Sample,
    intervals: Interval,
    *,
    axes: tuple,
    keep: str,
) -> tuple[str, Info, np.ndarray]:
    """The engine that ran; the info of every full window, by its last row; and the windows that must be run one by one.

    `keep` is "all" or "means". A window must be run where a direction remains undetermined, or where it fails.
    """
    T = samples.seen.shape[1]
    place = np.broadcast_to(
        (np.arange(T) + 2) % length - 1, samples.seen.shape[:2]
    )  # a block begins at the first full row
    rows = WindowRow(samples, intervals, place)
    turned = jax.tree_util.tree_map(lambda leaf: leaf[:, ::-1], rows)
    _, run = choice.scan_bank(
        engine, _Ends(algorithm), prior, turned, turned.interval, axes=axes, keep="all", select=_belief
    )
    begin = jax.tree_util.tree_map(lambda leaf: leaf[:, ::-1][:, : T - length + 1], run.info)
    rows = replace(jax.tree_util.tree_map(lambda leaf: leaf[:, length - 1 :], rows), begin=begin)
    engine, run = choice.scan_bank(
        engine, _Beginnings(algorithm), prior, rows, rows.interval, axes=axes, keep=keep, select=_reported
    )
    info, again = run.info
    return engine, info, np.asarray(again)


@frozen
class WindowRow:
    """A row for both passes: `place` in its block (-1: the last), and the belief `begin` at the start of the block."""

    sample: Sample
    interval: Interval
    place: Any
    begin: Any = None

    @property
    def seen(self):
        """The mask of seen outputs; its length is the number of rows."""
        return self.sample.seen


@frozen
class PassInfo:
    """The report of a pass on a row, for an engine."""

    kept: Any
    again: Any
    outcome: Any
    log_likelihood: Any = None


def _belief(info: PassInfo, keep: str) -> Belief:
    return short(info.kept)


def short(belief: Belief) -> Belief:
    """The part of a belief that the second pass needs: outputs have noise, and the scale of diffuse directions is not used."""
    return replace(belief, size=None, log_scale=None)


def _reported(info: PassInfo, keep: str) -> tuple[Info, Any]:
    return keep_of(info.kept, keep), info.again


def step_of(algorithm: Kalman | UnknownGain, row: WindowRow) -> stretch.Stretch:
    """This sample, and the step to the next."""
    instant, sample = algorithm.instant(row.sample, row.interval), row.sample
    return stretch.of_sample(instant.transition, instant.measurement, sample.y, sample.seen)


def or_empty(blank: Array, gathered: stretch.Stretch) -> stretch.Stretch:
    """The gathered stretch, or an empty one at a blank."""
    return either(blank, stretch.empty(gathered.b.shape[0]), gathered)


def through(belief: Belief, gathered: stretch.Stretch) -> Belief:
    """The belief after a stretch."""
    return Belief(*stretch.through(belief.gaussian, gathered))


def either(first: Array, a: Tree, b: Tree) -> Any:
    """a or b, leaf by leaf."""
    return jax.tree_util.tree_map(lambda x, y: jnp.where(first, x, y), a, b)


def learn(
    algorithm: Kalman | UnknownGain, begin: Belief, gathered: stretch.Stretch, sample: Sample
) -> tuple[Info, Any]:
    """The report of the filter after the gathered stretch, from a block's `begin`; and whether the window must be run instead."""
    begin = replace(begin, factor=jnp.tril(begin.factor), size=jnp.abs(begin.mean), log_scale=jnp.zeros(()))
    before = through(begin, gathered)
    _, info = algorithm.correct(replace(before, diffuse=before.diffuse[:, :0]), sample)
    if before.diffuse.shape[1]:
        info = _nothing_open(info)
    return info, jnp.any(before.diffuse != 0) | (info.outcome != 0)


def _nothing_open(info: Info) -> Info:
    """The report of a filter that could have diffuse directions, where there are none."""
    extra = dict(info.extra or {})
    if info.gain is not None:
        extra["gain_diffuse_covariance"] = jnp.zeros(info.gain_covariance.shape)
    return replace(info, diffuse_covariance=jnp.zeros(info.covariance.shape), extra=extra or info.extra)


@frozen
class Backwards:
    """A pass from the last row to the first."""

    algorithm: Any

    def at(self, k: int | Array) -> Self:
        """The same: the model does not vary."""
        return self

    def init(self, prior: Prior) -> tuple[Belief, stretch.Stretch]:
        """The initial belief of a window, and the stretch from the last row on."""
        fresh = self.algorithm.init(prior)
        return fresh, stretch.empty(fresh.mean.shape[0])


@frozen
class _Ends(Backwards):
    """Backwards: the belief at the start of the next block, for the window that begins at each row."""

    def correct(self, state: tuple, sample: WindowRow) -> tuple[tuple, PassInfo]:
        """Put a row before the gathered ones; a window equal to a block has no rows before it."""
        fresh, gathered = state
        gathered = stretch.joined(step_of(self.algorithm, sample), or_empty(sample.place == -1, gathered))
        begin = either(sample.place == 0, fresh, through(fresh, gathered))
        return (fresh, gathered), PassInfo(begin, False, 0)

    def predict(self, state: tuple, interval: Interval) -> tuple:
        """No change."""
        return state


@frozen
class _Beginnings:
    """Forwards: the report of the filter at the end of each window."""

    algorithm: Any

    def at(self, k: int | Array) -> "_Beginnings":
        """The same: the model does not vary."""
        return self

    def init(self, prior: Prior) -> stretch.Stretch:
        """An empty stretch."""
        return stretch.empty(self.algorithm.init(prior).mean.shape[0])

    def correct(self, state: stretch.Stretch, sample: WindowRow) -> tuple[stretch.Stretch, PassInfo]:
        """Apply the gathered part of the block, and update with the last sample like the filter."""
        gathered = or_empty(sample.place == 0, state)
        info, again = learn(self.algorithm, sample.begin, gathered, sample.sample)
        return stretch.joined(gathered, step_of(self.algorithm, sample)), PassInfo(info, again, 0)

    def predict(self, state: stretch.Stretch, interval: Interval) -> stretch.Stretch:
        """No change: the stretch has already moved."""
        return state
