# pyright: reportUnknownArgumentType=false, reportUnknownLambdaType=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false
"""Run a state estimator over one record."""

from typing import Any

import jax
import numpy as np

from .. import checks
from ..data.record import Record
from ..engines import choice, xla
from ..errors import RunError
from ..models.prior import Prior
from ..protocols import Algorithm
from ..results import Estimate, Origin
from . import windows
from .binding import bind, select
from .declared_angles import ranged
from .gaps import Given

ON_FAILURE = ("raise", "keep")


def check_options(on_failure: str, engine: str, keep: str) -> None:
    """Check the options that the estimating drivers share."""
    faults = checks.Faults()
    faults.choice("on_failure", on_failure, ON_FAILURE)
    choice.check(engine, faults)
    faults.choice("keep", keep, xla.KEEP)
    faults.finish()


def estimate(
    algorithm: Algorithm[Any],
    record: Record,
    *,
    prior: Prior | None,
    on_failure: str = "raise",
    engine: str = "auto",
    keep: str = "all",
    gaps: Given = "auto",
) -> Estimate:
    """Run a state estimator over a record. The result has one row for each row of the record, and row k uses the samples 0 to
    k.

    - `algorithm`: the estimator, such as `Kalman(model)` or `UnknownGain(model, gain)`.
    - `record`: the `Record`. Its outputs and inputs are matched to the channels of the model by name.
    - `prior`: the `Prior` of the state x[0], before the sample y[0]. None for an algorithm that estimates no state of a
      plant.
    - `on_failure`: "raise": a `RunError` where a run fails; "keep": the result, whose `outcome` says where and why it failed.
    - `engine`: "native" (machine code, for small models), "xla" (JAX), or "auto", the first that can run the algorithm.
    - `keep`: which rows and arrays the result holds. "all": all; "means": no covariances; "last": only the last row;
      "likelihood": no rows.
    - `gaps`: what to do where the input was not recorded, "auto", "bridge", "break", "refuse", or a `Gaps`.

    Returns an `Estimate`. Raises `InputError` with every fault of the call; `RunError` where the numbers failed, naming the
    sample.

    >>> model = StateSpace([[1.0]], C=[[1.0]], Q=[[0.0]], R=[[1.0]], dt=1)
    >>> result = estimate(Kalman(model), Record([[2.0], [4.0]], dt=1), prior=Prior([0.0], [[1.0]]))
    >>> result.mean.ravel().round(6).tolist(), result.engine
    ([1.0, 2.0], 'native')
    """
    check_options(on_failure, engine, keep)
    bound = bind(algorithm, record, prior, gaps=gaps)
    engine, run = windows.scan(engine, bound.algorithm, prior, bound.samples, bound.intervals, keep=keep, select=select)
    run = jax.tree_util.tree_map(np.asarray, jax.block_until_ready(run))
    outcome = bound.outcome(int(run.code), int(run.failed_at))
    if outcome.code and on_failure == "raise":
        raise RunError(outcome)
    info = jax.tree_util.tree_map(lambda leaf: leaf[None], run.info) if keep == "last" else run.info
    info = ranged(info, bound.names) if keep == "last" else bound.expanded(info)
    t = bound.t if keep != "last" or bound.t is None else bound.t[-1:]
    origin = Origin(algorithm, record, prior)
    return Estimate(info, t, float(run.log_likelihood), outcome, engine, bound.names, origin, bound.gaps)


def log_likelihood(algorithm: Algorithm[Any], record: Record, *, prior: Prior) -> Any:
    """The log-likelihood of a record under an algorithm. JAX can differentiate it with respect to the numbers of the
    algorithm.

    `algorithm`, `record` and `prior` are as in `estimate`. With respect to a variance that is exactly zero the gradient is 0:
    the filter uses the square root of the variance, which has no derivative at 0.

    >>> import jax
    >>> model = StateSpace([[1.0]], C=[[1.0]], Q=[[0.5]], R=[[1.0]], dt=1)
    >>> prior, record = Prior([0.0], [[1.0]]), Record([[2.0], [4.0]], dt=1)
    >>> slope = jax.grad(lambda algorithm: log_likelihood(algorithm, record, prior=prior))(Kalman(model))
    >>> slope.model.R.shape
    (1, 1)
    """
    bound = bind(algorithm, record, prior)
    return xla.scan(
        bound.algorithm, prior, bound.samples, bound.intervals, keep="likelihood", select=select
    ).log_likelihood
