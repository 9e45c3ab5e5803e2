"""Run a filter of the catalogue on a record and a model file."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .. import catalogue, checks, diagnostics
from ..data.record import Record
from ..data.through_actuators import through_actuators
from ..models.files import ModelFile
from ..models.prior import Prior
from ..models.state_space import StateSpace
from ..results import Estimate, GainAssessment, Names, SmoothedEstimate
from .judging import estimate_between_changes
from .settings import read_settings, settings_in_force


class FilterRun(NamedTuple):
    """A run: the name of the filter, the algorithm, the prior of the state, the record, the estimate; the files of the record
    and the model, how the record was read, and the given settings.

    `judged`: the estimate whose innovations show whether the model explains the record. For a change detector (which counts
    process noise many times) it is that of the algorithm inside, restarted at each detected change; else `result`.
    `commanded`: the record holds commands, which actuators of the model file turned into positions.
    `assessment`: the whole chain, where `run_gain` ran it. `smoothed`: the result of the smoother, where it was asked for.
    """

    filter: str
    algorithm: Any
    prior: Prior
    record: Record
    result: Estimate
    record_path: Path
    model_path: Path
    reading: dict[str, Any]
    settings: dict[str, Any]
    judged: Estimate
    commanded: bool = False
    assessment: GainAssessment | None = None
    smoothed: SmoothedEstimate | None = None


def as_data(run: FilterRun) -> dict[str, Any]:
    """The JSON of the run that is common to all commands that run a filter."""
    result = run.result
    return {
        "outcome": {"code": result.outcome.code, "sentence": result.outcome.sentence},
        "record": str(run.record_path),
        "model": str(run.model_path),
        "filter": run.filter,
        "settings": settings_in_force(run.algorithm),
        "engine": result.engine,
        "samples": len(run.record),
        "seconds": run.record.seconds,
        "gaps": [gap.sentence for gap in result.gaps],
        "notes": list(run.record.notes),
    }


def record_options(section: dict[str, Any], given: dict[str, Any]) -> dict[str, Any]:
    """How to read a record: the options of the model file, replaced by those given (not None).

    A given step replaces the file's time column, and a given time column the file's step: either determines the times.

    >>> record_options({"time": "t", "hold": "zero_order"}, {"time": None, "dt": 0.1, "hold": None})
    {'hold': 'zero_order', 'dt': 0.1}
    """
    given = {name: value for name, value in given.items() if value is not None}
    replaced = {"time", "dt"} if given.keys() & {"time", "dt"} else set()
    return {name: value for name, value in section.items() if name not in replaced} | given


def read_measured(
    file: ModelFile, path: Path, names: Names, reading: dict[str, Any] | None = None
) -> tuple[Record, dict[str, Any]]:
    """The record in the columns `names`, and the options it was read with: those of the model file, replaced by `reading`."""
    from ..data.reading import read_record

    options = record_options(file.record, reading or {})
    if not options.keys() & {"time", "dt"} and not file.model.is_continuous:
        options["dt"] = file.model.dt
    unmeasured = names.unknown_inputs
    if unmeasured and "units" in options:
        options["units"] = {channel: unit for channel, unit in options["units"].items() if channel not in unmeasured}
    if not options.keys() & {"time", "dt"}:
        checks.refuse(
            f"the model is continuous, and the times of the samples of {path} are not given: give --time NAME (a column) "
            "or --dt SECONDS, or either in section [record] of the model file."
        )
    others = (*names.outputs, *names.inputs)
    followed = tuple(name for name in file.model.scheduled_by if name not in others)
    record = read_record(path, outputs=names.outputs + followed, inputs=names.inputs, **options)
    return positions(record, file), options


def positions(record: Record, file: ModelFile) -> Record:
    """The record with positions in place of the commands of the file's actuators."""
    known = {name: actuator for name, actuator in file.actuators.items() if name in record.inputs}
    return through_actuators(record, known) if known else record


def gain_filter(file: ModelFile) -> str:
    """The default filter of a gain: it detects changes if the prior of the gain says how large they may be."""
    sizes = () if file.gain is None else np.diagonal(file.gain.prior.covariance)
    return "change-detection" if np.all(np.asarray(sizes) > 0) else "unknown-gain"


def has_unknown_gain(file: ModelFile) -> bool:
    """Whether the whole chain applies: a linear model with a gain that its prior does not know exactly."""
    return isinstance(file.model, StateSpace) and file.gain is not None and gain_filter(file) == "change-detection"


def run_filter(
    name: str | None,
    record: Path,
    model: Path,
    *,
    settings: Iterable[str] = (),
    unknown: Iterable[str] = (),
    reading: dict[str, Any] | None = None,
    file: ModelFile | None = None,
    smoothing: bool = False,
) -> FilterRun:
    """Read a model file and a record, and run the filter `name` of the catalogue (None: `gain_filter`).

    `settings`: texts name=value. `unknown`: unmeasured inputs. `reading`: arguments of `read_record` that
    replace those in the model file. `file`: the contents of `model`, if it has been read. `smoothing`: run the smoother too.

    Raises `InputError` for faults of the files and settings, `RunError` if the computation fails.
    """
    from ..estimation.estimate import estimate
    from ..estimation.smooth import smooth
    from ..models.files import read_model

    if name is not None:
        asked = catalogue.entry(name)
        name = asked.name
        if asked.kind != "filter":
            filters = [entry.name for entry in catalogue.ENTRIES if entry.kind == "filter"]
            checks.refuse(f"{name} is not a filter. The filters are {checks.listed(filters)}.")
    chosen = read_settings(settings)
    if unknown:
        chosen["unknown"] = tuple(unknown)
    file = read_model(model) if file is None else file
    name = gain_filter(file) if name is None else name
    algorithm = catalogue.build(name, file, **chosen)
    measured, options = read_measured(file, record, algorithm.names, reading)
    result = estimate(algorithm, measured, prior=file.prior)
    judged = result
    if name == "change-detection":
        onsets = [change.onset for change in diagnostics.changes(result)]
        judged = estimate_between_changes(algorithm.algorithm, measured, file.prior, onsets)
    return FilterRun(
        name, algorithm, file.prior, measured, result, record, model, options, chosen, judged, bool(file.actuators),
        smoothed=smooth(algorithm, measured, prior=file.prior) if smoothing else None,
    )  # fmt: skip


def run_gain(
    record: Path,
    model: Path,
    *,
    reading: dict[str, Any] | None = None,
    healthy: tuple[float, float] | None = None,
    offset: bool = True,
    file: ModelFile | None = None,
) -> FilterRun:
    """Read a model file and a record, and run the whole chain: `assess_gain`. Other arguments and errors are those of
    `run_filter`.
    """
    from ..estimation.assess_gain import assess_gain
    from ..models.files import read_model

    file = read_model(model) if file is None else file
    algorithm = catalogue.build("unknown-gain", file, walk=0.0, forgetting=1.0)
    measured, options = read_measured(file, record, algorithm.names, reading)
    found = assess_gain(algorithm, measured, prior=file.prior, healthy=healthy, offset=offset)
    onsets = [change.onset for change in diagnostics.changes(found.result)]
    judged = estimate_between_changes(found.plain, measured, file.prior, onsets)
    given = {name: value for name, value in (("healthy", healthy), ("offset", offset)) if value not in (None, True)}
    return FilterRun(
        "mixture", found.algorithm, file.prior, measured, found.result, record, model, options, given, judged,
        bool(file.actuators), found,
    )  # fmt: skip
