"""The report of an identification."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .. import checks, diagnostics
from ..analysis.excitation import excitation
from ..data.record import Record
from ..data.trends import Trend
from ..frozen import replace
from ..identifiers.residuals import residual_checks
from ..identifiers.standing import standing, state_space_of
from ..models.nonlinear_model import NonlinearModel
from ..models.output_error import OutputError
from ..results import Check, Comparison, Fit, Ranked
from ..results.comparisons import shown
from ..results.order_selection import OrderSelection
from .assumptions import model_items, record_items
from .charts import thinned
from .contents import Fact, Finding, Report, Section
from .estimate_page import versions
from .identification_charts import excitation_chart, model_charts, order_charts, residual_charts, simulation_charts

MOST_PARAMETERS = 40


def report_of_comparison(
    found: Comparison, record: Record, *, chosen: Ranked | None = None, selection: OrderSelection | None = None,
    title: str = "Identification", lead: Sequence[str] = (), commands: Sequence[tuple[str, str]] = (), files: Sequence[Path] = (),
) -> Report:  # fmt: skip
    """Make a report of one method in a `Comparison` of one `record`: held-out data, orders, residuals, poles and responses.

    - `chosen`: the method, one of `found.ranked`. None: `found.predictor`, or the first method.
    - `selection`: an `OrderSelection`, whose criteria the report shows.
    - `lead`, `commands` and `files`: as in `report_of`.

    Equal arguments give equal reports, byte for byte. Raises `InputError` if no method could be fitted, or if several records
    were compared.

    >>> u = np.random.default_rng(0).normal(size=200)
    >>> record = simulate(OutputError([-0.5], [1.0], noise_variance=0.01, dt=1), u, seed=0).record
    >>> page = report.report_of_comparison(compare([OutputErrorML(1, 0)], record), record)
    >>> page.charts[0].part
    'Does the model simulate held-out data?'
    """
    chosen = chosen or found.predictor or found.ranked[0]
    if chosen.fit is None or found.task is None:
        checks.refuse("no method could be fitted, so there is nothing to report: see `found.sentence`.")
    if isinstance(chosen.model, NonlinearModel):
        checks.refuse(
            f"a report needs a linear model, and {chosen.name} makes a nonlinear one. Choose another method by `chosen`."
        )
    if len(found.task.whole) != 1:
        checks.refuse("a report needs a comparison on one record: compare on each record separately.")
    times = np.arange(len(record)) * float(record.dt or 1.0) if record.t is None else np.asarray(record.t)
    charts, verdicts = _held_out(found, chosen, record, times)
    orders = [] if selection is None else order_charts(selection, chosen.order_of_a_model)
    explained = found.best is not None
    return Report(
        title, tuple(lead) or (found.verdict, found.sentence), tuple(_facts(chosen, record)), times[thinned(len(record))],
        "time [s]",
        tuple([
            *charts[0], *orders, *_excited(found, chosen, times), *charts[1],
            *(model_charts(chosen.fit) if explained else []),
        ]), tuple(verdicts),
        (*_sections(chosen, record), versions("", files)), tuple(commands), (_methods(found),),
    )  # fmt: skip


def _excited(found: Comparison, chosen: Ranked, times: np.ndarray) -> list[Any]:
    """The information about the parameters up to each time; only for output-error models with noise, for which it is finite."""
    assert found.task is not None
    assert chosen.fit is not None
    model, whole = chosen.fit.model, found.task.whole[0]
    inputs = np.asarray(whole.applied())
    if not isinstance(model, OutputError) or np.isnan(inputs).any() or not model.is_stable:
        return []
    if not np.all(np.asarray(model.noise_variance) > 0):
        return []
    return [excitation_chart(excitation(model, whole), times)]


def _held_out(found: Comparison, chosen: Ranked, record: Record, times: np.ndarray) -> Any:
    """The diagrams of the simulation and of the residuals, and their verdicts, over the held-out part."""
    assert found.task is not None
    assert chosen.fit is not None
    whole, first = found.task.whole[0], found.task.rows[0]
    stand = standing(state_space_of(chosen.fit.model), whole, first)
    line = Trend.of([replace(record, y=record.y - whole.y)], 1).outputs
    level = line[0] + np.arange(len(record))[:, None] * line[1]
    sigma = np.hypot(np.nan_to_num(diagnostics.simulation_sigma(chosen.fit, whole.u, stand.state)), _noise(chosen.fit))
    simulated = simulation_charts(
        record.outputs, record.y, stand.outputs + level, sigma, [float(fit) for fit in chosen.fits], float(times[first])
    )
    e, u = stand.standardised[first:], whole.u[first:]
    direct = bool(np.any(chosen.model.D))
    judged = [
        Finding(_name(check), check.sentence, bool(check.passed))
        for check in residual_checks([e], [whole[first:]], direct=direct)
    ]
    own = [Finding(_name(check), check.sentence, bool(check.passed)) for check in _own(chosen.fit)]
    return (simulated, residual_charts(e, u, record.outputs, record.inputs, direct=direct)), [*judged, *own]


def _noise(fit: Fit) -> np.ndarray:
    """The standard deviation (p,) of what the simulation leaves of the fitted outputs."""
    return np.sqrt(np.nanmean(np.concatenate(fit.validation.residuals) ** 2, axis=0))


def _own(fit: Fit) -> list[Any]:
    """The checks of the fit itself, without those that were made on held-out data."""
    return [check for check in fit.validation.checks if check.name not in ("whiteness", "input-left")]


def _name(check: Check) -> str:
    return check.name.replace("-", " ").capitalize()


def _facts(chosen: Ranked, record: Record) -> Any:
    yield Fact("Method", chosen.label, f"order {chosen.order}")
    yield Fact("Simulation", shown(float(np.mean(chosen.fits))), "of the held-out part, from the inputs alone")
    yield Fact("One step ahead", shown(float(np.mean(chosen.one_step_fits))), "of the held-out part")
    missing = 1 - float(record.seen.mean())
    yield Fact(
        "Samples", f"{len(record):,}", f"every {record.dt:g} s" + (f", {missing:.0%} not seen" if missing else "")
    )


def _methods(found: Comparison) -> Section:
    """Each compared method, on one line."""
    items = []
    for one in found.ranked:
        if one.fit is None:
            items.append((one.name, one.failure))
            continue
        fits = f"{one.shown_fit} by simulation, {shown(float(np.mean(one.one_step_fits)))} one step ahead"
        alike = (
            "the best"
            if one.behind == 0
            else "equal to the best within the noise"
            if one.alike
            else "significantly worse"
        )
        items.append((f"{one.label}, order {one.order}", f"{fits}: {alike}"))
    return Section("Methods compared on the held-out part", tuple(items))


def _sections(chosen: Ranked, record: Record) -> tuple[Section, ...]:
    from ..catalogue import IDENTIFIERS

    assert chosen.fit is not None
    assert chosen.model is not None
    entry = next((entry for entry in IDENTIFIERS if type(chosen.method) is entry.cls), None)
    assumes = "" if entry is None else f"Assumes that {entry.assumes}. Reference: {entry.reference}. "
    fields = {name: getattr(chosen.method, name) for name in type(chosen.method).__dataclass_fields__ if name != "_"}
    settings = ", ".join(f"{name} = {value}" for name, value in fields.items() if isinstance(value, bool | int | str))
    method = Section("Method", ((chosen.name, f"{assumes}Settings: {settings}."),))
    record_section = Section("Record", tuple(record_items(record)))
    return (method, record_section, _parameters(chosen.fit), Section("Model", tuple(model_items(chosen.model))))


def _parameters(fit: Fit) -> Section:
    """The parameters with two standard deviations; at most `MOST_PARAMETERS`."""
    items = []
    for name, value, sigma in list(zip(fit.names, fit.parameters, fit.sigma, strict=True))[:MOST_PARAMETERS]:
        spread = "" if np.isnan(sigma) else f" ± {2 * sigma:.2g} (2 sigma)"
        items.append((name, "not known" if np.isinf(sigma) else f"{value:.5g}{spread}"))
    more = len(fit.names) - len(items)
    return Section("Parameters", (*items, *([("", f"and {more} more")] if more else [])))
