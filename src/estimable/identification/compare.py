# pyright: reportUnknownArgumentType=false, reportUnknownLambdaType=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false, reportUnnecessaryIsInstance=false
"""Identification by several methods, ranked on data that none of them has seen."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from .. import checks
from ..data.record import Record, several
from ..diagnostics.feedback import feedback as feedback_of
from ..errors import EstimableError
from ..identifiers.output_error_ml import OutputErrorML
from ..identifiers.standing import LinearModel, standing, state_space_of
from ..models.state_space import StateSpace, between_samples
from ..protocols import FilterIdentifier, Method
from ..results import Comparison
from ..results.comparisons import Divided
from . import adaptive
from .candidates import candidates
from .connected import known, parts_of
from .dead_time import dead_time
from .held_out import LEVELS, divided, with_held_out, with_levels
from .identify import Records, fitted
from .loops import INSTEAD
from .ranking import Before, FailedMethod, FittedMethod, errors_of, ranked

FEEDBACK = ("tested", "accepted", "closed")
SPLIT = 0.5
Progress = Callable[[str, int, int], None]


def compare(
    methods: Sequence[Any] | None, record: Records, *, split: float = SPLIT, level: str = "mean", order: int | None = None,
    held_out: Records | None = None, feedback: str = "tested", progress: Progress | None = None,
) -> Comparison:  # fmt: skip
    """Identify a model by several methods on the first part of a record, or of each of several, and rank the methods on the
    rest; or on other records.

    - `methods`: a list of identifiers with their settings. None: one of each kind, with orders chosen by BIC on what is fitted.
    - `split`: the fraction of each record that forms the first part.
    - `level`: what is subtracted before the fit. "mean": the means of the first part; they become the operating point of the
      model. "trend": straight lines fitted to the first part and continued; the operating point is their value at its end.
      "none": nothing, for signals that are deviations, or methods that fit an offset.
    - `order`: an order for all methods, where `methods` is None.
    - `held_out`: other records, on which the methods are judged instead. They are then fitted to the whole of `record`, and
      each held-out record loses its own level. Its first tenth gives its state and is not judged.
    - `feedback`: "tested": if the inputs depend on the noise of the outputs (`diagnostics.feedback`), methods that feedback
      biases are refused. "accepted": they run all the same. "closed": as if feedback had been found.
    - `progress(name, done, total)`: a function that is called before each method runs, and before each choice of orders.

    Ctrl-C ends the comparison. The methods that have run are then ranked, and the sentence of the result begins with those that
    have not run.

    The held-out part is simulated from the inputs alone, without its outputs; the simulation continues from the first part.
    Methods are ranked by the fit of this simulation. In a closed loop, and without inputs, they are ranked by their
    predictions one step ahead. Two methods count as equal (`alike`) if their squared errors, compared segment by segment, do
    not differ significantly, and neither is more than twice the other. A simulation that runs away is `diverged`, and equal to
    none. A simulation explains an output if it fits more than 5 % of it, and the output depends on it significantly; if it
    explains none, `best` is None. The sentence begins with a warning if the inputs of the held-out part move at other
    frequencies than those of the first, as in the two halves of one sweep: the fit then says little.

    Returns a `Comparison`. Raises `InputError` with every fault of the call. A method that fails is ranked last, with its
    message.

    >>> u = np.random.default_rng(0).normal(size=400)
    >>> record = simulate(OutputError([-0.5], [1.0], noise_variance=0.01, dt=1), u, seed=0).record
    >>> found = compare([LeastSquares(0, 0), OutputErrorML(1, 0)], record)
    >>> found.best.name, found.ranked[1].alike
    ('OutputErrorML', False)
    """
    records, others = _read(methods, record, held_out, split, level, order, feedback, progress)
    task = divided(records, split, level) if others is None else with_held_out(records, others, level)
    report = (lambda name, done, total: None) if progress is None else progress
    before = _before(task, feedback, report)
    chosen = (
        candidates(task, before, order, lambda what: report(f"choosing {what}", 0, 1))
        if methods is None
        else tuple(methods)
    )
    found, missed = [], ""
    for i, method in enumerate(chosen):
        report(type(method).__name__, i, len(chosen))
        try:
            found.append(_run(method, task, refuse=before.closed and feedback != "accepted"))
        except KeyboardInterrupt:
            if not found:
                raise
            missed = f"Interrupted: {checks.listed([type(one).__name__ for one in chosen[i:]])} did not run. "
            break
    report("", len(chosen), len(chosen))
    result = ranked(found, task, before)
    return result._replace(sentence=missed + result.sentence)


def _read(
    methods: Sequence[Method] | None, record: Records, held_out: Records | None, split: float, level: str, order: int | None,
    feedback: str, progress: Progress | None,
) -> tuple[list[Record], list[Record] | None]:  # fmt: skip
    """The records to fit, or to divide, and those to judge on; every fault of the call at once."""
    faults = checks.Faults()
    records = several("record", record, faults)
    others = None if held_out is None else several("held_out", held_out, faults)
    if methods is not None and (not isinstance(methods, list | tuple) or not methods):
        faults.add(f"`methods` must be a list of identifiers, or None. Got {checks.short(methods)}.")
    if records and len(unknown := [name for name, u in _inputs_of(records) if np.isnan(u).all()]):
        faults.add(f"input {checks.listed(unknown)} was never logged: leave it out.")
    fraction = faults.number("split", split, above=0.0, upper=1.0)
    if held_out is not None and split != SPLIT:
        faults.add("`split` divides a record, but with `held_out` whole records are fitted: leave one of them out.")
    faults.choice("level", level, tuple(LEVELS))
    faults.choice("feedback", feedback, FEEDBACK)
    if progress is not None:
        faults.function("progress", progress, "it is called with the name of a method, the number done and the total")
    if order is not None:
        faults.whole("order", order, 1)
        if methods is not None:
            faults.add("`order` applies only where `methods` is None: give your methods their own orders.")
    if records and others:
        _check_others(records, others, faults)
    faults.finish()
    assert fraction is not None
    return (parts_of(records), parts_of(others)) if others else (_divisible(parts_of(records), fraction, faults), None)


def _check_others(records: list[Record], others: list[Record], faults: checks.Faults) -> None:
    """Check that held-out records have the channels of those that are fitted, and are other records."""
    first = records[0]
    for i, one in enumerate(others):
        if (one.inputs, one.outputs) != (first.inputs, first.outputs):
            faults.add(
                f"record {i} of `held_out` must have the inputs {checks.listed(first.inputs)} and outputs "
                f"{checks.listed(first.outputs)} of `record`. Got {checks.listed(one.inputs)} and {checks.listed(one.outputs)}."
            )
        if any(np.array_equal(one.y, other.y, equal_nan=True) for other in records):
            faults.add(
                f"record {i} of `held_out` is also in `record`: judge a model on a record that it was not fitted to."
            )


def _inputs_of(records: Sequence[Record]) -> list[tuple[str, np.ndarray]]:
    """Each input of all records together; none where the records have different channels."""
    if len({one.inputs for one in records}) > 1:
        return []
    return list(zip(records[0].inputs, np.concatenate([one.u for one in records]).T, strict=True))


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


def _before(task: Divided, asked: str, report: Progress) -> Before:
    """The test of feedback and the dead time, of the fitted parts; neither without inputs."""
    if not task.first[0].inputs:
        return Before(None, False, None)
    report("choosing the dead time", 0, 1)
    logged = list(known(task.first)[0])
    seen = feedback_of(logged, direct=False if asked == "closed" else None)
    try:
        late = dead_time(logged)
    except (EstimableError, np.linalg.LinAlgError):
        late = None
    return Before(seen, asked == "closed" or seen.closed, late)


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def _run(method: Method, task: Divided, *, refuse: bool) -> FittedMethod | FailedMethod:
    """The fit, its model in absolute units, and its errors on the held-out part; or the message that says why there is none.

    A nonlinear model describes the signals themselves, and so does a fit that estimates their levels; the others are fitted to
    their deviations.
    """
    if refuse and method.in_a_loop != "holds":
        return FailedMethod(
            method,
            f'the record was made in a closed loop, where this method may be biased: {INSTEAD}, or feedback="accepted".',
        )
    about = task.trend.at(float(np.mean([len(part) for part in task.first])))
    if isinstance(method, OutputErrorML) and method.level != "none":
        task = with_levels(task)
    rows, whole = task.rows, task.whole
    try:
        if isinstance(method, FilterIdentifier):
            whole = task.records
            fit, _ = fitted(method, [one[: len(part)] for one, part in zip(whole, task.first, strict=True)])
            model = fit.model
            stands = [adaptive.standing(method, model, one, n) for one, n in zip(whole, rows, strict=True)]
        else:
            fit, _ = fitted(method, task.first)
            at = about if task.trend.outputs.any() else steady(fit.model, about)
            model = between_samples(absolute(fit.model, at), whole[0].hold)
            stands = [standing(state_space_of(fit.model), one, n) for one, n in zip(whole, rows, strict=True)]
    except (EstimableError, np.linalg.LinAlgError) as error:
        return FailedMethod(method, str(error))
    return FittedMethod(method, fit, model, errors_of(stands, whole, rows))


def steady(model: LinearModel, about: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """The inputs of an operating point, and what they add to the outputs of a model of the signals themselves; zero for one that
    has no steady state."""
    plant = state_space_of(model)
    if np.abs(np.linalg.eigvals(plant.A)).max(initial=0.0) >= 1:
        return np.zeros(plant.m), np.zeros(plant.p)
    gain = plant.D + plant.C @ np.linalg.solve(np.eye(plant.n) - plant.A, plant.B)
    return about[0], gain @ about[0]


def absolute(model: LinearModel, levels: tuple[np.ndarray, np.ndarray]) -> StateSpace:
    """A model of deviations, of any kind, as a model of the signals: the levels are inputs (m,) and outputs (p,)."""
    model = state_space_of(model)
    own = 0.0 if model.operating_point is None else model.operating_point.outputs
    return StateSpace(
        model.A, model.B, model.C, model.D, Q=model.Q, R=model.R, G=model.G, S=model.S, dt=model.dt, inputs=model.inputs,
        outputs=model.outputs, operating_point={"states": np.zeros(model.n), "inputs": levels[0], "outputs": levels[1] + own},
    )  # fmt: skip
