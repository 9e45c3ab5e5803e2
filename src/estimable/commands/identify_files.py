"""The files that `estimable identify` writes: a model and a page."""

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..data.record import Record
from ..frozen import field_names, replace
from ..models.state_space import StateSpace
from ..protocols import Method
from ..results import Comparison, Ranked
from ..results.order_selection import OrderSelection
from .destination import check_destination
from .record_options import as_words


class Files(NamedTuple):
    """Where the model and the page go."""

    model: Path
    report: Path


class Asked(NamedTuple):
    """What the command line asked for: the records and how to read them, the split, the level to subtract, what to do about
    feedback, and the files."""

    path: Path
    outputs: Sequence[str]
    inputs: Sequence[str]
    reading: dict[str, Any]
    split: float
    level: str | None
    files: Files
    held_out: Sequence[Path] = ()
    feedback: str = "tested"

    def again(self, *options: str) -> str:
        """The command line of the same run."""
        words = ["estimable identify", shlex.quote(self.path.name)]
        words += [f"--output {shlex.quote(name)}" for name in self.outputs]
        words += [f"--input {shlex.quote(name)}" for name in self.inputs]
        words += as_words(self.reading)
        words += [] if self.split == 0.5 else [f"--split {self.split:g}"]
        words += [] if self.level is None else [f"--level {self.level}"]
        words += [f"--held-out {shlex.quote(path.name)}" for path in self.held_out]
        words += [] if self.feedback == "tested" else [f"--feedback {self.feedback}"]
        return " ".join([*words, *options])


class WrittenFiles(NamedTuple):
    """The files that were written; None for one that was not."""

    model: Path | None
    report: Path | None

    def as_data(self) -> dict[str, Any]:
        """The files, as JSON."""
        return {
            name: None if path is None else str(path) for name, path in (("model", self.model), ("report", self.report))
        }

    def notes(self) -> list[str]:
        """The messages about the files."""
        lines = []
        if self.model is not None:
            lines.append(f"Wrote {self.model}: for estimable estimate, gain and check, or es.read_model in Python.")
        if self.report is not None:
            lines.append(f"Wrote {self.report}: open it in a browser.")
        return lines


def destinations(record: Path, out: Path | None, report: Path | None) -> Files:
    """The given files, or files in this folder named after the record. Raises `InputError` if they cannot be written."""
    files = Files(out or Path(f"{record.stem}-model.toml"), report or Path(f"{record.stem}-report.html"))
    check_destination("--out", files.model, ".toml")
    check_destination("--report", files.report, ".html")
    return files


def write_model_file(model: StateSpace, reading: dict[str, Any], path: Path) -> None:
    """Write the model with a diffuse prior, and how to read the record."""
    from ..models.files import KEYS, write_model
    from ..models.prior import Prior

    n = model.n
    if model.B_end is not None and not np.any(model.B_end):  # D contains what the input does between its samples
        model, reading = replace(model, B_end=None), {**reading, "hold": None}
    given = {name: value for name, value in reading.items() if name in KEYS["record"] and value is not None}
    if "time" not in given:
        given["dt"] = model.dt
    write_model(path, model, Prior(np.zeros(n), np.zeros((n, n)), diffuse=np.eye(n)), record=given)


def write_page(
    found: Comparison, record: Record, path: Path, *, chosen: Ranked | None, selection: OrderSelection | None,
    asked: Asked, options: Sequence[str], lead: Sequence[str], reading: dict[str, Any],
) -> None:  # fmt: skip
    """Write the page of a comparison."""
    from ..report import report_of_comparison, write_report

    page = report_of_comparison(
        found, record, chosen=chosen, selection=selection, title=f"A model of {asked.path.name}", lead=lead,
        commands=(("From a terminal:", asked.again(*options)), ("In Python:", _script(found, record, asked, reading))),
        files=(asked.path, *asked.held_out),
    )  # fmt: skip
    write_report(page, path)


def _script(found: Comparison, record: Record, asked: Asked, reading: dict[str, Any]) -> str:
    """The same comparison in Python."""
    methods = ", ".join(_call(one.method) for one in found.ranked)
    names = f"outputs={list(record.outputs)!r}, inputs={list(record.inputs)!r}"
    columns = ", ".join([names, *(f"{name}={value!r}" for name, value in reading.items())])
    others = [f"es.read_record({path.name!r}, {columns})" for path in asked.held_out]
    return "\n".join(
        [
            "import estimable as es",
            f"record = es.read_record({asked.path.name!r}, {columns})",
            *([f"others = [{', '.join(others)}]"] if others else []),
            f"found = es.compare([{methods}], record{', held_out=others' if others else ''})",
            "print(found.verdict, found.sentence)",
            "model = found.predictor.model  # for es.Kalman(model), es.observability(model), es.to_control(model)",
        ]
    )


def _call(method: Method) -> str:
    given = {name: getattr(method, name) for name in field_names(type(method))}
    shown = ", ".join(f"{name}={value!r}" for name, value in given.items() if isinstance(value, bool | int | str))
    return f"es.{type(method).__name__}({shown})"
