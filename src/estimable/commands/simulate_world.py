"""What `estimable simulate PLANT --fault ...` flies and writes: a record, and the true values behind it."""

import dataclasses
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from .. import checks, writing
from ..annotations import AnyRecord
from ..models.state_space import StateSpace
from ..results import ClosedLoop
from . import show
from .destination import check_destination
from .fault_option import read_faults
from .numbers import counted
from .simulate_report import check_links, link

NAMES = {"short-period": "f16", "jsbsim": "jsbsim", "jsbsim-untrimmed": "jsbsim"}  # of --plant


def run(
    what: str, plant: str | None, out: Path | None, *, machine: bool, seed: int, faults_given: Iterable[str],
    turbulence: str | None, arrivals: tuple[float, float], burst: float, refused: dict[str, Any],
) -> None:  # fmt: skip
    """Fly, write and print."""
    check_destination("--out", out, ".csv")
    closed, model = flown(
        what, plant, seed=seed, faults_given=faults_given, turbulence=turbulence, arrivals=arrivals, burst=burst,
        refused=refused,
    )  # fmt: skip
    written = None if out is None else write(closed, model, seed, out)
    if machine:
        show.data("simulate", as_data(closed, model, seed, out))
    else:
        show.text(lambda _: as_text(closed, plant or what))
    if written is not None:
        show.notes(written)


def flown(
    what: str, plant: str | None, *, seed: int, faults_given: Iterable[str], turbulence: str | None,
    arrivals: tuple[float, float], burst: float, refused: dict[str, Any],
) -> tuple[ClosedLoop, StateSpace]:  # fmt: skip
    """The flight and the model of its plant. Raises `InputError` with all faults of the call."""
    from ..plants import worlds

    faults = checks.Faults()
    faults.whole("--seed", seed, 0)
    if plant is not None and what != "f16":
        faults.add(f"--plant applies only to f16: leave it out. Got {plant!r}.")
    elif plant is not None:
        faults.choice("--plant", plant, tuple(NAMES))
    check_links(arrivals, burst, faults)
    faults.choice("--turbulence", turbulence or "none", worlds.SEVERITIES)
    for option, value in refused.items():
        if value is not None:
            faults.add(f"--{option} does not apply to a flight with --fault, --turbulence or --out: leave it out.")
    faults.finish()
    name = what if plant is None else NAMES[plant]
    about = {"about": "zero"} if plant == "jsbsim-untrimmed" else {}
    still = worlds.world(name, (), **about)
    events, end = read_faults(faults_given, still.model), (len(still.reference) - 1) * still.dt
    for event in events:
        if event.time > end:
            faults.add(f"--fault: {type(event).__name__} begins at {event.time:g} s, but the flight ends at {end:g} s.")
    faults.finish()
    links = dict(zip(("input_link", "output_link"), (link(rate, burst) for rate in arrivals), strict=True))
    with show.working("Flying"):
        flight = worlds.world(name, events, turbulence=turbulence or "none", **about)
        closed, model = flight.fly(seed=seed, **links), flight.model
    return closed, model


def columns(closed: ClosedLoop, model: StateSpace) -> dict[str, np.ndarray]:
    """The record: times, commands, measured positions, outputs."""
    commands = {f"{name}_command": column for name, column in zip(model.inputs, closed.applied.T, strict=True)}
    positions = dict(zip(model.inputs, closed.known_input.T, strict=True))
    return {"time": closed.t, **commands, **positions, **dict(zip(model.outputs, closed.output.T, strict=True))}


def truth(closed: ClosedLoop, model: StateSpace, seed: int) -> dict[str, Any]:
    """What happened, and the true states and positions."""
    return {
        "seed": seed,
        "events": [{"event": type(event).__name__, **_plain(event)} for event in closed.events],
        "time": closed.t.tolist(),
        "states": {name: column.tolist() for name, column in zip(model.states, closed.state.T, strict=True)},
        "inputs": {name: column.tolist() for name, column in zip(model.inputs, closed.input.T, strict=True)},
    }


def _plain(event: AnyRecord) -> dict[str, Any]:
    values = {field.name: getattr(event, field.name) for field in dataclasses.fields(event)}
    return {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in values.items()}


def truth_path(out: Path) -> Path:
    """The file of the true values, next to the record."""
    return out.with_suffix(".truth.json")


def write(closed: ClosedLoop, model: StateSpace, seed: int, out: Path) -> str:
    """Write the record and the true values, and return the message."""
    import pandas as pd

    table = pd.DataFrame(columns(closed, model))
    writing.write(out, lambda stream: stream.write(table.to_csv(index=False).encode()), option="--out")
    content = json.dumps(truth(closed, model, seed)).encode()
    writing.write(truth_path(out), lambda stream: stream.write(content), option="--out")
    size = f"{counted(len(table), 'row')} of {counted(len(table.columns), 'column')}"
    return f"Wrote {size} to {out}, and the true values to {truth_path(out)}."


def as_data(closed: ClosedLoop, model: StateSpace, seed: int, out: Path | None) -> dict[str, Any]:
    """The flight, as JSON; with the rows if they are not written to a file."""
    found = {
        "outcome": {"code": closed.outcome.code, "sentence": closed.outcome.sentence},
        "samples": len(closed), "seed": seed, "engine": closed.engine,
        "events": truth(closed, model, seed)["events"],
        "out": None if out is None else str(out), "truth": None if out is None else str(truth_path(out)),
    }  # fmt: skip
    if out is None:
        found["rows"] = {
            name: [None if v != v else v for v in column.tolist()] for name, column in columns(closed, model).items()
        }
    return found


def as_text(closed: ClosedLoop, what: str) -> list[str]:
    """The flight, as text: one line for each event."""
    lasting, events = f"{closed.t[-1]:g} s", counted(len(closed.events), "event")
    lines = [f"Flew {counted(len(closed), 'sample')} of {what}, {lasting}, with {events}."]
    for event in closed.events:
        given = {name: value for name, value in _plain(event).items() if value is not None and name != "time"}
        lines.append(f"  {event.time:g} s  {type(event).__name__}: " + ", ".join(f"{k} {v}" for k, v in given.items()))
    return lines
