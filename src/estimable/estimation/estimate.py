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
from ..results import Estimate, Origin, Outcome
from . import windows
from .binding import bind, select

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
) -> Estimate:
    """Run a state estimator over a record. T rows in, T rows out; row k uses the samples 0..k.

    `algorithm`: `Kalman`, `UnknownGain`, or any other with init, correct and predict. `record`: outputs and inputs are
    matched to the model's channels by name. `prior`: of the state x[0], before y[0]; None for an algorithm that does not
    estimate the state of a plant. `on_failure`: "raise" a `RunError` where a run fails, or "keep" its result, with the outcome.
    `engine`: "auto", "native" (machine code, for small models) or "xla". `keep`: "all"; "means" (no covariances); "last" (one
    row); "likelihood" (no row).

    Raises `InputError` with every fault of the call; `RunError` where the numbers failed, naming the sample.

    >>> model = StateSpace([[1.0]], C=[[1.0]], Q=[[0.0]], R=[[1.0]], dt=1)
    >>> result = estimate(Kalman(model), Record([[2.0], [4.0]], dt=1), prior=Prior([0.0], [[1.0]]))
    >>> result.mean.ravel().round(6).tolist(), result.engine
    ([1.0, 2.0], 'native')
    """
    check_options(on_failure, engine, keep)
    bound = bind(algorithm, record, prior)
    engine, run = windows.scan(engine, bound.algorithm, prior, bound.samples, bound.intervals, keep=keep, select=select)
    run = jax.tree_util.tree_map(np.asarray, jax.block_until_ready(run))
    outcome = Outcome.of(int(run.code), int(run.failed_at), bound.t)
    if outcome.code and on_failure == "raise":
        raise RunError(outcome)
    info = jax.tree_util.tree_map(lambda leaf: leaf[None], run.info) if keep == "last" else run.info
    t = bound.t if keep != "last" or bound.t is None else bound.t[-1:]
    return Estimate(info, t, float(run.log_likelihood), outcome, engine, bound.names, Origin(algorithm, record, prior))


def log_likelihood(algorithm: Algorithm[Any], record: Record, *, prior: Prior) -> Any:
    """The log-likelihood of a record, differentiable by JAX with respect to the algorithm's numbers.

    A variance that is exactly zero has no derivative (its square root has none): the gradient is 0 there.

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
