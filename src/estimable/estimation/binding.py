"""An algorithm, a record and a prior prepared for an engine: matched by name, checked together, sampled."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from .. import checks
from ..data.messy import without_wild
from ..data.record import Record, match
from ..data.record_arguments import scatter
from ..filters.wrapped import check_algorithm
from ..identifiers.channels import Channels
from ..models.nonlinear_model import NonlinearModel
from ..models.prior import Prior
from ..models.sampled import Clock
from ..models.state_space import StateSpace
from ..protocols import Algorithm, RecursiveIdentifier
from ..results import Info, Interval, Names, Sample, Stacked
from .following import along_record
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
    model, names, rows = model_of(algorithm), algorithm.names, bank or record
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
    faults.finish()
    u, arrived = (
        _arrivals(algorithm, record, rows, faults) if algorithm.takes_unknown_arrivals else (rows.applied(), None)
    )
    u, arrived = _columns_of(u, inputs), None if arrived is None else _columns_of(arrived, inputs)
    check_known(u, names.inputs, faults)
    faults.finish()
    if isinstance(model, NonlinearModel) and prior is not None:
        model.check_at(prior.mean, u[(0,) * (u.ndim - 1)], faults)
        faults.finish()
    warn_of_placing(model, tuple(record.outputs[i] for i in outputs), record)
    clock = record.clock(model.dt or None)
    lengths = clock.lengths if clock.rows is None else clock.lengths[clock.rows]
    y = without_wild(_columns_of(rows.y, outputs), names.outputs)
    seen = ~np.isnan(y)
    samples = Sample(y if seen.all() else np.where(seen, y, 0.0), seen, u, arrived)
    u_end = np.concatenate([u[..., 1:, :], u[..., -1:, :]], axis=-2)
    intervals = Interval(u, u_end, None, np.broadcast_to(lengths.astype(float), y.shape[:-1]))
    complete = prior is not None and prior.diffuse is None and bool(samples.seen.all())
    ready = prepared(algorithms or algorithm, clock, complete)
    names = names._replace(units=record.units, **ready.result_names)
    return Bound(ready, samples, intervals, names, rows.t, clock, complete)


def prepared(algorithm: Algorithm[Any], clock: Clock, complete: bool) -> Any:
    """The algorithm sampled for a record. `complete`: every output was seen, and the prior is proper."""
    ready = algorithm.sampled(clock)
    return ready.where_all_is_seen if complete else ready


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
    disturbance = getattr(model, "disturbance", None)
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
    smallest = noise[noise > 0].min(initial=np.inf)
    with np.errstate(over="ignore", invalid="ignore"):
        # no entry of `later` is larger than a row sum of C, so the variances are at most n + 1 times this
        if np.abs(prior.covariance).max(initial=0.0) * np.vdot(C, C) * (model.n + 1) <= FLATTEST * smallest:
            return
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
        step = "" if model.dt is None else f" with dt = {model.dt:g} s"
        faults.add(
            f"the record's steps vary from {steps.min():g} to {steps.max():g} s, but the model is discrete"
            f"{step}: give a continuous model (dt = 0), or insert rows of NaN where samples are missing."
        )
    elif model.dt is not None and abs(record.dt - model.dt) > scatter(record.t, model.dt):
        faults.add(f"the record's step is {record.dt:g} s, the model's dt = {model.dt:g} s: they must be equal.")
