"""An algorithm, a record and a prior prepared for an engine: matched by name, checked together, sampled."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from .. import checks
from ..data.messy import without_wild
from ..data.record import Record, match
from ..data.record_arguments import scatter
from ..filters.belief import Belief
from ..filters.restarting import restarting
from ..filters.wrapped import check_algorithm
from ..identifiers.channels import Channels
from ..models import angles
from ..models.angles import Angles
from ..models.nonlinear_model import NonlinearModel
from ..models.prior import Prior
from ..models.sampled import Clock
from ..models.state_space import StateSpace
from ..protocols import Algorithm, RecursiveIdentifier
from ..results import Gap, Info, Interval, Names, Outcome, Sample, Stacked
from .declared_angles import check_undeclared, of_both, ranged, with_angles
from .following import along_record
from .gapped import Gapped, expanded, fresh_of, restarts_of, treated
from .gaps import Given
from .gaps import read as read_gaps
from .time_unit import check_time_unit, warn_of_placing

FLATTEST = 1e28  # variance of an output by the prior, relative to its noise: beyond it, rounding shows in the estimates
MEANS = ("mean", "gain", "unknown_input", "innovation", "log_likelihood", "outcome")


class Bound(NamedTuple):
    """The arguments of an engine; the samples and intervals of a bank have a leading batch axis.

    `clock`, `complete`: what other numbers of the same algorithm are prepared with (`prepared`).
    """

    algorithm: Any
    samples: Sample
    intervals: Interval
    names: Names
    t: np.ndarray | None
    clock: Clock
    complete: bool
    gapped: Gapped | None = None
    fresh: Belief | None = None

    def outcome(self, code: int, failed_at: int) -> Outcome:
        """The outcome of a run that first failed at a row of the engine."""
        return Outcome.of(code, int(self.rows_at(np.asarray(failed_at))), self.t)

    def rows_at(self, at: np.ndarray) -> np.ndarray:
        """The rows of the record of rows that are run."""
        return at if self.gapped is None else self.gapped.plan.rows[at]

    @property
    def hides_rows(self) -> bool:
        """Whether rows inside gaps are not run."""
        return self.gapped is not None and len(self.gapped.plan.rows) < len(self.gapped.record)

    def rows_of(self, used: np.ndarray) -> np.ndarray:
        """The last row that each row of the record uses, from those of the rows that are run."""
        if self.gapped is None or not self.hides_rows:
            return used
        rows = self.gapped.plan.rows
        return rows[used[np.searchsorted(rows, np.arange(len(self.gapped.record)))]]

    @property
    def gaps(self) -> tuple[Gap, ...]:
        """What was done in which gap."""
        return () if self.gapped is None else self.gapped.plan.found

    def expanded(self, info: Info, axis: int = 0, later: Info | None = None) -> Info:
        """The reports with the rows inside gaps, and each angle in its range."""
        return ranged(expanded(info, self.gapped, self.fresh, axis, later), self.names)


def select(info: Info, keep: str) -> Info:
    """The part of an info that `keep` selects."""
    if keep in ("all", "last"):
        return info
    return Info(**{name: getattr(info, name) for name in (MEANS if keep == "means" else ())})


def model_of(algorithm: Algorithm[Any]) -> Any:
    """The model inside an algorithm and its wrappers."""
    return algorithm.innermost.model


def bind(
    algorithm: Algorithm[Any],
    record: Record,
    prior: Prior | None,
    *,
    bank: Record | None = None,
    algorithms: Algorithm[Any] | None = None,
    gaps: Given = "auto",
) -> Bound:
    """Check everything together, then match by name, determine the applied inputs, and sample the model.

    For a bank, `algorithm`, `record` and `prior` are those of one run, with the shapes and names of all; `bank` and
    `algorithms` then hold the numbers of all.
    """
    faults = checks.Faults()
    _check_kinds(algorithm, record, prior, faults)
    faults.finish()
    if algorithms is None:
        algorithm = along_record(algorithm, record)
    names, rows = algorithm.names, bank or record
    outputs, inputs, turns = _matched(algorithm, record, rows, prior, faults)
    settings = read_gaps(gaps, len(names.inputs), faults)
    faults.finish()
    algorithm, algorithms = with_angles(algorithm, turns), algorithms and with_angles(algorithms, turns)
    u, arrived = _inputs_of(algorithm, record, rows, inputs, faults)
    gapped = None
    if arrived is None and not unknown_arrivals(record, rows):
        gapped = treated(algorithm, record, rows, u, settings, algorithms is not None, faults)
    if gapped is None and not faults.sentences:
        check_known(u, names.inputs, faults)
    faults.finish()
    u = u if gapped is None else gapped.plan.u
    _check_at(algorithm, prior, u, faults)
    warn_of_placing(model_of(algorithm), tuple(record.outputs[i] for i in outputs), record)
    samples, intervals, clock = _laid_out(algorithm, record, rows, outputs, (u, arrived), gapped)
    fresh = anew = None
    if gapped is not None and gapped.plan.restart is not None:
        anew = restarts_of(gapped.known, settings)
        fresh = fresh_of(gapped.known, settings) if isinstance(anew, tuple) else anew
    complete = prior is not None and prior.diffuse is None and bool(samples.seen.all()) and fresh is None
    stacked = None if algorithms is None else len(jax.tree_util.tree_leaves(algorithms)[0])
    ready = prepared(algorithms or algorithm, clock, complete, anew, stacked)
    names = names._replace(units=record.units, angles=turns, **ready.result_names)
    return Bound(ready, samples, intervals, names, rows.t, clock, complete, gapped, fresh)


def _matched(
    algorithm: Algorithm[Any], record: Record, rows: Record, prior: Prior | None, faults: checks.Faults
) -> tuple[list[int], list[int], Angles]:
    """The columns of outputs and inputs in the record, and the declared angles, with all checks of the call."""
    model, names = model_of(algorithm), algorithm.names
    outputs = columns(names.outputs, record.outputs, "output", "y", faults)
    if faults.sentences and record.y.shape[-2] == len(names.outputs) < record.y.shape[-1]:
        faults.add(
            f"`y` of the record has {len(names.outputs)} rows and {record.y.shape[-1]} columns: did you mean `y.T`?"
        )
    inputs = columns(names.inputs, record.inputs, "input", "u", faults)
    if algorithm.has_state_prior:
        check_prior(prior, model, faults)
    _check_time(model, record, faults)
    check_time_unit(model, record, faults)
    algorithm.check_record(len(record), faults)
    turns = of_both(model, record, outputs, faults)
    if record.sigma is not None and not isinstance(model, StateSpace | NonlinearModel | Channels):
        faults.add(f"{type(algorithm.innermost).__name__} cannot use `sigma` of the record: leave it out.")
    faults.finish()
    check_undeclared(_columns_of(rows.y, outputs), names, (*turns, *record.angles), faults)
    return outputs, inputs, turns


def _inputs_of(
    algorithm: Algorithm[Any], record: Record, rows: Record, inputs: list[int], faults: checks.Faults
) -> tuple[np.ndarray, np.ndarray | None]:
    """The inputs of the model, and whether they arrived where the algorithm takes that."""
    u, arrived = (
        _arrivals(algorithm, record, rows, faults) if algorithm.takes_unknown_arrivals else (rows.applied(), None)
    )
    u = angles.unwrapped(u, record.angles, record.inputs)
    return _columns_of(u, inputs), None if arrived is None else _columns_of(arrived, inputs)


def _check_at(algorithm: Algorithm[Any], prior: Prior | None, u: np.ndarray, faults: checks.Faults) -> None:
    """Check that the functions of a nonlinear model are finite at the start."""
    model = model_of(algorithm)
    if isinstance(model, NonlinearModel) and prior is not None:
        model.check_at(prior.mean, u[(0,) * (u.ndim - 1)], faults)
        faults.finish()


def _laid_out(
    algorithm: Algorithm[Any],
    record: Record,
    rows: Record,
    outputs: list[int],
    given: tuple[np.ndarray, np.ndarray | None],
    gapped: Gapped | None,
) -> tuple[Sample, Interval, Clock]:
    """The samples, intervals and steps of the rows that are run."""
    model, names, (u, arrived) = model_of(algorithm), algorithm.names, given
    has_angles = isinstance(model, StateSpace | NonlinearModel)
    y = rows.y if has_angles else angles.unwrapped(rows.y, record.angles, record.outputs)
    y = without_wild(_columns_of(y, outputs), names.outputs)
    sigma = None if rows.sigma is None else _columns_of(rows.sigma, outputs)
    if gapped is None:
        clock = record.clock(model.dt or None)
        lengths = clock.lengths if clock.rows is None else clock.lengths[clock.rows]
    else:
        clock, lengths, run = gapped.clock(), gapped.plan.seconds, gapped.plan.rows
        y, sigma = y[..., run, :], None if sigma is None else sigma[..., run, :]
    seen = ~np.isnan(y)
    samples = Sample(y if seen.all() else np.where(seen, y, 0.0), seen, u, arrived, sigma=sigma)
    u_end = np.concatenate([u[..., 1:, :], u[..., -1:, :]], axis=-2)
    intervals = Interval(u, u_end, None, np.broadcast_to(lengths.astype(float), y.shape[:-1]))
    return samples, intervals if gapped is None else gapped.intervals(intervals), clock


def unknown_arrivals(record: Record, rows: Record) -> bool:
    """Whether it is unknown of some inputs whether they arrived."""
    return record.arrived is not None and bool(np.isnan(rows.arrived).any())


def prepared(
    algorithm: Algorithm[Any],
    clock: Clock,
    complete: bool,
    fresh: Belief | tuple[Belief, ...] | None = None,
    stacked: int | None = None,
) -> Any:
    """The algorithm sampled for a record. `complete`: every output was seen, and the prior is proper. `fresh`: the belief
    after a break. `stacked`: the number of algorithms in a stack.
    """
    ready = algorithm.sampled(clock)
    ready = ready.where_all_is_seen if complete else ready
    if fresh is not None and stacked is not None:
        fresh = jax.tree_util.tree_map(lambda leaf: np.broadcast_to(leaf, (stacked, *np.shape(leaf))), fresh)
    return ready if fresh is None else restarting(ready, fresh)


def _arrivals(
    algorithm: Algorithm[Any], record: Record, rows: Record, faults: checks.Faults
) -> tuple[np.ndarray, np.ndarray]:
    """The sent inputs, and whether they arrived as far as that is known."""
    inner, name = algorithm.innermost, type(algorithm).__name__
    lost = inner.lost if isinstance(inner, RecursiveIdentifier) else "zero"
    if record.lost != lost:
        faults.add(f'`lost` of the record is "{record.lost}", that of {name} "{lost}": they must be equal.')
    return rows.u, np.ones(rows.u.shape) if rows.arrived is None else rows.arrived


def _check_kinds(algorithm: Algorithm[Any], record: Record, prior: Prior | None, faults: checks.Faults) -> None:
    check_algorithm(algorithm, faults)
    if not isinstance(record, Record):
        faults.add(f"`record` must be a Record. Got {type(record).__name__}.{_batch_hint(record)}")
    check_prior_kind(algorithm, prior, faults, _batch_hint(prior))


def check_prior_kind(algorithm: Algorithm[Any], prior: Prior | None, faults: checks.Faults, hint: str = "") -> None:
    """Check that the prior is a `Prior` for an algorithm that estimates the state, and None for one that does not."""
    if not isinstance(algorithm, Algorithm) or algorithm.has_state_prior:
        if not isinstance(prior, Prior):
            faults.add(f"`prior` must be a Prior of the state x[0]. Got {type(prior).__name__}.{hint}")
    elif prior is not None:
        name = type(algorithm).__name__
        faults.add(
            f"`prior` must be None: {name} estimates no state, and the prior of its parameters is a setting of {name}."
        )


def _batch_hint(thing: Record | Prior | Stacked | Sequence[Any] | None) -> str:
    many = isinstance(thing, Stacked | list | tuple)
    return " For several at once use estimate_bank." if many else ""


def columns(names: tuple[str, ...], given: tuple[str, ...], what: str, letter: str, faults: checks.Faults) -> list[int]:
    """Columns of the record for the model's channels: by name, or by position where either has default names only."""
    default = [channels == tuple(f"{letter}{i + 1}" for i in range(len(channels))) for channels in (names, given)]
    if all(default) and names and len(names) != len(given):
        faults.add(
            f"the model has {checks.counted(len(names), what)}, the record {len(given)}, and neither names them: name "
            f"the {what}s of both, or give the same number of columns."
        )
        return []
    return match(names, any(default), given, what, faults)


def _columns_of(array: np.ndarray, some: list[int]) -> np.ndarray:
    """Some columns; the array itself where these are all columns in order: copying a bank takes as long as its filters."""
    return array if some == list(range(array.shape[-1])) else np.take(array, some, axis=-1)


def check_prior(prior: Prior | None, model: StateSpace | NonlinearModel, faults: checks.Faults) -> None:
    """Check that the prior describes the model's states."""
    disturbance = model.disturbance if isinstance(model, StateSpace) else None
    added = 0 if disturbance is None else len(disturbance.at)
    if prior is not None and prior.mean.shape[-1] not in (model.n, model.n - added):
        without = f", or the {model.n - added} of them that are not disturbances" if added else ""
        faults.add(
            f"`prior` must describe n = {model.n} states: {model.size_source}{without}. Got {prior.mean.shape[-1]}."
        )
    elif (
        isinstance(model, StateSpace)
        and prior is not None
        and model.R is not None
        and not checks.is_traced(prior, model)
    ):
        _check_prior_size(prior, model, faults)


def _check_prior_size(prior: Prior, model: StateSpace, faults: checks.Faults) -> None:
    """A prior of which double precision leaves nothing once the outputs were seen must be diffuse instead."""
    A, C, R = (np.asarray(M)[0] if np.ndim(M) == 3 else np.asarray(M) for M in (model.A, model.C, model.R))
    noise = np.diagonal(R)
    smallest = min((r for r in noise.tolist() if r > 0), default=np.inf)
    # no entry of `later` is larger than a row sum of C, so the variances are at most n + 1 times this
    if float(prior.covariance.max(initial=0.0)) * float(np.vdot(C, C)) * (model.n + 1) <= FLATTEST * smallest:
        return
    with np.errstate(over="ignore", invalid="ignore"):
        later = np.abs(C @ A) / max(1.0, np.abs(A).sum(axis=1).max(initial=0.0))
        rows = np.maximum(np.abs(C), later)[:, : prior.mean.shape[-1]] ** 2  # disturbances may be missing in the prior
        variance = np.atleast_2d(np.diagonal(np.asarray(prior.covariance), axis1=-2, axis2=-1)) @ rows.T
        ratio = np.where(noise > 0, variance / np.where(noise > 0, noise, 1.0), 0.0)
    if ratio.max(initial=0.0) > FLATTEST:
        output = model.outputs[int(np.argmax(ratio.max(axis=0)))]
        faults.add(
            f"`prior` is too wide for double precision: it makes the variance of {output!r} {ratio.max():.1g} times its noise, "
            f"and {FLATTEST:g} times is the most. Give the unknown directions of the state as `diffuse=`, which is exact."
        )


def check_known(u: np.ndarray, names: tuple[str, ...], faults: checks.Faults) -> None:
    """Check that every input is known."""
    unknown = np.isnan(u)
    if unknown.any():
        *run, row, channel = np.argwhere(unknown)[0]
        faults.add(
            f"input {names[channel]!r} is unknown at u[{row}]{f' of run {run[0]}' if run else ''}, row {row + 1} of the "
            "record: it is NaN, or its arrival is unknown. This algorithm needs every input: fill in the input that the "
            "actuator applied, or cut the record there."
        )


def check_hold(model: StateSpace | NonlinearModel | Channels, hold: str, faults: checks.Faults) -> None:
    """Check that the record and a discrete model agree on how the input moves between samples."""
    if model.is_continuous or model.m == 0 or isinstance(model, Channels):
        return
    if hold == "first_order" and model.B_end is None:
        faults.add(
            f'the record\'s input moves between samples (hold = "first_order"), but the model is discrete (dt = {model.dt:g} s) '
            "and has no `B_end`: give the continuous model, or model.discretise(dt, hold='first_order')."
        )
    if hold == "zero_order" and model.B_end is not None:
        faults.add(
            "the model was discretised for an input that moves between samples (it has `B_end`), but the record says "
            'hold = "zero_order".'
        )


def several_of(t: np.ndarray, dt: float) -> bool:
    """Whether each step is one of `dt` or several, as where samples are missing."""
    steps = np.diff(t)
    return bool(np.all(np.abs(steps - np.maximum(np.round(steps / dt), 1) * dt) <= scatter(t, dt)))


def _check_time(model: StateSpace, record: Record, faults: checks.Faults) -> None:
    check_hold(model, record.hold, faults)
    if model.steps is not None and model.steps != len(record):
        faults.add(f"the model varies over {model.steps} rows of time, but the record has {len(record)}.")
    if model.is_continuous:
        if record.t is None and len(record) > 1:
            faults.add("the model is continuous (dt = 0), but the record has no time: give it `dt` or `t`, in seconds.")
        return
    if record.t is None or len(record) == 1:
        return
    if record.dt is None:
        steps = np.diff(record.t)
        if model.dt and isinstance(model, StateSpace) and not model.varying and several_of(record.t, model.dt):
            return
        step = "" if model.dt is None else f" with dt = {model.dt:g} s"
        faults.add(
            f"the record's steps vary from {steps.min():g} to {steps.max():g} s, but the model is discrete"
            f"{step}: give a continuous model (dt = 0), or insert rows of NaN where samples are missing."
        )
    elif model.dt is not None and abs(record.dt - model.dt) > scatter(record.t, model.dt):
        faults.add(f"the record's step is {record.dt:g} s, the model's dt = {model.dt:g} s: they must be equal.")
