"""A rho synthesis, as JSON and as text."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .. import checks
from ..design.rho_plan import default_eta
from ..design.rho_synthesis import rho_synthesis
from ..models.files import ModelFile, read_model
from ..models.nonlinear_model import NonlinearModel
from ..results import RhoSynthesis
from .check_report import sampled
from .numbers import counted


class Tuned(NamedTuple):
    """A model file, the result, and the options of the command."""

    path: Path
    file: ModelFile
    found: RhoSynthesis
    dt: float | None
    weights: dict[str, Any]
    filter: str | None
    designs: int


def tuned(path: Path, *, dt: float | None, weights: Sequence[str], filter: str | None, designs: int) -> Tuned:
    """Read a model file and judge designs for its model, sampled if a step is given."""
    faults = checks.Faults()
    faults.whole("--designs", designs, 2)
    faults.finish()
    given = read_weights(weights)
    file = read_model(path)
    if isinstance(file.model, NonlinearModel):
        checks.refuse("tune needs a linear model. This model is nonlinear.")
    model = sampled(file, dt)
    eta = None if model.m == 0 or model.varying else default_eta(model, designs)
    found = rho_synthesis(model, eta=eta, filter=filter, weights=given or None)
    return Tuned(path, file, found, dt, given, filter, designs)


def read_weights(given: Sequence[str]) -> dict[str, float]:
    """Weights from texts `name=value`.

    >>> read_weights(["rho=1", "control=.5"])
    {'rho': 1.0, 'control': 0.5}
    """
    faults, weights = checks.Faults(), {}
    for text in given:
        name, _, value = (part.strip() for part in text.partition("="))
        try:
            weights[name] = float(value)
        except ValueError:
            faults.add(f"--weight needs name=value, as in --weight rho=1. Got {text!r}.")
    faults.finish()
    return weights


def as_data(run: Tuned, report: Path | None) -> dict[str, Any]:
    """What `tune` prints as JSON."""
    found, i = run.found, run.found.chosen
    return {
        "outcome": {"code": 0, "sentence": ""},
        "model": str(run.path),
        "dt": found.model.dt,
        "states": found.model.states,
        "inputs": found.model.inputs,
        "outputs": found.model.outputs,
        "weights": found.weights,
        "noise": found.noise,
        "chosen": {
            "design": i,
            "eta": float(found.eta[i]),
            "bandwidth_rad_s": float(found.bandwidth[i]),
            "feedback": found.feedback.tolist(),
            "filter": found.filter.tolist(),
            "margin": {
                "rho": float(found.margin.margin),
                "sigma": float(found.margin.sigma),
                "stability_radius": float(found.margin.stability_radius),
            },
        },
        "criteria": [
            {
                "name": name,
                "best": best.value,
                "best_bandwidth_rad_s": best.bandwidth,
                "chosen": float(_values(found, name)[i]),
            }
            for name, best in found.optima.items()
        ],
        "curves": {
            "eta": found.eta.tolist(),
            "bandwidth_rad_s": found.bandwidth.tolist(),
            **{name: values.tolist() for name, values in found.criteria.items()},
            "composite": found.composite.tolist(),
        },
        "report": None if report is None else str(report),
    }


def _values(found: RhoSynthesis, name: str) -> Any:
    return found.composite if name == "composite" else found.criteria[name]


def as_text(run: Tuned) -> list[Any]:
    """What `tune` prints as text."""
    return [_header(run), "", _table(run.found), "", *sentences(run), "", *_gains(run.found)]


def sentences(run: Tuned) -> tuple[str, ...]:
    """The choice, as sentences."""
    found, i = run.found, run.found.chosen
    counted_by = " and ".join(f"{name} ({weight:g})" for name, weight in found.weights.items())
    known = np.isfinite(found.bandwidth[i])
    slow = (
        f"a bandwidth of {found.bandwidth[i]:.3g} rad/s"
        if known
        else "a bandwidth too high for this step (a pole at or below zero)"
    )
    margin = found.margin
    return (
        f"Chosen by {counted_by}: {slow}, eta = {found.eta[i]:.4g} per second.",
        f"This loop tolerates unmodelled terms of up to {margin.margin:.3g} times the state{_per(run)} "
        f"(by the margin sigma {margin.sigma:.3g}; if they are constant {margin.stability_radius:.3g}).",
    )


def _per(run: Tuned) -> str:
    return " per second" if run.found.model.is_continuous else " per sample"


def next_steps(run: Tuned, report: Path | None) -> tuple[str, ...]:
    """The options that show more."""
    lines = ("",) if report is None else ("", f"Wrote {report}: open it in a browser.")
    if run.found.model.is_continuous:
        lines += ("This design is for continuous time, where R is a density. Give --dt SECONDS to design for samples.",)
    if report is None:
        lines += ("All criteria over the bandwidth: --report tuning.html",)
    return lines


def write(run: Tuned, path: Path) -> None:
    """Write the page."""
    from ..report import tuning_report, write_report

    commands = (("From a terminal:", _command(run, path)), ("In Python:", _script(run)))
    title = f"How fast should the loop of {run.path.name} be?"
    write_report(tuning_report(run.found, title=title, lead=sentences(run), commands=commands), path)


def _command(run: Tuned, path: Path) -> str:
    import shlex

    parts = ["estimable", "tune", str(run.path)]
    parts += [] if run.dt is None else ["--dt", f"{run.dt:g}"]
    parts += [word for name, value in run.weights.items() for word in ("--weight", f"{name}={value}")]
    parts += [] if run.filter is None else ["--filter", run.filter]
    parts += [] if run.designs == 200 else ["--designs", str(run.designs)]
    return shlex.join([*parts, "--report", str(path)])


def _script(run: Tuned) -> str:
    """The same design in Python, ready to fly."""
    found, eta = run.found, run.found.eta
    sampled = run.file.model.is_continuous and not found.model.is_continuous
    given = {"filter": run.filter, "weights": run.weights or None}
    settings = "".join(f", {name}={value!r}" for name, value in given.items() if value is not None)
    filter = "es.FixedGain(model, found.filter)"
    if found.model.is_continuous:
        filter = "es.FixedGain(model.discretise(0.01), found.filter_of_sample(0.01))"
    return "\n".join(
        [
            "import estimable as es",
            "import numpy as np",
            f"model = es.read_model({run.path.name!r}).model{f'.discretise({found.model.dt:g})' if sampled else ''}",
            f"eta = np.geomspace({float(eta[0])!r}, {float(eta[-1])!r}, {len(eta)})",
            f"found = es.rho_synthesis(model, eta=eta{settings})",
            "law = es.StateFeedback(found.feedback)",
            f"filter = {filter}",
            "found.plot().show()",
        ]
    )


def _header(run: Tuned) -> str:
    model = run.found.model
    step = "continuous" if model.is_continuous else f"step {model.dt:g} s"
    sizes = ", ".join(counted(n, word) for n, word in ((model.n, "state"), (model.m, "input"), (model.p, "output")))
    return f"{run.path.name}: {sizes}; {step}; {counted(len(run.found.eta), 'design')}; rms under {_noise(run.found)} noise"


def _noise(found: RhoSynthesis) -> str:
    return "the model's" if found.noise == "the model's" else "unit white"


def _table(found: RhoSynthesis) -> Any:
    """Each criterion: its best value, the bandwidth of it, and its value in the chosen design."""
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 2, 0, 0), show_edge=False)
    table.add_column("criterion")
    for heading in ("best", "at rad/s", "chosen"):
        table.add_column(heading, justify="right", style="bold" if heading == "chosen" else None)
    for name, best in found.optima.items():
        value = float(_values(found, name)[found.chosen])
        table.add_row(name, f"{best.value:.3g}", _speed(best.bandwidth), f"{value:.3g}")
    return table


def _speed(bandwidth: float) -> str:
    return f"{bandwidth:.3g}" if np.isfinite(bandwidth) else "none"


def _gains(found: RhoSynthesis) -> list[str]:
    """The gains, row by row."""
    rows = [f"feedback {name}: {_row(row)}" for name, row in zip(found.model.inputs, found.feedback, strict=True)]
    return rows + [f"filter {name}: {_row(row)}" for name, row in zip(found.model.states, found.filter, strict=True)]


def _row(values: np.ndarray) -> str:
    return "  ".join(f"{value:.4g}" for value in values)
