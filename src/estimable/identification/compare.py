# pyright: reportUnknownArgumentType=false, reportUnknownLambdaType=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false, reportUnnecessaryIsInstance=false
"""Identification by several methods, ranked on data that none of them has seen."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from .. import checks
from ..data.record import Record, several
from ..data.trends import Trend
from ..errors import EstimableError
from ..identifiers.standing import LinearModel, standing, state_space_of
from ..models.state_space import StateSpace, between_samples
from ..protocols import FilterIdentifier, Method
from ..results import Comparison
from ..results.comparisons import Divided, Ranked
from . import adaptive, judge
from .candidates import candidates
from .connected import parts_of
from .identify import identify

LEVELS = {"mean": 0, "trend": 1, "none": None}
REFUSED = "no linear model explains this record"


class _HeldOut(NamedTuple):
    """Errors on the held-out rows (N, p): simulated and one step ahead, the outputs there, and their names."""

    simulated: np.ndarray
    one_step: np.ndarray
    y: np.ndarray
    outputs: tuple[str, ...]


def compare(
    methods: Sequence[Any] | None, record: Record | Sequence[Record], *, split: float = 0.5, level: str = "mean",
    order: int | None = None, progress: Callable[[str, int, int], None] | None = None,
) -> Comparison:  # fmt: skip
    """Identify a model by several methods on the first part of a record, or of each of several, and rank the methods on the
    rest.

    - `methods`: a list of identifiers with their settings. None: one of each kind, with orders chosen by BIC on the first
      part.
    - `split`: the fraction of each record that forms the first part.
    - `level`: what is subtracted before the fit. "mean": the means of the first part; they become the operating point of the
      model. "trend": straight lines fitted to the first part and continued; the operating point is their value at its end.
      "none": nothing, for signals that are deviations, or methods that fit an offset.
    - `order`: an order for all methods, where `methods` is None.
    - `progress(name, done, total)`: a function that is called before each method runs, and before each choice of orders.

    Ctrl-C ends the comparison. The methods that have run are then ranked, and the sentence of the result begins with those that
    have not run.

    The held-out part is simulated from the inputs alone, without its outputs; the simulation continues from the first part.
    Methods are ranked by the fit of this simulation. Two methods count as equal (`alike`) if their squared errors, compared
    segment by segment, do not differ significantly, and neither is more than twice the other. A simulation that runs away is
    `diverged`, and equal to none. A simulation explains an output if it fits more than 5 % of it, and the output depends on
    it significantly; if it explains none, `best` is None.

    Returns a `Comparison`. Raises `InputError` with every fault of the call. A method that fails is ranked last, with its
    message.

    >>> u = np.random.default_rng(0).normal(size=400)
    >>> record = simulate(OutputError([-0.5], [1.0], noise_variance=0.01, dt=1), u, seed=0).record
    >>> found = compare([LeastSquares(0, 0), OutputErrorML(1, 0)], record)
    >>> found.best.name, found.ranked[1].alike
    ('OutputErrorML', False)
    """
    records = _read(methods, record, split, level, order, progress)
    task = divided(records, split, level)
    report = (lambda name, done, total: None) if progress is None else progress
    chosen = (
        candidates(task.first, order, lambda what: report(f"choosing {what}", 0, 1))
        if methods is None
        else tuple(methods)
    )
    found, missed = [], ""
    for i, method in enumerate(chosen):
        report(type(method).__name__, i, len(chosen))
        try:
            found.append(_run(method, task))
        except KeyboardInterrupt:
            if not found:
                raise
            missed = f"Interrupted: {checks.listed([type(one).__name__ for one in chosen[i:]])} did not run. "
            break
    report("", len(chosen), len(chosen))
    ranked = _ranked(found)
    return ranked._replace(task=task, sentence=missed + ranked.sentence)


def _read(
    methods: Sequence[Method] | None,
    record: Record | Sequence[Record],
    split: float,
    level: str,
    order: int | None,
    progress: Any,
) -> list[Record]:
    faults = checks.Faults()
    records = several("record", record, faults)
    if methods is not None and (not isinstance(methods, list | tuple) or not methods):
        faults.add(f"`methods` must be a list of identifiers, or None. Got {checks.short(methods)}.")
    fraction = faults.number("split", split, above=0.0, upper=1.0)
    faults.choice("level", level, tuple(LEVELS))
    if progress is not None:
        faults.function("progress", progress, "it is called with the name of a method, the number done and the total")
    if order is not None:
        faults.whole("order", order, 1)
        if methods is not None:
            faults.add("`order` applies only where `methods` is None: give your methods their own orders.")
    faults.finish()
    assert fraction is not None
    return _divisible(parts_of(records), fraction, faults)


def _divisible(records: list[Record], fraction: float, faults: checks.Faults) -> list[Record]:
    """The parts of records with rows on both sides of the split and every output among the held-out ones."""
    parts = [
        one for one in records if 0 < (n := round(fraction * len(one))) < len(one) and one.seen[n:].any(axis=0).all()
    ]
    if parts:
        return parts
    for i, one in enumerate(records):
        if not 0 < round(fraction * len(one)) < len(one):
            faults.add(
                f"`split` must leave rows in both parts of record {i}, which has {len(one)} rows. Got {fraction:g}."
            )
        elif not one.seen[round(fraction * len(one)) :].any(axis=0).all():
            faults.add(f"record {i}: an output is not seen in the held-out part: choose another `split`.")
    faults.finish()
    return records


def divided(records: Sequence[Record], split: float, level: str) -> Divided:
    """The records without their levels, and the first part of each."""
    faults = checks.Faults()
    faults.choice("level", level, tuple(LEVELS))
    faults.finish()
    parts = [one.split(split)[0] if split < 1 else one for one in records]
    degree = LEVELS[level]
    trend = Trend.none(records[0]) if degree is None else Trend.of(parts, degree)
    deviations = [trend.taken_from(one) for one in records]
    return Divided(records, deviations, [one[: len(part)] for one, part in zip(deviations, parts, strict=True)], trend)


def _run(method: Method, task: Divided) -> Any:
    """The fit, its model in absolute units, and its errors on the held-out part; or the message that says why there is none.

    A nonlinear model describes the signals themselves: it is fitted to the first parts, the others to their deviations.
    """
    rows, whole = [len(part) for part in task.first], task.whole
    try:
        if isinstance(method, FilterIdentifier):
            whole = task.records
            fit = identify(method, [one[:n] for one, n in zip(whole, rows, strict=True)])
            model = fit.model
            stands = [adaptive.standing(method, model, one, n) for one, n in zip(whole, rows, strict=True)]
        else:
            fit = identify(method, task.first)
            model = between_samples(absolute(fit.model, task.trend.at(float(np.mean(rows)))), whole[0].hold)
            stands = [standing(state_space_of(fit.model), one, n) for one, n in zip(whole, rows, strict=True)]
    except (EstimableError, np.linalg.LinAlgError) as error:
        return method, str(error)
    held = [(s.simulated[n:], s.one_step[n:], r.y[n:]) for s, r, n in zip(stands, whole, rows, strict=True)]
    simulated, one_step, y = (np.concatenate(one) for one in zip(*held, strict=True))
    return method, fit, model, _HeldOut(simulated, one_step, y, task.records[0].outputs)


def absolute(model: LinearModel, levels: tuple[np.ndarray, np.ndarray]) -> StateSpace:
    """A model of deviations, of any kind, as a model of the signals: the levels are inputs (m,) and outputs (p,)."""
    model = state_space_of(model)
    own = 0.0 if model.operating_point is None else model.operating_point.outputs
    return StateSpace(
        model.A, model.B, model.C, model.D, Q=model.Q, R=model.R, G=model.G, S=model.S, dt=model.dt, inputs=model.inputs,
        outputs=model.outputs, operating_point={"states": np.zeros(model.n), "inputs": levels[0], "outputs": levels[1] + own},
    )  # fmt: skip


def _ranked(found: list[Any]) -> Comparison:
    none = np.array([-np.inf])
    fitted = [one for one in found if len(one) > 2]
    failed = [Ranked(method, None, None, none, none, failure=why) for method, why in (f for f in found if len(f) == 2)]
    if not fitted:
        return Comparison(tuple(failed), None, f"{REFUSED}: no method could be fitted to it.")
    fits = [judge.fit_percent(held.simulated, held.y) for *_, held in fitted]
    order = sorted(range(len(fitted)), key=lambda i: -float(np.mean(fits[i])))
    first = fitted[order[0]][3]
    ranked = []
    for i in order:
        method, fit, model, held = fitted[i]
        steps = judge.fit_percent(held.one_step, held.y)
        t, ratio = judge.behind(held.simulated, first.simulated, first.y)
        ranked.append(
            Ranked(method, fit, model, fits[i], steps, t, ratio=ratio, diverged=judge.diverged(held.simulated, held.y))
        )
    return _judged(ranked, failed, first)


def _judged(ranked: list[Ranked], failed: list[Ranked], first: _HeldOut) -> Comparison:
    """The best method, if its simulation explains an output."""
    best, everything = ranked[0], (*ranked, *failed)
    explained = judge.explained(first.simulated, first.y)
    if not explained.any():
        why = f"the best simulation ({best.name}) fits {best.shown_fit} of the held-out outputs"
        return Comparison(everything, None, f"{REFUSED}: {why}, which chance or a level fits as well.")
    others = [one.label for one in ranked[1:] if one.alike]
    doubt = f" Not significantly worse: {', '.join(others)}." if others else " All others are significantly worse."
    result = f"{best.label} of order {best.order} fits best: {best.shown_fit} of the held-out rows."
    names = first.outputs
    not_explained = [names[i] for i in np.flatnonzero(~explained)]
    rest = f" It does not explain {checks.listed(not_explained)}." if not_explained else ""
    return Comparison(everything, best, result + doubt + rest)
