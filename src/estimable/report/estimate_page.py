"""The report of an estimate."""

import hashlib
import platform
from collections.abc import Iterator, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from .. import checks
from ..data.record import Record
from ..diagnostics.consistency import nis
from ..diagnostics.innovation_tests import check_innovations
from ..errors import InputError
from ..estimation.binding import columns, model_of
from ..figures.bands import Band, bands
from ..models.prior import Prior
from ..protocols import Algorithm
from ..results import DetectableLoss, Estimate, SmoothedEstimate
from .assumptions import sections_of
from .charts import MeasuredState, charts_of, in_order, kind_of, output_bands, thinned
from .contents import Fact, Finding, Report, Section, Table
from .curves import Moment

SIZE = "Size of the innovations (NIS)"


def report_of(
    result: Estimate,
    *,
    record: Record,
    algorithm: Algorithm[Any],
    prior: Prior,
    title: str = "Estimate",
    lead: Sequence[str] = (),
    facts: Sequence[Fact] = (),
    commands: Sequence[tuple[str, str]] = (),
    files: Sequence[Path] = (),
    judged: Estimate | None = None,
    outputs: bool = False,
    smoothed: SmoothedEstimate | None = None,
    detectable: DetectableLoss | None = None,
    tables: Sequence[Table] = (),
    notes: Sequence[str] = (),
) -> Report:
    """Make a report of one `Estimate`, with its record, algorithm and prior.

    - `lead`: sentences at the head of the report. `facts`: numbers below them.
    - `commands`: pairs of what a command does and the command itself.
    - `files`: paths of files whose SHA-256 the report lists.
    - `judged`: another `Estimate` of the record, whose innovations are checked instead. For a change detector this is the
      estimate of the algorithm inside it, because the detector assumes more process noise than the model has.
    - `outputs`: draw each output as measured and as the estimated states imply it (`Estimate.output`), and list the last
      estimates in a table. `smoothed`: the result of `smooth` on the same record, as a second curve.
    - `detectable`: the smallest loss that the record would have shown. Where the input carries no information about a gain, the
      diagram is shaded.
    - `tables`: below the main numbers. `notes`: sentences about what was prepared, among the assumptions.

    Equal arguments give equal reports, byte for byte. Raises `InputError` if the result has no rows over time.
    """
    if result.mean is None or len(result.mean) != len(record):
        checks.refuse('a report needs every row: make the result by `estimate` with keep = "all".')
    rows = thinned(len(record))
    times = np.arange(len(record)) if result.t is None else np.asarray(result.t)
    states = {} if outputs else measured_states(algorithm, record)
    sensors = measured_outputs(result, record) if outputs else None
    charts = charts_of(
        result, states, _moments(result, times), sensors, smoothed, detectable=detectable,
        together=algorithm.innermost.gain_is_effectiveness,
    )  # fmt: skip
    prepared = Section("Preparation", tuple((f"{i}", note) for i, note in enumerate(notes, start=1)))
    sections = sections_of(algorithm, record, prior)
    return Report(
        title, tuple(lead), tuple(facts), times[rows], "sample" if result.t is None else "time [s]", tuple(charts),
        _verdicts(result, judged, record),
        (*([prepared] if notes else []), *sections, versions(result.engine, files)),
        tuple(commands), (last_estimates(result),) if outputs else (), tables=tuple(tables),
    )  # fmt: skip


def measured_outputs(result: Estimate, record: Record) -> dict[str, MeasuredState]:
    """The measurements of each output of a result, by its name with its unit."""
    names, units, found = result.names, dict(record.units), {}
    places = columns(names.outputs, record.outputs, "output", "y", checks.Faults())
    for name, place in zip(names.outputs, places, strict=True):
        unit = units.get(record.outputs[place], "")
        found[names.labelled(name)] = MeasuredState(name, unit, record.y[:, place])
    return found


def last_estimates(result: Estimate) -> Section:
    """The last known values of gains, outputs, states and unknown inputs."""
    when = "" if result.t is None else f", t = {float(result.t[-1]):.6g} s"
    found = in_order([*bands(result), *output_bands(result)])
    items = tuple((f"{kind_of(band)} {band.name}", _last_value(band)) for band in found if band.kind != "innovation")
    return Section(f"At the last sample{when}", items)


def _last_value(band: Band) -> str:
    """The last value that is known, with 2 sigma."""
    known = np.isfinite(band.middle) & (True if band.sigma is None else np.isfinite(band.sigma))
    if not known.any():
        return "not known"
    k = int(np.flatnonzero(known)[-1])
    spread = "" if band.sigma is None else f" ± {2 * band.sigma[k]:.2g} (2 sigma)"
    return f"{band.middle[k]:.6g}{spread}"


def measured_states(algorithm: Algorithm[Any], record: Record) -> dict[str, MeasuredState]:
    """The measurements of each state that an output measures directly: the state itself plus noise."""
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
            found[model.states[i]] = MeasuredState(
                name, dict(record.units).get(record.outputs[place], ""), record.y[:, place]
            )
    return found


def _moments(result: Estimate, times: np.ndarray) -> list[Moment]:
    """The detected changes."""
    if "alarm" not in result.extra:
        return []
    from .. import diagnostics

    return [
        Moment(change.gain, float(times[change.onset]), float(times[change.detected_at]))
        for change in diagnostics.changes(result)
    ]


def _verdicts(result: Estimate, judged: Estimate | None, record: Record) -> tuple[Finding, ...]:
    """The checks of a result; if `judged` is another, its checks, and the size of the innovations of the result."""
    if judged is None or judged is result:
        return (_size(result), *_correlations(result, record))
    without = (_size(judged), *_correlations(judged, record))
    named = (verdict._replace(name=f"{verdict.name}, without detection") for verdict in without)
    return (*named, _size(result)._replace(name=f"{SIZE}, as shown above"))


def _size(result: Estimate) -> Finding:
    """Whether the size of the innovations is consistent with their covariances."""
    try:
        check = nis(result.innovation, result.innovation_covariance)
    except InputError:
        return Finding(SIZE, "no output with measurement noise was seen, so there is nothing to judge", None)
    if check.mean >= check.lower or "alarm" not in result.extra:
        return Finding(SIZE, check.sentence, check.consistent)
    band = check.sentence.split(":")[0]
    cautious = "conservative by design: a detector models persistent process noise, so as not to report it as a change"
    return Finding(SIZE, f"{band}: {cautious}", None)


def _correlations(result: Estimate, record: Record) -> Iterator[Finding]:
    """Whether the innovations are white and uncorrelated with the inputs, if there are enough samples for the tests."""
    try:
        found = check_innovations(result, record)
    except InputError:
        return
    for name, check in found.whiteness.items():
        yield Finding(f"Whiteness of {name}", check.sentence, check.passed)
    for (name, input_name), check in found.cross_correlation.items():
        yield Finding(f"Effect of {input_name} left in {name}", check.sentence, check.passed)


def versions(engine: str, files: Sequence[Path]) -> Section:
    """The software of the report, and the fingerprints of its files."""
    from .. import __version__

    packages = ", ".join(f"{name} {version(name)}" for name in ("jax", "numpy"))
    run = f", engine {engine}" if engine else ""
    made = f"estimable {__version__}{run}, float64; Python {platform.python_version()}, {packages}"
    fingerprints = ((path.name, f"SHA-256 {hashlib.sha256(path.read_bytes()).hexdigest()}") for path in files)
    return Section("Made with", (("Software", made), *fingerprints))
