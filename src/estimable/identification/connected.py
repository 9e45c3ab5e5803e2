"""Records as batch identifiers need them: on a grid, cut where nothing connects, with estimates of unknown inputs."""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from .. import checks
from ..data.record import Record
from ..frozen import field_names, replace
from ..identifiers.output_error_ml import OutputErrorML, at_stamps, nominal_step
from ..identifiers.subspace import Subspace
from ..kernels.missing_series import conditional, runs_of
from ..models.state_space import StateSpace, between_samples
from ..protocols import Identifier, Method
from ..results import Check, Fit

LONG = 10  # rows of an unknown input, after which a record is cut: a new state is less to estimate
GAP = 100  # missing rows at which a record is cut before they are inserted
JITTER = 0.1  # of the residuals' standard deviation: scatter of stamps below it changes nothing
SHORTEST = 4  # rows of a part
MISSING = 1.5  # times the median: a step in which rows are missing


class Connected(NamedTuple):
    """A method and the records it can be fitted to, and what was done to them."""

    method: Method
    records: list[Record]
    checks: tuple[Check, ...]


def connected(method: Method, records: Sequence[Record]) -> Connected:
    """The records on a grid, cut at breaks and where an input is unknown for long; for a batch identifier that needs every input
    the other unknown ones are estimated. With first-order hold a method with a delay gets the direct term. Stamps that are
    multiples of no step stay as they are, for `OutputErrorML`."""
    try:
        found, why = [one for record in records for one in gridded(record)], ""
    except checks.InputError as error:
        found, why = [], str(error)
    if why:
        if not isinstance(method, OutputErrorML) or max(map(len, records)) < SHORTEST:
            checks.refuse(f"{why} OutputErrorML can be fitted to the stamps themselves.")
        return stamped(method, records)
    same = len(found) == len(records) and all(a is b for a, b in zip(found, records, strict=True))
    done = [] if same else [_grid_check(records, found)]
    if isinstance(method, Identifier):
        parts = [part for record in found for part in cut(record)]
        if len(parts) > len(records):
            method, said = _from_any_state(method), f"Parts: nothing connects across {_cuts(records, parts)}"
            done.append(Check("parts", True, len(parts), np.inf, f"{said}: {len(parts)} parts are fitted together."))
        found = parts
        if not method.takes_unknown_inputs:
            found, estimated = known(found)
            done += estimated
    method, direct = with_direct_term(method, found)
    return Connected(method, found, (*done, *direct))


def stamped(method: OutputErrorML, records: Sequence[Record]) -> Connected:
    """Records with their stamps, cut at breaks and wherever an input was not logged, and a check that says so."""
    parts = [part for one in records for part in cut(one, 0)]
    parts = [replace(part, dt=None) for part in parts if len(part) >= SHORTEST] or list(records)
    step = nominal_step(parts)
    scatter = float(np.std(np.concatenate([np.diff(one.t) for one in parts]))) / step
    sentence = (
        "Stamps: they scatter about every grid, and the model is fitted to them as they are: its coefficients are those for "
        f"steps of {step:.6g} s, from which the steps differ by {scatter:.2g} (rms, of a step)."
    )
    anywhere = _from_any_state(method) if len(parts) > len(records) else method
    return Connected(anywhere, parts, (Check("stamps", True, scatter, np.inf, sentence),))


def at_own_stamps(method: Method, records: Sequence[Record], fit: Fit) -> Connected | None:
    """The records with the stamps that a grid moved too far for a fit, cut where rows are missing between different inputs; None
    where the grid did no harm, or the method cannot be fitted to stamps."""
    checked = () if fit.validation is None else fit.validation.checks
    if not isinstance(method, OutputErrorML) or all(one.passed for one in checked if one.name == "stamps"):
        return None
    apart = []
    for one in records:
        long = np.diff(one.t) > MISSING * np.median(np.diff(one.t))
        moved = np.any(one.u[1:] != one.u[:-1], axis=1)
        apart.append(replace(one, breaks=tuple(sorted({*one.breaks, *(np.flatnonzero(long & moved) + 1).tolist()}))))
    done = stamped(method, apart)
    try:
        done.method.check(done.records)  # type: ignore[attr-defined]
    except checks.InputError:
        return None
    return done


def parts_of(records: Sequence[Record]) -> list[Record]:
    """The parts of records, on a grid, whose rows connect."""
    return [part for one in records for grid in gridded(one) for part in cut(grid)]


def gridded(record: Record) -> list[Record]:
    """The record with a row for each multiple of its step, in parts where very many are missing."""
    if record.dt is not None or record.t is None or len(record) < 3:
        return [record]
    step = float(np.median(np.diff(record.t)))
    far = np.flatnonzero(np.diff(record.t) > GAP * step) + 1
    if not len(far):
        return [record.on_grid()]
    parts = replace(record, breaks=tuple(sorted({*record.breaks, *far.tolist()}))).parts
    longest = max(parts, key=len).on_grid().dt
    return [part.on_grid(longest) if len(part) > 1 else replace(part, dt=longest) for part in parts]


def cut(record: Record, longest: int = LONG) -> list[Record]:
    """The parts of a record between its breaks and the runs of more than `longest` rows in which an input was not logged."""
    unknown = np.isnan(record.u).any(axis=1)
    long = [run for run in runs_of(unknown) if run[1] - run[0] > longest]
    if not long and not record.breaks:
        return [record]
    outside = np.ones(len(record), bool)
    for first, stop in long:
        outside[first:stop] = False
    edges = sorted({*record.breaks, *(edge for run in long for edge in run), 0, len(record)})
    parts = [record[a:b] for a, b in pairwise(edges) if outside[a]]
    return [part for part in parts if len(part) >= SHORTEST and part.seen.any()] or [record]


def known(records: Sequence[Record]) -> tuple[list[Record], list[Check]]:
    """The records with estimates of the inputs that were not logged, and a check that says how accurate those are."""
    unknown = [np.isnan(one.u) for one in records]
    count = int(sum(mask.sum() for mask in unknown))
    if not count or np.any(np.isnan(np.concatenate([one.u for one in records])).all(axis=0)):
        return list(records), []
    filled, variances = [], []
    for one, mask in zip(records, unknown, strict=True):
        if not mask.any() or mask.all(axis=0).any():
            filled.append(one)
            continue
        mean, variance = (np.stack(column, axis=1) for column in zip(*map(conditional, one.u.T), strict=True))
        filled.append(replace(one, u=mean))
        variances.append(variance[mask])
    spread = float(np.nanstd(np.concatenate([one.u for one in records])))
    error = float(np.sqrt(np.mean(np.concatenate(variances)))) if variances else 0.0
    every = sum(mask.size for mask in unknown)
    share = count / every
    sentence = (
        f"Inputs: {count} of {every} were not logged and are estimated from their neighbours, with an error of "
        f" {error:.3g} (rms, of a spread of {spread:.3g}). OutputErrorML counts that error."
    )
    return filled, [Check("inputs", share < 0.05, share, 0.05, sentence)]


def with_direct_term(method: Method, records: Sequence[Record]) -> tuple[Method, list[Check]]:
    """With first-order hold u[k] enters y[k]: a delay of d steps is one of d - 1 with one more coefficient."""
    if not records or records[0].hold != "first_order":
        return method, []
    fields = field_names(type(method))
    if isinstance(method, Subspace) and not method.feedthrough:
        sentence = (
            "Hold: the input moves linearly between samples, so that u[k] enters y[k]: feedthrough was set to True."
        )
        return replace(method, feedthrough=True), [Check("hold", True, 1.0, 0.0, sentence)]
    if not {"nb", "delay"} <= set(fields) or not (delay := int(method.delay)):  # type: ignore[attr-defined]
        return method, []
    nb = int(method.nb) + 1  # type: ignore[attr-defined]
    if "prior" in fields and method.prior is not None:  # type: ignore[attr-defined]
        sentence = (
            f"Hold: the input moves linearly between samples, so that u[k] enters y[k], but `prior` has no number for that: give "
            f"delay = {delay - 1}, nb = {nb} and a prior with one more coefficient of each input."
        )
        return method, [Check("hold", False, float(delay), 0.0, sentence)]
    sentence = (
        f"Hold: the input moves linearly between samples, so that a delay of {delay} {'step' if delay == 1 else 'steps'} begins "
        f"within the step before: the model has delay {delay - 1} and nb = {nb}."
    )
    return replace(method, nb=nb, delay=delay - 1), [Check("hold", True, float(delay - 1), float(delay), sentence)]


def with_checks(fit: Fit, done: Connected) -> Fit:
    """The fit with the checks of its records, and of the scatter of their stamps against the residuals."""
    found = [*done.checks]
    if isinstance(fit.model, StateSpace) and not fit.model.is_continuous:
        fit = replace(fit, model=between_samples(fit.model, done.records[0].hold))
    if fit.validation is None:
        return fit
    scatter = _jitter_check(fit, done.records)
    found += [scatter] if scatter is not None else []
    found += _real_checks(fit, done.records)
    return replace(fit, validation=fit.validation._replace(checks=(*fit.validation.checks, *found))) if found else fit


def _real_checks(fit: Fit, records: Sequence[Record]) -> list[Check]:
    """A failed check where a model that was fitted to stamps has a pole that no continuous system has."""
    if not at_stamps(records):
        return []
    poles = [complex(pole) for one in fit.model.poles for pole in one]
    negative = [pole.real for pole in poles if abs(pole.imag) < 1e-9 and pole.real <= 0]
    if not negative:
        return []
    sentence = f"Stamps: no continuous system of this order has the pole {negative[0]:.3g} of the fit: change na."
    return [Check("stamps", False, negative[0], 0.0, sentence)]


def _jitter_check(fit: Fit, records: Sequence[Record]) -> Check | None:
    """Whether the scatter of the stamps moves an output by less than a tenth of its residuals."""
    moved = [np.array([dict(one.placing).get(name, 0.0) for name in one.outputs]) for one in records]
    if not moved or not np.max(moved) > 0:
        return None
    with np.errstate(all="ignore"):
        residual = np.nanstd(np.concatenate([np.asarray(one) for one in fit.validation.residuals]), axis=0)
        ratio = float(np.nanmax(np.max(moved, axis=0) / np.where(residual > 0, residual, np.inf)))
    found = f"Stamps: their scatter moves the outputs by at most {ratio:.2g} of the residuals (limit {JITTER:g})"
    advice = (
        "" if ratio <= JITTER else ": standard deviations are too small; fit OutputErrorML, to the stamps themselves"
    )
    return Check("stamps", ratio <= JITTER, ratio, JITTER, f"{found}{advice}.")


def _from_any_state(method: Identifier) -> Identifier:
    """The plant is not at rest where a part begins."""
    return replace(method, initial="free") if isinstance(method, OutputErrorML) else method


def _grid_check(records: Sequence[Record], found: Sequence[Record]) -> Check:
    missing = sum(map(len, found)) - sum(map(len, records))
    unknown = int(sum(np.isnan(one.u).any(axis=1).sum() for one in found))
    sentence = f"Rows: {missing} are missing on a grid of {found[0].dt:.6g} s; the input is unknown in {unknown} rows."
    return Check("rows", True, float(missing), np.inf, sentence)


def _cuts(records: Sequence[Record], parts: Sequence[Record]) -> str:
    count = len(parts) - len(records)
    return f"{count} {'place' if count == 1 else 'places'} (breaks, or inputs unknown for more than {LONG} rows)"
