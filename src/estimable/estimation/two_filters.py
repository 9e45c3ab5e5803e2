# pyright: reportUnknownArgumentType=false, reportUnknownLambdaType=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false
"""The two passes of a smoother as steps for an engine: a filter forwards, and the information in later samples backwards."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from .. import forks
from ..annotations import Array
from ..engines import choice
from ..engines.xla import Run
from ..filters.belief import Belief, smoothed
from ..filters.linearised import Linearised
from ..filters.unknown_gain import UnknownGain
from ..frozen import frozen, replace, static
from ..kernels import later_information, smoothing
from ..kernels.later_information import Later
from ..kernels.small import apply, held, triangularise
from ..kernels.smoothing import Evidence, Instant
from ..kernels.wrapping import nearest
from ..models.prior import Prior
from ..protocols import Algorithm, Smoothable
from ..results import Info, Interval, Sample, outcome_code
from .binding import Bound

AT_ONCE = 1_000  # rows of a fixed lag computed side by side: a few megabytes
UNEVEN = -1  # the outcome of a row whose outputs need elimination


@frozen
class SmootherRows:
    """The rows of a pass. `instant`: that of a nonlinear model, linearised; None where the algorithm gives it. `about`: the
    states to linearise about."""

    sample: Sample
    interval: Interval
    predicted: Any = None
    instant: Any = None
    about: Any = None

    @property
    def seen(self):
        """The mask of seen outputs; its length is the number of rows."""
        return self.sample.seen


class Passed(NamedTuple):
    """What the backward pass needs of a row."""

    predicted: Belief
    instant: Instant | None


@frozen
class PassedRow:
    """The report of the forward pass on a row, for an engine."""

    passed: Passed
    log_likelihood: Any
    outcome: Any


@frozen
class Forward:
    """An algorithm that stores its prediction for each row, and the row's linearisation where its model is nonlinear."""

    algorithm: Any
    linearised: bool = static()

    def at(self, k: int | Array) -> "Forward":
        """The algorithm at row k."""
        return replace(self, algorithm=self.algorithm.at(k))

    def init(self, prior: Prior) -> Belief:
        """The belief before y[0]."""
        return self.algorithm.init(prior)

    def correct(self, state: Belief, row: SmootherRows) -> tuple[Belief, PassedRow]:
        """Update with one sample, and report the belief before it."""
        after, info = self.algorithm.correct(state, row.sample)
        instant = None
        if self.linearised:
            instant = _compact(self.algorithm.instant_about(row.sample, row.interval, state, after))
        return after, PassedRow(Passed(state, instant), info.log_likelihood, info.outcome)

    def predict(self, state: Belief, interval: Interval) -> Belief:
        """Move to the next sample."""
        return self.algorithm.predict(state, interval)


def _compact(instant: Instant) -> Instant:
    """The same row with no more columns of process noise than states."""
    F, _, W = instant.transition
    return (
        instant._replace(transition=instant.transition._replace(W=triangularise(W))) if W.shape[1] > len(F) else instant
    )


def select_passed(row: PassedRow, keep: str) -> Passed:
    """The selected part of a report."""
    return row.passed


class Smoothing(NamedTuple):
    """Both passes: the engine of the second, the info of every row, the first failure and its row."""

    engine: str
    info: Info
    code: int
    at: int


def forwards(bound: Bound, prior: Prior, engine: str) -> tuple[str, SmootherRows, Run]:
    """The engine that ran, the rows for the backward pass, and the forward run."""
    rows = SmootherRows(bound.samples, bound.intervals)
    forward = Forward(bound.algorithm, by_belief(bound))
    engine, run = choice.scan(engine, forward, prior, rows, bound.intervals, keep="all", select=select_passed)
    return engine, replace(rows, predicted=run.info.predicted, instant=run.info.instant), run


def by_belief(bound: Bound) -> bool:
    """Whether the model of a row depends on the belief: of a nonlinear model, or of a gain where the input is unknown."""
    inner, interval = bound.algorithm.innermost, bound.intervals
    unknown = interval.u_diffusion is not None or interval.u_covariance is not None
    return isinstance(inner, Linearised) or (unknown and isinstance(inner, UnknownGain))


class Gathered(NamedTuple):
    """The information in later samples, and the factor of the prediction of the next row."""

    later: Evidence | Later
    factor: Any


@frozen
class Backward:
    """A step of the backward pass, for an engine. `by_elimination`: in any case; otherwise only where the model needs it."""

    algorithm: Any
    last: Any
    by_elimination: bool = static(default=False)

    def at(self, k: int | Array) -> "Backward":
        """The algorithm k rows before the last."""
        return replace(self, algorithm=self.algorithm.at(self.last - k))

    def init(self, row: SmootherRows) -> Gathered:
        """No information about the state after the last row."""
        instant = instant_of(self.algorithm.at(self.last), row)
        return Gathered(nothing(instant, row.predicted, self.by_elimination), jnp.zeros_like(row.predicted.factor))

    def correct(self, state: Gathered, row: SmootherRows) -> tuple[Gathered, Info]:
        """Add the information of one row, and report the row."""
        instant, factor = instant_of(self.algorithm, row), held(row.predicted.factor, state.factor)
        joint, even = gather(state.later, instant, row)
        info = tell(self.algorithm, replace(row.predicted, factor=factor), joint)
        after = Gathered(about_state(joint, instant), factor)
        return after, replace(info, outcome=jnp.where(even, info.outcome, UNEVEN))

    def predict(self, state: Gathered, interval: Interval) -> Gathered:
        """No change: `correct` has moved to this row."""
        return state


def instant_of(algorithm: Algorithm[Any], row: SmootherRows) -> Instant:
    """The linear model of a row."""
    smoothable: Any = algorithm
    return row.instant if row.instant is not None else smoothable.instant(row.sample, row.interval)


def nothing(instant: Instant, belief: Belief, by_elimination: bool) -> Evidence | Later:
    """No information, as data of unit noise where the model and the belief permit that."""
    n = belief.mean.shape[0]
    special = instant.E is not None or instant.measurement.Ω is not None or belief.diffuse.shape[1] > 0
    return smoothing.nothing(n) if by_elimination or special else later_information.no_later(n)


def gather(later: Evidence | Later, instant: Instant, row: SmootherRows) -> tuple[Evidence | Later, Any]:
    """The information about (x, δ) from this sample and later ones, and whether its form was suitable."""
    sample, m = row.sample, row.predicted.mean
    if isinstance(later, Later):
        return later_information.gathered(later, instant, sample.y, sample.seen, m)
    y, (C, d, _, _, period) = sample.y, instant.measurement
    if period is not None:
        foreseen = apply(C, m) + d
        y = foreseen + nearest(y - foreseen, period)
    return smoothing.earlier(later, instant, y, sample.seen), True


def about_state(joint: Evidence | Later, instant: Instant) -> Evidence | Later:
    """The information about x alone."""
    return joint if isinstance(joint, Later) else smoothing.about_state(joint, instant.transition.F.shape[0])


def tell(algorithm: Smoothable[Any] | Linearised, predicted: Belief, later: Evidence | Later) -> Info:
    """The report of a row: its prediction, corrected by the information in this and later samples."""
    belief = smoothed(predicted, later)
    return replace(algorithm.tell(belief), outcome=outcome_code(False, belief.mean, belief.factor, belief.diffuse))


def _whole(info: Info, keep: str) -> Info:
    return info


def backwards(bound: Bound, rows: SmootherRows, forward: Run, engine: str) -> Smoothing:
    """Fixed interval: the backward pass after a `forward` run."""
    last = len(rows.seen) - 1
    turned = jax.tree_util.tree_map(lambda leaf: leaf[::-1], rows)
    first = jax.tree_util.tree_map(lambda leaf: leaf[0], turned)
    engine_used, run = _either_form(choice.scan, engine, Backward(bound.algorithm, np.asarray(last)), first, turned)
    code, at = (forward.code, forward.failed_at) if forward.code else (run.code, last - run.failed_at)
    return Smoothing(engine_used, jax.tree_util.tree_map(lambda leaf: leaf[::-1], run.info), int(code), int(at))


def _either_form(
    scan: Callable[..., tuple[str, Run]],
    engine: str,
    backward: Backward,
    first: SmootherRows,
    turned: SmootherRows,
    **axes: tuple,
) -> tuple[str, Run]:
    """The engine that ran, and the backward pass: by elimination in any case only where a run fails otherwise."""
    run = scan(engine, backward, first, turned, turned.interval, keep="all", select=_whole, **axes)
    if np.any(run[1].code):
        backward = replace(backward, by_elimination=True)
        run = scan(engine, backward, first, turned, turned.interval, keep="all", select=_whole, **axes)
    return run


def of_bank(bound: Bound, priors: Prior, engine: str, axes: tuple) -> tuple[str, Run]:
    """Fixed interval of many runs: the engine, and the run with both passes. `axes` as in `choice.scan_bank`."""
    rows = SmootherRows(bound.samples, bound.intervals)
    forward = Forward(bound.algorithm, by_belief(bound))
    ran, run = choice.scan_bank(
        engine, forward, priors, rows, bound.intervals, axes=axes, keep="all", select=select_passed
    )
    size, T = len(run.code), run.info.predicted.mean.shape[1]
    if axes[1] is None:
        rows = jax.tree_util.tree_map(lambda leaf: np.broadcast_to(leaf, (size, *leaf.shape)), rows)
    rows = replace(rows, predicted=run.info.predicted, instant=run.info.instant)
    turned = jax.tree_util.tree_map(lambda leaf: np.asarray(leaf)[:, ::-1], rows)
    first = jax.tree_util.tree_map(lambda leaf: leaf[:, 0], turned)
    backward = Backward(bound.algorithm, np.full(() if axes[0] is None else size, T - 1))
    engine_used, back = _either_form(choice.scan_bank, engine, backward, first, turned, axes=(axes[0], 0, 0))
    failed = np.asarray(run.code) != 0
    info = jax.tree_util.tree_map(lambda leaf: leaf[:, ::-1], back.info)
    at = np.where(failed, run.failed_at, np.where(np.asarray(back.code) != 0, T - 1 - np.asarray(back.failed_at), 0))
    whole = run._replace(info=info, code=np.where(failed, run.code, back.code), failed_at=at, state=None)
    return ran if ran == engine_used else "xla", whole


def lagged(bound: Bound, rows: SmootherRows, forward: Run, lag: int) -> Smoothing:
    """Fixed lag: from row k + lag back to row k, for every k, after a `forward` run."""
    info = _lagged(bound.algorithm, rows, lag, by_elimination=False)
    if np.any(info.outcome):
        info = _lagged(bound.algorithm, rows, lag, by_elimination=True)
    at = np.argmax(info.outcome != 0)
    code, at = (forward.code, forward.failed_at) if forward.code else (info.outcome[at], at)
    return Smoothing("xla", info, int(code), int(at))


@forks.jit(static_argnames=("by_elimination",))
def _lagged(algorithm: Smoothable[Any] | Linearised, rows: SmootherRows, lag: int, *, by_elimination: bool) -> Info:
    T = len(rows.seen)

    def instant_at(row: int | Array):
        """Row `row`, without seen outputs where it is after the last."""
        there = jnp.minimum(row, T - 1)
        one = jax.tree_util.tree_map(lambda leaf: lax.dynamic_index_in_dim(leaf, there, keepdims=False), rows)
        one = replace(one, sample=replace(one.sample, seen=one.sample.seen & (row < T)))
        return instant_of(algorithm.at(there), one), one

    def row(k: int | Array):
        def back(j: int | Array, carry: tuple):
            instant, one = instant_at(k + lag - j)
            joint, even = gather(carry[0], instant, one)
            return about_state(joint, instant), carry[1] & even

        instant, one = instant_at(k)
        start = nothing(instant, one.predicted, by_elimination), jnp.array(True)
        later, even = lax.fori_loop(0, lag, back, start)
        joint, also = gather(later, instant, one)
        info = tell(algorithm.at(k), one.predicted, joint)
        return replace(info, outcome=jnp.where(even & also, info.outcome, UNEVEN))

    return lax.map(row, jnp.arange(T), batch_size=AT_ONCE)
