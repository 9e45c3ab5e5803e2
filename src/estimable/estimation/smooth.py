# pyright: reportUnknownArgumentType=false, reportUnknownLambdaType=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false
"""Smoothing: every state from samples before and after it."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from .. import checks, forks
from ..annotations import Array
from ..data.record import Record
from ..engines import choice
from ..errors import RunError
from ..filters.belief import Belief, smoothed
from ..filters.wrapped import check_algorithm
from ..frozen import frozen, replace
from ..kernels.smoothing import Evidence, Instant, about_state, earlier, nothing
from ..models.prior import Prior
from ..protocols import Algorithm, Smoothable, Wrapper
from ..results import Info, Interval, Outcome, Sample, SmoothedEstimate, outcome_code
from .binding import Bound, bind
from .estimate import check_options

AT_ONCE = 1_000  # rows of a fixed lag computed side by side: a few megabytes


def smooth(
    algorithm: Smoothable[Any],
    record: Record,
    *,
    prior: Prior,
    lag: int | None = None,
    on_failure: str = "raise",
    engine: str = "auto",
) -> SmoothedEstimate:
    """Estimate the states (and gains) of a record from samples before and after them.

    `lag=None`: row k uses every sample (fixed interval). `lag=L`: row k uses the samples 0 to k + L (fixed lag), so its
    estimate is available L samples later; `lag=0` equals `estimate`.

    `algorithm`: `Kalman`, `UnknownGain`, `UnknownInput`, or your own class derived from `Smoothable`. With `UnknownInput` row
    k holds the input of row k. The data may be all that `estimate` supports: known inputs, outputs missing channel by
    channel, irregular time, cross noise, singular covariances, diffuse priors. The other arguments are as in `estimate`.

    Returns a `SmoothedEstimate`; `used[k]` is the last sample that row k uses. Directions that the whole record leaves
    undetermined are in `diffuse_covariance`. Raises `InputError` with every fault of the call; `RunError` where the numbers
    failed, naming the sample.

    Cost: a fixed interval about 4 times that of `estimate`; a fixed lag L times that of `estimate`.

    Reference: Fraser & Potter (1969), Mayne (1966); see `estimable.kernels.smoothing`.

    >>> model = StateSpace([[1.0]], C=[[1.0]], Q=[[0.0]], R=[[1.0]], dt=1)
    >>> result = smooth(Kalman(model), Record([[2.0], [4.0]], dt=1), prior=Prior([0.0], [[1.0]]))
    >>> result.mean.ravel().round(6).tolist(), result.used.tolist()
    ([2.0, 2.0], [1, 1])
    """
    check_options(on_failure, engine, "all")
    _check_call(algorithm, lag)
    bound = bind(algorithm.for_smoothing, record, prior)
    _, forward = choice.scan(
        engine, _Forward(bound.algorithm), prior, bound.samples, bound.intervals, keep="all", select=_predicted
    )
    rows = _PredictedRows(bound.samples, bound.intervals, forward.info)
    last = len(record) - 1
    if lag is None:
        engine, info, code, at = _backwards(bound, rows, last, engine)
        used = np.full(last + 1, last)
    else:
        lag = min(lag, last)
        engine, info = "xla", _lagged(bound.algorithm, rows, lag)
        at = np.argmax(info.outcome != 0)
        code, used = info.outcome[at], np.minimum(np.arange(last + 1) + lag, last)
    first = (forward.code, forward.failed_at) if forward.code else (code, at)
    outcome = Outcome.of(int(first[0]), int(first[1]), bound.t)
    if outcome.code and on_failure == "raise":
        raise RunError(outcome)
    info = jax.tree_util.tree_map(np.asarray, info)
    return SmoothedEstimate(
        info, bound.t, float(forward.log_likelihood), used, outcome, engine, bound.names._replace(note="")
    )


def _check_call(algorithm: Algorithm[Any], lag: int | None) -> None:
    faults = checks.Faults()
    if lag is not None:
        faults.whole("lag", lag, 0)
    check_algorithm(algorithm, faults)
    faults.finish()
    if not isinstance(algorithm, Smoothable):
        hint = ": smooth the algorithm inside" if isinstance(algorithm, Wrapper) else ""
        faults.add(
            f"smooth needs an algorithm with a linear Gaussian model, such as Kalman or UnknownGain. "
            f"{type(algorithm).__name__} has none{hint}."
        )
    elif algorithm.forgetting != 1.0:
        faults.add(
            f"smooth needs a model of how the gain moves, but forgetting = {algorithm.forgetting:g} is not one: give "
            "UnknownGain a `walk` instead, and forgetting = 1."
        )
    faults.finish()


@frozen
class _Passed:
    """The report of the forward pass on a row, for an engine: the belief `predicted` for it."""

    predicted: Belief
    log_likelihood: Any
    outcome: Any


@frozen
class _Forward:
    """An algorithm that stores its prediction for each row."""

    algorithm: Any

    def at(self, k: int | Array) -> "_Forward":
        return replace(self, algorithm=self.algorithm.at(k))

    def init(self, prior: Prior) -> Belief:
        return self.algorithm.init(prior)

    def correct(self, state: Belief, sample: Sample) -> tuple[Belief, _Passed]:
        after, info = self.algorithm.correct(state, sample)
        return after, _Passed(state, info.log_likelihood, info.outcome)

    def predict(self, state: Belief, interval: Interval) -> Belief:
        return self.algorithm.predict(state, interval)


def _predicted(passed: _Passed, keep: str) -> Belief:
    """The belief in a report of `_Forward`."""
    return passed.predicted


@frozen
class _PredictedRows:
    """The rows for the backward pass."""

    sample: Sample
    interval: Interval
    predicted: Belief

    @property
    def seen(self):
        """The mask of seen outputs; its length is the number of rows."""
        return self.sample.seen


@frozen
class _Backward:
    """A step of the backward pass, for an engine: the state is the information in later samples."""

    algorithm: Any
    last: Any

    def at(self, k: int | Array) -> "_Backward":
        return replace(self, algorithm=self.algorithm.at(self.last - k))

    def init(self, first_mean: Array) -> Evidence:
        return nothing(first_mean.shape[0])

    def correct(self, state: Evidence, sample: _PredictedRows) -> tuple[Evidence, Info]:
        joint = _gather(state, self.algorithm.instant(sample.sample, sample.interval), sample.sample)
        return about_state(joint, state.z.shape[0]), _tell(self.algorithm, sample.predicted, joint)

    def predict(self, state: Evidence, interval: Interval) -> Evidence:
        return state


def _gather(later: Evidence, instant: Instant, sample: Sample) -> Evidence:
    return earlier(later, instant, sample.y, sample.seen)


def _tell(algorithm: Smoothable[Any], predicted: Belief, later: Evidence) -> Info:
    belief = smoothed(predicted, later)
    return replace(algorithm.tell(belief), outcome=outcome_code(False, belief.mean, belief.factor, belief.diffuse))


def _whole(info: Info, keep: str) -> Info:
    return info


def _backwards(bound: Bound, rows: _PredictedRows, last: int, engine: str):
    """Fixed interval: the engine that ran, the info of every row, the first failure and its row."""
    turned = jax.tree_util.tree_map(lambda leaf: leaf[::-1], rows)
    algorithm = _Backward(bound.algorithm, np.asarray(last))
    engine, run = choice.scan(
        engine, algorithm, turned.predicted.mean[-1], turned, turned.interval, keep="all", select=_whole
    )
    return engine, jax.tree_util.tree_map(lambda leaf: leaf[::-1], run.info), run.code, last - run.failed_at


@forks.jit
def _lagged(algorithm: Smoothable[Any], rows: _PredictedRows, lag: int) -> Info:
    """Fixed lag: from row k + lag back to row k, for every k."""
    T, n = rows.predicted.mean.shape

    def instant_at(row: int | Array):
        """Row `row`, without seen outputs where it is after the last."""
        there = jnp.minimum(row, T - 1)
        one = jax.tree_util.tree_map(lambda leaf: lax.dynamic_index_in_dim(leaf, there, keepdims=False), rows)
        sample = replace(one.sample, seen=one.sample.seen & (row < T))
        return algorithm.at(there).instant(sample, one.interval), replace(one, sample=sample)

    def row(k: int | Array):
        def back(j: int | Array, later: Evidence):
            instant, one = instant_at(k + lag - j)
            return about_state(_gather(later, instant, one.sample), n)

        later = lax.fori_loop(0, lag, back, nothing(n))
        instant, one = instant_at(k)
        return _tell(algorithm.at(k), one.predicted, _gather(later, instant, one.sample))

    return lax.map(row, jnp.arange(T), batch_size=AT_ONCE)
