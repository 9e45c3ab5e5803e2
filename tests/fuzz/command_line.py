"""Wrong command lines: options, values and files. The exit code is 0, 1 or 2, and no traceback is shown."""

import json
import random
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import typer
from typer.testing import CliRunner

import estimable as es
from estimable.commands import app
from estimable.packaged import path

from .calls import LONGEST, Outcome, limited
from .second_way import differ

COMMANDS: dict[str, list[list[str]]] = {  # right calls, with the files of `_write_files`
    "check": [["model.toml"], ["model.toml", "--dt", "0.01", "--record", "flight.csv"]],
    "gain": [["flight.csv", "--model", "model.toml"]],
    "estimate": [["flight.csv", "--model", "model.toml", "--filter", "kalman"]],
    "identify": [["flight.csv", "--method", "least-squares", "--input", "elevator_deg", "--output", "alpha_deg"]],
    "simulate": [["output-error", "--rows", "50", "--input-arrival", "0.8"]],
    "tune": [["model.toml", "--dt", "0.01", "--designs", "2"]],
}
VALUES = [
    "", " ", "-1", "0", "1", "2", "1e400", "nan", "inf", "-inf", "0.5", "1,5", "1e-300", "10000000000", "x" * 5000, "a=b", "=",
    "a=", "walk=nan", "walk=-1", "walk=1e300", "na=1000000", "order=0", "nb=", "é", "[]", "{}", "true", "None", "..",
    "/dev/full", "/no/such", "out.csv", "out.html", "out.txt", "time_s", "elevator_deg", "alpha_deg", "kalman", "y1",
    "unknown-gain", "unknown-input", "zero", "hold", "first_order", "mean", "trend", "least-squares", "subspace", "\u202ex",
    "<script>", "-9", "x" * 300 + ".csv", "x" * 300 + ".html",
]  # fmt: skip
TOO_LONG = ("--runs", "--scheduler")  # flights by the thousand, and a wait of 10 s for the answer of a cluster
FLIGHT, MODEL = path("f16-flight.csv").read_text().splitlines()[:40], path("f16-model.toml").read_text()


def commands() -> list[str]:
    """The names of the commands."""
    return list(COMMANDS)


def run(command: str, seed: int, *, check: bool = False) -> Outcome:
    """A command with one to three changes of its options or its files; `check`: with right options, against the functions."""
    rng = random.Random(f"{command} {seed}")
    arguments, names = list(rng.choice(COMMANDS[command])), _options(command)
    changes = [
        rng.choice(("value", "value", "option", "file", "file", "leave")) for _ in range(rng.choice([1, 1, 2, 3]))
    ]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _write_files(folder, rng if "file" in changes else None)
        for change in changes:
            if change == "option":
                arguments += [rng.choice(names)] + ([rng.choice(VALUES)] if rng.random() < 0.8 else [])
            elif change == "value" and arguments:
                arguments[rng.randrange(len(arguments))] = rng.choice([*VALUES, *names])
            elif change == "leave" and arguments:
                del arguments[rng.randrange(len(arguments)) :]
        given = [command, *arguments]
        outcome = limited(lambda: _called(given), folder)
        if check and outcome.kind == "answer" and arguments in COMMANDS[command] and command in BY_FUNCTIONS:
            outcome = limited(lambda: _compared(given), folder, 60)
    return outcome._replace(changed=tuple(given))


def _estimated(given: list[str], told: dict[str, Any]) -> list[str]:
    file = es.read_model("model.toml")
    channels = {"outputs": file.model.outputs, "inputs": file.model.inputs}
    record = es.read_record("flight.csv", **channels, **file.record)
    found = es.estimate(es.catalogue.build(told["filter"], file), record, prior=file.prior)
    faults = differ("log_likelihood", told["log_likelihood"], found.log_likelihood)
    if "mean" in told:
        faults += differ("mean", [told["mean"][name] for name in file.model.states], found.mean[-1])
    return faults


def _checked(given: list[str], told: dict[str, Any]) -> list[str]:
    model = es.read_model("model.toml").model
    found = es.estimability(model.discretise(0.01) if "--dt" in given else model)
    sigma = np.sqrt(np.diagonal(found.prior_covariance))
    return differ("singular_values", told["singular_values"], found.singular_values) + differ(
        "sigma", [told["sigma"][name] for name in model.states], sigma
    )


def _simulated(given: list[str], told: dict[str, Any]) -> list[str]:
    """The rows follow the equation of the plant."""
    rows = {name: np.array(values, float) for name, values in told["rows"].items()}
    applied = np.where(rows["arrived"] == 1, rows["u"], 0.0)
    plant = es.OutputError([0.523, 0.349], [0.440, 0.762], noise_variance=0.1, dt=1.0)
    noise = rows["y"] - plant.response(applied[:, None])[:, 0]
    return [] if np.abs(noise).max() < 8 * 0.1**0.5 else [f"a noise of {np.abs(noise).max():.3g}"]


BY_FUNCTIONS: dict[str, Callable[[list[str], dict[str, Any]], list[str]]] = {
    "estimate": _estimated, "gain": _estimated, "check": _checked, "simulate": _simulated,
}  # fmt: skip


def _compared(given: list[str]) -> Outcome:
    """The JSON of a command against what the functions give."""
    result = CliRunner().invoke(app, [*given, "--json"], prog_name="estimable")
    faults = BY_FUNCTIONS[given[0]](given, json.loads(result.stdout, parse_constant=_no_json))
    return Outcome("nonsense" if faults else "answer", "; ".join(faults), ways=("the_functions",))


def _no_json(constant: str) -> None:
    raise AssertionError(f"{constant} is not JSON")


def _options(command: str) -> list[str]:
    listed: Any = typer.main.get_command(app)
    return [option for parameter in listed.commands[command].params for option in parameter.opts
            if option.startswith("--") and option not in TOO_LONG]  # fmt: skip


def _called(given: list[str]) -> Outcome:
    result = CliRunner(env={"COLUMNS": "80", "NO_COLOR": "1", "TERM": "dumb"}).invoke(app, given, prog_name="estimable")
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    if result.exit_code not in (0, 1, 2) or "Traceback" in result.output:
        return Outcome("raw", f"exit code {result.exit_code}: {result.output[-200:]}")
    errors = [line for line in result.stderr.splitlines() if line.startswith("Error: ")]
    longest = max((len(line) for line in errors), default=0)
    if longest > LONGEST:
        return Outcome("long", errors[0][:200])
    return Outcome("answer" if result.exit_code == 0 else "refused", "")


def _write_files(folder: Path, rng: random.Random | None) -> None:
    """The record and the model; with `rng`, one of them is damaged."""
    (folder / "flight.csv").write_text("\n".join(FLIGHT) + "\n")
    (folder / "model.toml").write_text(MODEL)
    if rng is None:
        return
    file = folder / rng.choice(["flight.csv", "flight.csv", "model.toml"])
    damaged = rng.choice(DAMAGES)(file.read_bytes(), rng)
    if damaged is None:
        file.unlink()
    else:
        file.write_bytes(damaged)
    if rng.random() < 0.05:
        shutil.rmtree(folder / "flight.csv", ignore_errors=True)


def _without_column(text: bytes, rng: random.Random) -> bytes:
    column = rng.randrange(4)
    rows = [line.split(b",") for line in text.splitlines()]
    return b"\n".join(b",".join(cells[:column] + cells[column + 1 :]) for cells in rows) + b"\n"


def _another_cell(text: bytes, rng: random.Random) -> bytes:
    numbers = text.replace(b"[", b",").replace(b"]", b",").split(b",")
    old = rng.choice([cell for cell in numbers if cell.strip()])
    new = rng.choice([b"", b"nan", b"inf", b"x", b"1e400", b"-1", b"0", b"1,5", b'"', b"\xff", b"1 2", b"12:00:00"])
    return text.replace(old, new, 1)


DAMAGES: list[Callable[[bytes, random.Random], bytes | None]] = [
    lambda text, rng: b"",
    lambda text, rng: None,
    lambda text, rng: rng.randbytes(500),
    lambda text, rng: b"\xef\xbb\xbf" + text,
    lambda text, rng: text.decode().encode("utf-16"),
    lambda text, rng: text.replace(b",", b";"),
    lambda text, rng: text.replace(b",", b";").replace(b".", b","),
    lambda text, rng: text.replace(b",", b"\t"),
    lambda text, rng: text.replace(b"\n", b"\r\n"),
    lambda text, rng: text.replace(b"\n", b"\n\n"),
    lambda text, rng: text.splitlines()[0] + b"\n",
    lambda text, rng: b"\n".join(text.splitlines()[1:]),
    lambda text, rng: text[: rng.randrange(len(text))],
    lambda text, rng: text.replace(b"alpha", b"elevator"),
    lambda text, rng: text.replace(b"0", b"\x00"),
    lambda text, rng: b"\n".join(text.splitlines()[::-1]),
    _without_column,
    _another_cell,
    _another_cell,
]
