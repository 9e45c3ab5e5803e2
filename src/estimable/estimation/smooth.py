# pyright: reportUnknownArgumentType=false, reportUnknownLambdaType=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false
"""Smoothing: every state from samples before and after it."""

from typing import Any

import jax
import numpy as np

from .. import checks
from ..data.record import Record
from ..engines import choice
from ..errors import RunError
from ..filters.extended_kalman import ExtendedKalman
from ..filters.linearised import Linearised
from ..filters.wrapped import check_algorithm
from ..models.prior import Prior
from ..protocols import Algorithm, Smoothable, Wrapper
from ..results import Info, Origin, SmoothedEstimate
from . import gauss_newton, two_filters
from .binding import Bound, bind
from .estimate import check_options
from .gaps import Given


def smooth(
    algorithm: Smoothable[Any] | Linearised,
    record: Record,
    *,
    prior: Prior,
    lag: int | None = None,
    iterations: int = 1,
    on_failure: str = "raise",
    engine: str = "auto",
    gaps: Given = "auto",
) -> SmoothedEstimate:
    """Estimate the states (and gains) of a record from samples before and after them.

    `lag=None`: row k uses every sample (fixed interval). `lag=L`: row k uses the samples 0 to k + L (fixed lag), so its
    estimate is available L samples later; `lag=0` equals `estimate`.

    `algorithm`: `Kalman`, `UnknownGain`, `UnknownInput`, or your own class derived from `Smoothable`; of a nonlinear model
    `ExtendedKalman`, `SecondOrderKalman`, `UnscentedKalman`, or your own class derived from `Linearised`. With `UnknownInput`
    row k holds the input of row k. The data may be all that `estimate` supports: known inputs, outputs missing channel by
    channel, irregular time, cross noise, singular covariances, diffuse priors. The other arguments are as in `estimate`.

    `iterations`: with more than 1 the model of an `ExtendedKalman` is linearised about the smoothed states and smoothed again,
    at most so many times, until no state changes by more than 1e-10 of its standard deviation. The result is then the most
    probable states and parameters. Where the iterations end before that, the outcome is a failure.

    `gaps`: what to do where the input was not recorded, as in `estimate`.

    Returns a `SmoothedEstimate`; `used[k]` is the last sample that row k uses. Directions that the whole record leaves
    undetermined are in `diffuse_covariance`. Raises `InputError` with every fault of the call; `RunError` where the numbers
    failed, naming the sample.

    Cost: a fixed interval 2 to 4 times that of `estimate`, or 6 to 60 times with diffuse priors, cross noise, unknown inputs or
    outputs without noise; a fixed lag L times that of `estimate`.

    Reference: Fraser & Potter (1969), Mayne (1966); see `estimable.kernels.later_information` and `estimable.kernels.smoothing`.
    Iterations: B. M. Bell, SIAM J. Optim. 4 (1994) 626-636.

    >>> model = StateSpace([[1.0]], C=[[1.0]], Q=[[0.0]], R=[[1.0]], dt=1)
    >>> result = smooth(Kalman(model), Record([[2.0], [4.0]], dt=1), prior=Prior([0.0], [[1.0]]))
    >>> result.mean.ravel().round(6).tolist(), result.used.tolist()
    ([2.0, 2.0], [1, 1])
    """
    check_options(on_failure, engine, "all")
    _check_call(algorithm, lag, iterations)
    bound = bind(algorithm.for_smoothing, record, prior, gaps=gaps)
    ran, rows, forward = two_filters.forwards(bound, prior, engine)
    last = len(bound.samples.seen) - 1
    if lag is None:
        run, lag = two_filters.backwards(bound, rows, forward, engine), last
        if iterations > 1 and isinstance(algorithm, Linearised):
            run = gauss_newton.repeated(bound, prior, engine, run, iterations)
    else:
        lag = min(lag, last)
        run = two_filters.lagged(bound, rows, forward, lag)
    used = np.minimum(np.arange(last + 1) + lag, last)
    outcome = bound.outcome(run.code, run.at)
    if outcome.code and on_failure == "raise":
        raise RunError(outcome)
    info = _expanded(bound, prior, engine, run.info)
    used = bound.rows_of(used)
    names = bound.names._replace(note="")
    return SmoothedEstimate(
        info, bound.t, float(forward.log_likelihood), used, outcome, ran if ran == run.engine else "xla", names,
        Origin(algorithm, record, prior), bound.gaps,
    )  # fmt: skip


def _expanded(bound: Bound, prior: Prior, engine: str, smoothed: Info) -> Info:
    """The smoothed reports with the rows inside gaps, for which those of the filter are needed."""
    smoothed = jax.tree_util.tree_map(np.asarray, smoothed)
    if not bound.hides_rows:
        return bound.expanded(smoothed)
    _, run = choice.scan(
        engine, bound.algorithm, prior, bound.samples, bound.intervals, keep="all", select=lambda info, keep: info
    )
    return bound.expanded(jax.tree_util.tree_map(np.asarray, run.info), later=smoothed)


def _check_call(algorithm: Algorithm[Any], lag: int | None, iterations: int) -> None:
    faults = checks.Faults()
    if lag is not None:
        faults.whole("lag", lag, 0)
    faults.whole("iterations", iterations, 1)
    check_algorithm(algorithm, faults)
    faults.finish()
    check_smoothable(algorithm)
    if iterations > 1 and isinstance(algorithm, Linearised):
        _check_iterations(algorithm, lag, faults)
    faults.finish()


def check_smoothable(algorithm: Algorithm[Any]) -> None:
    """Check that an algorithm has a model for the smoother."""
    faults = checks.Faults()
    if not isinstance(algorithm, Smoothable | Linearised):
        hint = ": smooth the algorithm inside" if isinstance(algorithm, Wrapper) else ""
        faults.add(
            f"smooth needs an algorithm with a Gaussian model of each row, such as Kalman, UnknownGain or ExtendedKalman. "
            f"{type(algorithm).__name__} has none{hint}."
        )
    elif isinstance(algorithm, Smoothable) and algorithm.forgetting != 1.0:
        faults.add(
            f"smooth needs a model of how the gain moves, but forgetting = {float(algorithm.forgetting):g} is not one: give "
            "UnknownGain a `walk` instead, and forgetting = 1."
        )
    faults.finish()


def _check_iterations(algorithm: Linearised, lag: int | None, faults: checks.Faults) -> None:
    if not isinstance(algorithm, ExtendedKalman):
        faults.add(
            f"`iterations` finds the most probable states by tangents of the model, which {type(algorithm).__name__} does "
            "not use: give an ExtendedKalman of the same model, or leave `iterations` out."
        )
    if lag is not None:
        faults.add(f"`iterations` linearises about the whole record, and lag = {lag} does not: leave one of them out.")
