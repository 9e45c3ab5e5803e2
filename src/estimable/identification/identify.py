# pyright: reportUnknownArgumentType=false, reportUnknownLambdaType=false, reportUnknownMemberType=false
# pyright: reportUnnecessaryIsInstance=false
"""Identify a model from records."""

from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from .. import checks
from ..data.record import Record, several
from ..data.record_arguments import UNIFORM
from ..diagnostics.cramer_rao import undetermined
from ..engines import choice
from ..estimation.binding import bind, select
from ..frozen import frozen
from ..identifiers.joint_output_error import JointOutputError
from ..identifiers.output_error_ml import OutputErrorML
from ..identifiers.realised import check_lags
from ..identifiers.validation import information_of, stability_check, validated
from ..protocols import FilterIdentifier, Identifier, Method, RecursiveIdentifier, StartedIdentifier, Wrapper
from ..results import Check, Estimate, Fit, Outcome, Validation
from .adaptive import tracked
from .connected import Connected, at_own_stamps, connected, with_checks
from .loops import with_feedback_check
from .rivals import with_rivals
from .search import maximise

Records = Record | Sequence[Record]
LONGEST = 100_000  # rows up to which every row is stored
ENOUGH = 50  # seen rows a parameter, for a Gaussian belief that begins without a prior


def identify(method: Method, record: Records, *, engine: str = "auto") -> Fit:
    """Identify a model from one record, or from a list of records of several experiments on one plant.

    `method`: an identifier with its settings, such as `OutputErrorML(2, 1)` or
    `RecursiveOutputError(2, 1, noise_variance=0.1)`. Your own class must derive from `Identifier` or `RecursiveIdentifier`. A
    recursive method processes several records one after the other, each from rest. `engine`: as in `estimate`, for recursive
    methods.

    Returns a `Fit`. It holds the model and the parameters with their covariance. `fit.undetermined` spans the directions of
    the parameters about which the records carry no information. `fit.validation` holds residuals, the fit in per cent and the
    checked assumptions, each with a sentence. For a recursive method `fit.path` holds the parameters after each sample (only
    the last one for records longer than 100,000). Where the arrival of inputs is unknown, as for
    `JointOutputError(..., arrival=)`, only stability is checked.

    Stamps that are multiples of one step within a tenth of it are put on that grid (`Record.on_grid`); where they scatter more,
    or their scatter shows in the residuals, `OutputErrorML` is fitted to the stamps themselves. A batch method is fitted
    to parts of a record that is broken, or in which an input is unknown for more than 10 rows; shorter runs are estimated, and
    `OutputErrorML` counts their error. With first-order hold u[k] enters y[k]: a delay of d steps becomes d - 1 with one more
    coefficient. Checks of `fit.validation` say what was done. `sigma` of a record weighs its samples; methods whose noise is
    not that of single samples refuse it. Where an output is seen at every n-th row only, `fit.rivals` (k, d) are parameters that
    fit as well, and the check "rivals" fails.

    Raises `InputError` with every fault of the call.

    >>> plant = OutputError([-0.5], [1.0], noise_variance=0.01, dt=1)
    >>> u = np.random.default_rng(1).normal(size=500)
    >>> fit = identify(RecursiveOutputError(1, 0, noise_variance=0.01), simulate(plant, u, seed=1).record)
    >>> bool(abs(fit.parameters[0] + 0.5) < 4 * fit.sigma[0])
    True
    """
    records = _read(method, record, engine)
    fit, done = fitted(method, records, engine)
    return with_feedback_check(with_rivals(fit, done.method, done.records), done.method, done.records)


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def fitted(method: Method, records: list[Record], engine: str = "auto") -> tuple[Fit, Connected]:
    """The fit and its checks, without the test of feedback; and its records: on a grid, where there is one, even if the fit is
    to the stamps."""
    done = connected(method, records)
    _check(done.method, done.records)
    fit = with_checks(_fitted(done.method, done.records, engine), done)
    stamped = at_own_stamps(done.method, records, fit)
    if stamped is None:
        return fit, done
    return with_checks(_fitted(stamped.method, stamped.records, engine), stamped), done


def _fitted(method: Method, records: list[Record], engine: str) -> Fit:
    match method:
        case FilterIdentifier():
            return tracked(method, records, engine)
        case RecursiveIdentifier():
            return _recursive(method, records, engine)
        case StartedIdentifier():
            return _started(method, records, engine)
        case Identifier():
            return _checked(method, method.fit(records))
        case _:
            raise TypeError(f"{type(method).__name__} is not an identifier")  # excluded by _read


def _checked(method: Identifier, fit: Fit) -> Fit:
    """Check that a user's method returns a fit with a name for each parameter."""
    faults, name = checks.Faults(), type(method).__name__
    if not isinstance(fit, Fit):
        checks.refuse(f"`fit` of {name} must return an estimable.results.Fit. It returned {checks.short(fit)}.")
    faults.learn("d", len(fit.names), f"`names` has {checks.counted(len(fit.names), 'entry')}")
    faults.array(f"parameters of {name}", fit.parameters, "d", nan=True)
    if fit.covariance is not None and not np.isnan(np.asarray(fit.covariance)).any():
        faults.array(f"covariance of {name}", fit.covariance, "d d")
    faults.finish()
    return fit


def _read(method: Method, record: Records, engine: str) -> list[Record]:
    """The records, checked to be alike; every fault of the call at once."""
    faults = checks.Faults()
    choice.check(engine, faults)
    if isinstance(method, type):
        faults.add(f"`method` must be an instance, not a class: write {method.__name__}(...), not {method.__name__}.")
    elif not isinstance(method, Method):
        faults.add(
            "`method` must identify parameters, such as RecursiveOutputError(2, 1, ...); your own class must derive from "
            f"estimable.Identifier or RecursiveIdentifier. Got {checks.short(method)}."
        )
    records = several("record", record, faults)
    faults.finish()
    return records


def _check(method: Method, records: list[Record]) -> None:
    """Check that the records are alike, that the method can weigh their samples, and has an input if it needs one."""
    faults = checks.Faults()
    _check_sigma(method, records, faults)
    for i, one in enumerate(records):
        _check_alike(method, one, records[0], f"record {i}" if len(records) > 1 else "the record", faults)
    if not records[0].inputs and not method.fits_series:
        faults.add(
            "the record has no input: give `u`, or use LeastSquares, PredictionError or PredictorSubspace, which also fit series."
        )
    faults.finish()


def _check_sigma(method: Method, records: list[Record], faults: checks.Faults) -> None:
    """Check that the method weighs samples, and that no sample has an infinite weight."""
    given = [np.where(one.seen, one.sigma, np.nan) for one in records if one.sigma is not None]
    if given and method.cannot_weigh:
        faults.add(
            f"{type(method).__name__} cannot weigh samples by `sigma` of the record: {method.cannot_weigh}. Leave `sigma` out, "
            "or use OutputErrorML, which weighs by it."
        )
    elif any(np.any(one == 0) for one in given):
        faults.add("`sigma` must be greater than 0 in identify: a sample without noise has an infinite weight.")


def _check_alike(method: Method, record: Record, first: Record, which: str, faults: checks.Faults) -> None:
    """Check that a record has a regular step, and the channels and step of the first."""
    if (record.inputs, record.outputs) != (first.inputs, first.outputs):
        faults.add(f"{which} has other channels than record 0: all records need the same channels, in the same order.")
    if record.dt is None and not (isinstance(method, OutputErrorML) and record.t is not None):
        faults.add(f"{which} needs a regular step `dt`, in seconds.")
    elif record.dt is not None and first.dt is not None and abs(record.dt - first.dt) > UNIFORM * first.dt:
        faults.add(f"{which} has a step of {record.dt:g} s, but record 0 of {first.dt:g} s: they must be equal.")


@frozen
class _Resumed(Wrapper[Any]):
    """A recursive method that continues from the previous record, with the plant at rest."""

    algorithm: RecursiveIdentifier[Any]
    state: Any

    def init(self, prior: None) -> Any:
        """The state after the previous record, at rest."""
        return self.algorithm.rested(self.state)


def _started(method: StartedIdentifier, records: list[Record], engine: str) -> Fit:
    """The fit, with a start from a recursion."""
    method.check(records)
    starter = method.starter(records)
    if starter is None:
        return method.fit(records, search=maximise)
    end, _ = _run(starter.for_channels(records[0].inputs, records[0].outputs), records, engine)
    return method.fit(records, np.asarray(end.mean)[-1], maximise)


def _recursive(method: RecursiveIdentifier[Any], records: list[Record], engine: str) -> Fit:
    """Run the recursion over the records, and validate the final model."""
    faults = checks.Faults()
    check_lags(method, records, faults)
    faults.finish()
    method = method.for_channels(records[0].inputs, records[0].outputs)
    estimate, log_likelihood = _run(method, records, engine)
    θ, Σ = np.asarray(estimate.mean)[-1], np.asarray(estimate.covariance)[-1]
    model, free = method.fitted(θ, records[0].dt or 0.0), None
    known = not (method.takes_unknown_arrivals and any(np.isnan(one.applied()).any() for one in records))
    if not (known and model.is_stable):  # its response is unknown, or diverges
        validation = Validation((), np.full(model.p, np.nan), (stability_check(model),))
    else:
        M = information_of(model, records)
        free, printed = undetermined(M), method.method == "printed"
        validation = validated(model, records, method.noise_variance, information=M, pseudo_linear=printed)
    if isinstance(method, JointOutputError) and method.prior is None:
        validation = validation._replace(checks=(*validation.checks, *_belief_checks(method, records)))
    return Fit(
        model, θ, Σ, method.names.states, validation, estimate, log_likelihood,
        free if free is not None and free.shape[1] else None, estimate.outcome, type(method).__name__, estimate.engine,
    )  # fmt: skip


def _belief_checks(method: JointOutputError, records: list[Record]) -> list[Check]:
    """A failed check where few rows were seen: a sum of Gaussian beliefs is then not that of the data."""
    size = len(method.names.states) // len(records[0].outputs)
    seen = int(np.min(np.sum([record.seen.sum(axis=0) for record in records], axis=0)))
    if seen >= ENOUGH * size:
        return []
    sentence = (
        f"Belief: {seen} rows were seen for {checks.counted(size, 'parameter')}: with fewer than {ENOUGH} for each, sigma is not "
        "to be trusted. Give a `prior`, or use OutputErrorML."
    )
    return [Check("belief", False, seen / size, float(ENOUGH), sentence)]


def _run(method: RecursiveIdentifier[Any], records: list[Record], engine: str) -> tuple[Estimate, float]:
    """The estimate over the last record, after the earlier ones, and the log-likelihood of all."""
    asked, start, total = engine, method, 0.0
    for record in records[:-1]:
        asked = "xla"  # machine code does not return its final state
        bound = bind(start, record, None)
        _, run = choice.scan(
            asked, bound.algorithm, None, bound.samples, bound.intervals, keep="likelihood", select=select
        )
        start, total = _Resumed(method, run.state), total + float(run.log_likelihood)
    bound = bind(start, records[-1], None)
    keep = "all" if len(records[-1]) <= LONGEST else "last"
    name, run = choice.scan(asked, bound.algorithm, None, bound.samples, bound.intervals, keep=keep, select=select)
    run = jax.tree_util.tree_map(np.asarray, jax.block_until_ready(run))
    info, t = run.info, np.asarray(bound.t)
    if keep == "last":
        info, t = jax.tree_util.tree_map(lambda leaf: leaf[None], info), t[-1:]
    outcome = Outcome.of(int(run.code), int(run.failed_at), bound.t)
    likelihood = float(run.log_likelihood)
    return Estimate(info, t, likelihood, outcome, name, bound.names), total + likelihood
