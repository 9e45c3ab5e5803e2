"""Whether the quantities of a model can be known as well as required, as JSON and as text."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from .. import checks
from ..analysis.covariance_analysis import covariance_analysis
from ..analysis.sensor_selection import sensor_selection
from ..models.files import ModelFile
from ..models.state_space import StateSpace
from ..results import CovarianceAnalysis, SensorSelection
from .check_report import in_samples
from .settings import read_settings


class Required(NamedTuple):
    """The covariance analysis, that without one sensor, and the chosen sensors; None where they were not asked for."""

    found: CovarianceAnalysis
    lost: CovarianceAnalysis | None
    sensor: str | None
    chosen: SensorSelection | None


def required(
    file: ModelFile,
    model: StateSpace,
    *,
    require: Sequence[str],
    horizon: float | None,
    without: str | None,
    select: int | None,
) -> Required:
    """Analyse the model of a file from its prior, against requirements `name=sigma`."""
    if model.is_continuous:
        checks.refuse(
            "--require, --without and --select need --dt SECONDS: the model is continuous, and its R "
            "is the covariance of a sample."
        )
    sigmas = read_settings(require, option="--require", example="position=0.1")
    wanted = {name: _sigma(name, value) for name, value in sigmas.items()}
    steps = None if horizon is None else in_samples(horizon)
    given: dict[str, Any] = {"prior": file.prior, "requirement": wanted or None, "horizon": steps}
    found = covariance_analysis(model, **given)
    lost = None if without is None else found.without(without)
    return Required(found, lost, without, None if select is None else sensor_selection(model, choose=select, **given))


def _sigma(name: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        checks.refuse(
            f"--require needs name=sigma with a number, as in --require {name}=0.1. Got {checks.short(value)}."
        )
    return float(value)


def verdict(answer: Required) -> str:
    """The verdict in one line."""
    found = answer.found
    asked = np.isfinite(found.requirement)
    if not asked.any():
        count = sum(each == "known" or each == "known already" for each in found.verdicts)
        return f"{count} of {len(found.names)} quantities become known."
    unmet = [
        f"{name} ({each})"
        for name, each, one, since in zip(found.names, found.verdicts, asked, found.time_to_requirement, strict=True)
        if one and not np.isfinite(since)
    ]
    if unmet:
        return f"Not known as required: {', '.join(unmet)}."
    return f"Everything is known as required after {np.max(found.time_to_requirement[asked]):.4g} s."


def as_text(answer: Required) -> list[Any]:
    """The verdict, the table of quantities, what is blind, and what would help."""
    lines = [verdict(answer), "", _table(answer), "", *answer.found.sentences]
    if np.isfinite(answer.found.requirement).any() and not answer.found.met:
        best = answer.found.remedies()[:3]
        lines += [f"Would help: {one.change}: {_values(answer.found.names, one.sigma)}." for one in best]
    if answer.lost is not None:
        lines.append(f"Without {answer.sensor}: {_values(answer.found.names, answer.lost.sigma[-1])}.")
    return [*lines, *(answer.chosen.sentences if answer.chosen is not None else ()), ""]


def _values(names: tuple[str, ...], sigma: np.ndarray) -> str:
    return ", ".join(f"{name} {value:.3g}" for name, value in zip(names, sigma, strict=True))


def _table(answer: Required) -> Any:
    from rich import box
    from rich.table import Table

    found = answer.found
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 2, 0, 0), show_edge=False)
    for i, heading in enumerate(("quantity", "prior", "required", "reached", "limit", "when", "verdict")):
        table.add_column(heading, justify="left" if i in (0, 6) else "right")
    for i, name in enumerate(found.names):
        numbers = (found.prior_sigma[0, i], found.requirement[i], found.sigma[-1, i], found.limit[i])
        since = found.time_to_requirement[i]
        when = f"{since:.4g} s" if np.isfinite(since) else ""
        table.add_row(name, *("" if np.isnan(x) else f"{x:.3g}" for x in numbers), when, found.verdicts[i])
    return table


def as_data(answer: Required) -> dict[str, Any]:
    """What `check` adds to its JSON."""
    found = answer.found
    quantities = {
        name: {
            "verdict": found.verdicts[i],
            "prior": float(found.prior_sigma[0, i]),
            "required": float(found.requirement[i]),
            "reached": float(found.sigma[-1, i]),
            "limit": float(found.limit[i]),
            "time_s": float(found.time_to_requirement[i]),
        }
        for i, name in enumerate(found.names)
    }
    lost = None if answer.lost is None else dict(zip(found.names, answer.lost.sigma[-1].tolist(), strict=True))
    return {
        "known": {
            "verdict": verdict(answer),
            "met": found.met,
            "quantities": quantities,
            "sentences": list(found.sentences),
            "without": lost,
            "selected": None if answer.chosen is None else list(answer.chosen.sensors),
        }
    }
