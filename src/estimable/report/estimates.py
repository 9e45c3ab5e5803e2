"""The report of an estimate."""

import hashlib
import platform
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from .. import checks
from ..data.record import Record
from ..diagnostics.consistency import nis
from ..errors import InputError
from ..models.prior import Prior
from ..run.binding import columns, model_of
from .assumptions import sections_of
from .charts import Measured, Moment, charts_of, thinned
from .contents import Fact, Report, Section, Verdict


def report_of(
    result: Any, *, record: Record, algorithm: Any, prior: Prior, title: str = "Estimate", lead: Sequence[str] = (),
    facts: Sequence[Fact] = (), commands: Sequence[tuple[str, str]] = (), files: Sequence[Path] = (), judged: Any = None,
) -> Report:  # fmt: skip
    """A report of one `Estimate`, with what it was made from.

    `lead`: sentences at its head; `facts`: numbers under them; `commands`: (what it does, what to type) that make it again;
    `files`: whose SHA-256 is told; `judged`: the `Estimate` whose innovations are checked besides (of the algorithm inside a
    change detector, which counts process noise many times). The same arguments give the same report, to the byte.

    Raises `InputError` where the result has no rows over time.
    """
    if result.mean is None or len(result.mean) != len(record):
        checks.refuse('a report shows every row: the result must be one of `estimate` with keep = "all".')
    rows = thinned(len(record))
    times = np.arange(len(record)) if result.t is None else np.asarray(result.t)
    return Report(
        title, tuple(lead), tuple(facts), times[rows], "sample" if result.t is None else "time [s]",
        tuple(charts_of(result, measured_states(algorithm, record), _moments(result, times))), _verdicts(result, judged),
        (*sections_of(algorithm, record, prior), _versions(result, files)), tuple(commands),
    )  # fmt: skip


def measured_states(algorithm: Any, record: Record) -> dict[str, Measured]:
    """What was measured of each state of which an output is a measurement: the state itself, and noise."""
    model = model_of(algorithm)
    C, D = np.asarray(model.C), np.asarray(model.D)
    if C.ndim > 2 or D.ndim > 2:
        return {}
    names, point, found = algorithm.names.outputs, model.operating_point, {}
    places = columns(names, record.outputs, "output", "y", checks.Faults())
    for j, (name, place) in enumerate(zip(names, places, strict=True)):
        i = int(np.argmax(np.abs(C[j])))
        offset = 0.0 if point is None else point.outputs[j] - point.states[i]
        if np.array_equal(C[j], np.eye(model.n)[i]) and not D[j].any() and abs(offset) < 1e-12:
            found[model.states[i]] = Measured(
                name, dict(record.units).get(record.outputs[place], ""), record.y[:, place]
            )
    return found


def _moments(result: Any, times: np.ndarray) -> list[Moment]:
    """The changes that a detector found."""
    if "alarm" not in result.extra:
        return []
    from .. import diagnostics

    return [
        Moment(change.gain, float(times[change.onset]), float(times[change.detected_at]))
        for change in diagnostics.changes(result)
    ]


def _verdicts(result: Any, judged: Any) -> tuple[Verdict, ...]:
    """The checks of a result; those of `judged`, where it is another, come first."""
    if judged is None or judged is result:
        return verdicts_of(result)
    without = (verdict._replace(name=f"{verdict.name}, without detection") for verdict in verdicts_of(judged))
    own = (verdict._replace(name=f"{verdict.name}, as shown above") for verdict in verdicts_of(result))
    return (*without, *own)


def verdicts_of(result: Any) -> tuple[Verdict, ...]:
    """The consistency checks of a result, those that can be made."""
    name = "Size of the innovations (NIS)"
    try:
        check = nis(result.innovation, result.innovation_covariance)
    except InputError:
        return (Verdict(name, "no output was seen with noise, so nothing can be judged", None),)
    if check.mean >= check.lower or "alarm" not in result.extra:
        return (Verdict(name, check.sentence, check.consistent),)
    band = check.sentence.split(":")[0]
    cautious = (
        "cautious on purpose: a detector counts process noise that lasts, so that it does not take it for a change"
    )
    return (Verdict(name, f"{band}: {cautious}", None),)


def _versions(result: Any, files: Sequence[Path]) -> Section:
    """What it was made with, and the fingerprints of the files it was made from."""
    from .. import __version__

    packages = ", ".join(f"{name} {version(name)}" for name in ("jax", "numpy"))
    made = f"estimable {__version__}, engine {result.engine}, float64; Python {platform.python_version()}, {packages}"
    fingerprints = ((path.name, f"SHA-256 {hashlib.sha256(path.read_bytes()).hexdigest()}") for path in files)
    return Section("Made with", (("Software", made), *fingerprints))
