"""What `estimable simulate` draws and prints."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from .. import checks, writing
from ..results import Simulation
from .numbers import counted
from .settings import read_settings

MODELS = ("output-error", "f16")
PLANT: dict[str, Any] = {"a": [0.523, 0.349], "b": [0.440, 0.762], "noise_variance": 0.1, "dt": 1.0, "delay": 0}
UNIFORM = np.sqrt(3.0)  # half the width of the uniform density of unit variance


def simulated(
    what: str, *, rows: int, seed: int, arrivals: tuple[float, float], burst: float, lost: str, settings: Iterable[str]
) -> Simulation:
    """Draw the record. Raises `InputError` with all faults of the call."""
    from ..models.output_error import OutputError
    from ..simulation.simulate import simulate

    given, faults = read_settings(settings), checks.Faults()
    faults.choice("MODEL", what, MODELS)
    faults.whole("--rows", rows, 1, checks.MOST_ROWS)
    faults.whole("--seed", seed, 0)
    if unknown := sorted(given.keys() - PLANT.keys()):
        faults.add(f"output-error has no setting {checks.listed(unknown)}: it has {checks.listed(PLANT)}.")
    check_links(arrivals, burst, faults)
    faults.finish()
    model = OutputError(**{**PLANT, **given})
    u = np.random.default_rng(seed).uniform(-UNIFORM, UNIFORM, (rows, model.m))
    input_link, output_link = (link(rate, burst) for rate in arrivals)
    return simulate(model, u, seed=seed, input_link=input_link, output_link=output_link, lost=lost)


def check_links(arrivals: tuple[float, float], burst: float, faults: checks.Faults) -> None:
    """Check the options of the links."""
    for option, rate in zip(("--input-arrival", "--output-arrival"), arrivals, strict=True):
        faults.number(option, rate, lower=0.0, upper=1.0)
    if burst != 0:
        faults.number("--burst", burst, lower=1.0)


def link(rate: float, burst: float) -> Any:
    """The link with an arrival rate and a mean length of a burst of losses; None if nothing is lost."""
    from ..networks.links import BernoulliLink, GilbertElliottLink

    if rate == 1.0:
        return None
    return BernoulliLink(rate) if burst == 0 else GilbertElliottLink.of_rate(rate, burst=burst)


def frame(simulation: Simulation) -> Any:
    """The record as a table: time, the inputs sent, whether each arrived, the outputs."""
    import pandas as pd

    record = simulation.record
    names = [_short(record.inputs, "u"), _short(record.outputs, "y")]
    columns = {"time": record.t} | dict(zip(names[0], record.u.T, strict=True))
    if record.arrived is not None:
        arrived = ["arrived"] if len(names[0]) == 1 else [f"arrived_{name}" for name in names[0]]
        columns |= dict(zip(arrived, record.arrived.T.astype(int), strict=True))
    return pd.DataFrame(columns | dict(zip(names[1], record.y.T, strict=True)))


def _short(names: tuple[str, ...], letter: str) -> list[str]:
    return [letter] if len(names) == 1 else list(names)


def write(simulation: Simulation, out: Path) -> str:
    """Write the record and return the message. Raises `InputError` if `out` cannot be written."""
    table = frame(simulation)
    writing.write(out, lambda stream: stream.write(table.to_csv(index=False).encode()), option="--out")
    return f"Wrote {counted(len(table), 'row')} of {counted(len(table.columns), 'column')} to {out}."


def as_data(simulation: Simulation, seed: int, out: Path | None) -> dict[str, Any]:
    """What `simulate` prints as JSON, including the rows if they are not written to a file."""
    record = simulation.record
    found = {
        "outcome": {"code": 0, "sentence": ""},
        "samples": len(record),
        "seed": seed,
        "input_arrival": 1.0 if record.arrived is None else float(np.mean(record.arrived)),
        "output_arrival": float(np.mean(record.seen)),
        "out": None if out is None else str(out),
    }
    if out is None:
        found["rows"] = {name: column.tolist() for name, column in frame(simulation).items()}
    return found


def as_text(simulation: Simulation) -> list[Any]:
    """What `simulate` prints as text."""
    record = simulation.record
    arrived = "all" if record.arrived is None else f"{100 * np.mean(record.arrived):.1f} %"
    return [
        f"Drew {counted(len(record), 'sample')} of an output-error plant.",
        f"Arrived inputs: {arrived}. Arrived outputs: {100 * np.mean(record.seen):.1f} %.",
    ]
