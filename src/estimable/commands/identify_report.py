"""What `estimable identify` does and prints for one method."""

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from .. import checks
from ..data.record import Record
from ..errors import InputError
from ..models.state_space import StateSpace
from ..phrases import decimals
from ..protocols import Method
from ..results import Fit
from .identify_files import Asked, WrittenFiles, write_model_file, write_page
from .numbers import counted
from .settings import read_settings

if TYPE_CHECKING:
    from ..catalogue import Entry

RECURSIVE = ("joint-output-error", "recursive-output-error")  # they need the noise variance


class Identified(NamedTuple):
    """A fit, how it was made, the message on the chosen orders (None if given), and the files that were written."""

    asked: Asked
    record: Record
    method: str
    settings: dict[str, Any]
    chosen: str | None
    fit: Fit
    written: WrittenFiles


def identified(asked: Asked, name: str, *, settings: Iterable[str], order: int | None) -> Identified:
    """Read the record, choose what was not given, identify, and write the model and the page.

    Raises `InputError` for faults of the record, the method or its settings.
    """
    from .. import catalogue
    from ..identification.held_out import divided
    from ..identification.identify import identify

    entry = catalogue.identifier(name)
    given = read_settings(settings)
    record = read(asked.path, asked.outputs, asked.inputs, asked.reading)
    level = asked.level or "none"
    whole = record if level == "none" else divided([record], 1.0, level).whole[0]
    chosen = _choose(entry, whole, given, order)
    method = _made(entry, given)
    fit = identify(method, whole)
    written = _write(asked, record, method, fit, level)
    return Identified(asked, record, name, given, chosen, fit, written)


def _choose(entry: "Entry", record: Record, given: dict[str, Any], order: int | None) -> str | None:
    """Choose the settings that were not given; returns the message on the orders, None if they were given."""
    fields, chosen = entry.cls.__dataclass_fields__, None
    if "order" in fields and "order" not in given:
        chosen = _chosen_order(record, given, order)
    elif "na" in fields:
        given |= {} if order is None else {"na": order, "nb": given.get("nb", order - 1)}
        chosen = _chosen_orders(record, given) if not {"na", "nb"} <= given.keys() else None
    if "noise_variance" in fields and "noise_variance" not in given and entry.name in RECURSIVE:
        given["noise_variance"] = _noise(record, given)
    return chosen


def _made(entry: "Entry", given: dict[str, Any]) -> Any:
    """The method with its settings; settings without a default are passed by position."""
    fields = [field for field in entry.cls.__dataclass_fields__ if field != "_"]
    places = [given[name] for name in fields if name in ("na", "nb", "order", "length") and name in given]
    rest = {name: value for name, value in given.items() if name not in ("na", "nb", "order", "length")}
    if entry.cls.__dataclass_fields__.get("length") and "order" in fields and "length" in given:
        places, rest = places[:1], {**rest, "length": given["length"]}
    try:
        return entry.cls(*places, **rest)
    except TypeError:
        checks.refuse(
            f"the settings do not fit {entry.name}: one is missing or unknown. Its settings are {checks.listed(fields)}. Got "
            f"{checks.listed(given)}."
        )


def _write(asked: Asked, record: Record, method: Method, fit: Fit, level: str) -> WrittenFiles:
    """Write the model of the fit and, if possible, the page of the same method fitted to the first part of the record."""
    from ..identification.compare import absolute, compare
    from ..identification.held_out import divided

    model = absolute(fit.model, divided([record], 1.0, level).trend.at(len(record)))
    write_model_file(model, file_options(asked, record), asked.files.model)
    try:
        others = [read(path, asked.outputs, asked.inputs, asked.reading) for path in asked.held_out] or None
        found = compare([method], record, split=asked.split, level=level, held_out=others, feedback="accepted")
    except InputError:
        return WrittenFiles(asked.files.model, None)
    if found.ranked[0].fit is None or found.task is None or len(found.task.records) > 1:
        return WrittenFiles(asked.files.model, None)
    write_page(
        found, found.task.records[0], asked.files.report, chosen=found.ranked[0], selection=None, asked=asked,
        options=(f"--method {name_of(method)}",), lead=[found.verdict, found.sentence],
        reading=options_of(asked.path, asked.inputs, asked.reading),
    )  # fmt: skip
    return WrittenFiles(asked.files.model, asked.files.report)


def name_of(method: Method) -> str:
    """Its name on the command line."""
    from .. import catalogue

    return next(entry.name for entry in catalogue.IDENTIFIERS if entry.cls is type(method))


def verdict(fit: Fit) -> str:
    """The verdict in one line."""
    failed = [check.name for check in fit.validation.checks if not check.passed]
    if not failed:
        return "The model passes every check."
    return f"The model fails the {'check' if len(failed) == 1 else 'checks'} {', '.join(failed)}: see below."


def as_data(run: Identified) -> dict[str, Any]:
    """What `identify` prints as JSON."""
    fit = run.fit
    return {
        "outcome": {"code": fit.outcome.code, "sentence": fit.outcome.sentence},
        "verdict": verdict(fit),
        "record": str(run.asked.path),
        "method": run.method,
        "samples": len(run.record),
        "notes": list(run.record.notes),
        "outputs_seen": int(run.record.seen.sum()),
        "orders": {**_degrees(fit), "chosen": run.chosen},
        "parameters": dict(zip(fit.names, map(float, fit.parameters), strict=True)),
        "sigma": dict(zip(fit.names, map(float, fit.sigma), strict=True)),
        "noise_variance": dict(zip(run.record.outputs, _noise_variance(fit), strict=True)),
        "fit_percent": dict(zip(run.record.outputs, map(float, fit.validation.fit), strict=True)),
        "undetermined": 0 if fit.undetermined is None else int(fit.undetermined.shape[1]),
        "written": run.written.as_data(),
        **checks_of(fit),
    }


def checks_of(fit: Fit) -> dict[str, Any]:
    """The checks of a fit, the tests of single assumptions, and other parameters that fit as well, as JSON."""
    found, others = fit.validation, () if fit.rivals is None else fit.rivals
    tests = {
        name: [check._asdict() | {"passed": bool(check.passed)} for check in each]
        for name, each in (("checks", found.checks), ("scores", found.scores))
    }
    return {**tests, "rivals": [dict(zip(fit.names, map(float, one), strict=True)) for one in others]}


def as_text(run: Identified) -> list[Any]:
    """What `identify` prints as text."""
    from rich import box
    from rich.table import Table

    fit, seen = run.fit, int(run.record.seen.sum())
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 2, 0, 0), show_edge=False)
    table.add_column("parameter")
    table.add_column("estimate", justify="right", style="bold")
    table.add_column("sigma", justify="right")
    for name, value, sigma in zip(fit.names, fit.parameters, fit.sigma, strict=True):
        table.add_row(name, *_shown(float(value), float(sigma)))
    head = f"{run.asked.path.name}: {counted(len(run.record), 'sample')}, {counted(seen, 'output')} seen; {run.method}"
    variances = zip(run.record.outputs, fit.validation.fit, _noise_variance(fit), strict=True)
    fits = [f"{name}: fit {percent:.1f} %, noise variance {r:.4g}." for name, percent, r in variances]
    chosen = [] if run.chosen is None else [run.chosen]
    return [verdict(fit), head, *chosen, "", table, "", *fits, *fit.validation.sentences]


def _degrees(fit: Fit) -> dict[str, int | None]:
    """na, nb and delay of a polynomial model, else the number of states."""
    if isinstance(fit.model, StateSpace):
        return {"order": fit.model.n}
    return {name: getattr(fit.model, name) for name in ("na", "nb", "delay")}


def _noise_variance(fit: Fit) -> list[float]:
    """The noise variance of each output: of v, or of the innovations."""
    model = fit.model
    return [float(r) for r in (np.diagonal(model.R) if isinstance(model, StateSpace) else model.noise_variance)]


def _chosen_order(record: Record, given: dict[str, Any], order: int | None) -> str | None:
    """Choose the number of states if it was not given; returns the message on it."""
    from ..identification.select_order import select_order

    if order is not None:
        given["order"] = order
        return None
    selection = select_order(record)
    given["order"] = selection.order
    return f"{selection.sentence} Choose another order with --order N."


def _shown(value: float, sigma: float) -> tuple[str, str]:
    """A parameter and its standard deviation; "not known" if the record does not determine it."""
    if math.isinf(sigma):
        return "not known", ""
    digits = decimals(sigma)
    return f"{value:.{digits}f}", "" if math.isnan(sigma) else f"{sigma:.{digits}f}"


def read(path: Path, outputs: Sequence[str], inputs: Sequence[str], reading: dict[str, Any]) -> Record:
    """The record, with a row for each multiple of its step where rows are missing."""
    from ..data.reading import read_record
    from ..identification.connected import gridded

    record = read_record(path, outputs=outputs, inputs=inputs, **options_of(path, inputs, reading))
    parts = gridded(record)
    return parts[0] if len(parts) == 1 else record


def options_of(path: Path, inputs: Sequence[str], reading: dict[str, Any]) -> dict[str, Any]:
    """The options of `read_record`; the columns `time` and `arrived` are used if they exist and no other was given."""
    from ..data.reading import column_names

    given = {name: value for name, value in reading.items() if value is not None}
    there = column_names(path)
    if not given.keys() & {"time", "dt"} and "time" in there:
        given["time"] = "time"
    if "arrived" not in given and "arrived" in there and len(inputs) == 1:
        given["arrived"] = ["arrived"]
    if not given.keys() & {"time", "dt"}:
        given["dt"] = 1.0
    return given


def file_options(asked: Asked, record: Record) -> dict[str, Any]:
    """How the model file says that the record is read: on a grid where rows are missing."""
    given = options_of(asked.path, asked.inputs, asked.reading)
    return given if record.grid is None or "time" not in given else {**given, "grid": record.grid}


def _chosen_orders(record: Record, given: dict[str, Any]) -> str:
    """Choose the orders that were not given, by BIC; returns the message on them."""
    from ..identification.choose_orders import choose_orders

    fixed: dict[str, Any] = {name: (given[name],) for name in ("na", "nb", "delay") if name in given}
    found = choose_orders(record, **fixed)
    given |= {name: getattr(found.best, name) for name in ("na", "nb", "delay")}
    return found.sentence


def _noise(record: Record, given: dict[str, Any]) -> Any:
    """The noise variances of a maximum-likelihood fit."""
    from ..identifiers.output_error_ml import OutputErrorML

    fit = OutputErrorML(given["na"], given["nb"], delay=given.get("delay", 0)).fit([record])
    return np.asarray(fit.model.noise_variance)
