"""What `estimable identify` does and says."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .. import checks
from ..data.record import Record
from ..results import Fit
from .numbers import counted, decimals
from .settings import read_settings


class Identified(NamedTuple):
    """A fit, how it was made, and the sentence on the orders where they were chosen."""

    path: Path
    record: Record
    method: str
    settings: dict[str, Any]
    chosen: str | None
    fit: Fit


def identified(
    path: Path, name: str, *, outputs: Sequence[str], inputs: Sequence[str], settings: Iterable[str], reading: dict[str, Any]
) -> Identified:  # fmt: skip
    """Read the record, choose what was not given, and identify.

    Raises `InputError` for what is wrong with the record, the method or its settings.
    """
    from .. import catalogue
    from ..run.identify import identify

    entry = catalogue.identifier(name)
    given = read_settings(settings)
    record = read(path, outputs, inputs, reading)
    chosen = _chosen_orders(record, given) if not {"na", "nb"} <= given.keys() else None
    if "noise_variance" not in given and name == "recursive-output-error":
        given["noise_variance"] = _noise(record, given)
    try:
        method = entry.cls(given.pop("na"), given.pop("nb"), **given)
    except TypeError:
        allowed = [field for field in entry.cls.__dataclass_fields__ if field != "_"]
        checks.refuse(f"{name} has the settings {checks.listed(allowed)}. Got {checks.listed(given)}.")
    return Identified(path, record, name, given, chosen, identify(method, record))


def as_data(run: Identified) -> dict[str, Any]:
    """What `identify` says to a machine."""
    fit = run.fit
    return {
        "outcome": {"code": fit.outcome.code, "sentence": fit.outcome.sentence},
        "record": str(run.path),
        "method": run.method,
        "samples": len(run.record),
        "outputs_seen": int(run.record.seen.sum()),
        "orders": {"na": fit.model.na, "nb": fit.model.nb, "delay": fit.model.delay, "chosen": run.chosen},
        "parameters": dict(zip(fit.names, map(float, fit.parameters), strict=True)),
        "sigma": dict(zip(fit.names, map(float, fit.sigma), strict=True)),
        "noise_variance": dict(zip(fit.model.outputs, map(float, fit.model.noise_variance), strict=True)),
        "fit_percent": dict(zip(fit.model.outputs, map(float, fit.validation.fit), strict=True)),
        "undetermined": 0 if fit.undetermined is None else int(fit.undetermined.shape[1]),
        "checks": [check._asdict() | {"passed": bool(check.passed)} for check in fit.validation.checks],
    }


def as_text(run: Identified) -> list[Any]:
    """What `identify` says to people."""
    from rich import box
    from rich.table import Table

    fit, seen = run.fit, int(run.record.seen.sum())
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 2, 0, 0), show_edge=False)
    table.add_column("parameter")
    table.add_column("estimate", justify="right", style="bold")
    table.add_column("sigma", justify="right")
    for name, value, sigma in zip(fit.names, fit.parameters, fit.sigma, strict=True):
        digits = decimals(float(sigma))
        table.add_row(name, f"{value:.{digits}f}", f"{sigma:.{digits}f}")
    head = f"{run.path.name}: {counted(len(run.record), 'sample')}, {counted(seen, 'output')} seen; {run.method}"
    variances = zip(fit.model.outputs, fit.validation.fit, fit.model.noise_variance, strict=True)
    fits = [f"{name}: fit {percent:.1f} %, noise variance {r:.4g}." for name, percent, r in variances]
    chosen = [] if run.chosen is None else [run.chosen]
    return [head, *chosen, "", table, "", *fits, *fit.validation.sentences]


def read(path: Path, outputs: Sequence[str], inputs: Sequence[str], reading: dict[str, Any]) -> Record:
    """The record; the columns `time` and `arrived` are taken where they are there and nothing else was said."""
    from ..data.reading import column_names, read_record

    given = {name: value for name, value in reading.items() if value is not None}
    there = column_names(path)
    if not given.keys() & {"time", "dt"} and "time" in there:
        given["time"] = "time"
    if "arrived" not in given and "arrived" in there and len(inputs) == 1:
        given["arrived"] = ["arrived"]
    if not given.keys() & {"time", "dt"}:
        given["dt"] = 1.0
    return read_record(path, outputs=outputs, inputs=inputs, **given)


def _chosen_orders(record: Record, given: dict[str, Any]) -> str:
    """Choose the orders that were not given, by BIC; the sentence that says so."""
    from ..run.choose_orders import choose_orders

    fixed: dict[str, Any] = {name: (given[name],) for name in ("na", "nb", "delay") if name in given}
    found = choose_orders(record, **fixed)
    given |= {name: getattr(found.best, name) for name in ("na", "nb", "delay")}
    return found.sentence


def _noise(record: Record, given: dict[str, Any]) -> Any:
    """The noise variances of a fit by maximum likelihood."""
    from ..identifiers.output_error_ml import OutputErrorML

    fit = OutputErrorML(given["na"], given["nb"], delay=given.get("delay", 0)).fit([record])
    return np.asarray(fit.model.noise_variance)
