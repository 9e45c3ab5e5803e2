"""Model files: TOML, or Python that defines `model` and `prior`."""

import re
import runpy
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .. import checks, writing
from ..annotations import Tree
from ..frozen import saved
from .actuator import Actuator, Actuators, by_input
from .discretisation import HOLDS
from .nonlinear_model import NonlinearModel
from .operating_point import PARTS
from .prior import Prior
from .state_space import StateSpace
from .uncertainty import ModelUncertainty

MATRICES = ("A", "B", "C", "D", "Q", "R", "G", "S")
KEYS = {
    "model": ("dt", "states", "inputs", "outputs", "angles", *MATRICES),
    "prior": ("mean", "covariance", "diffuse"),
    "operating_point": ("states", "inputs", "outputs"),
    "gain": ("mean", "covariance", "diffuse", "walk", "forgetting", "directions", "fixed", "feedthrough"),
    "record": (
        "time",
        "dt",
        "time_unit",
        "time_format",
        "zone",
        "repeated",
        "grid",
        "start",
        "stop",
        "max_gap",
        "delay",
        "offset",
        "hold",
        "lost",
        "units",
        "angles",
        "na_values",
    ),
    "unknown": ("inputs",),
    "actuators": ("bandwidth", "limits", "rate", "delay", "operating_point", "floats_to"),  # of each input
    "uncertainty": ("A", "B", "C", "relative", "treat"),
    "schedule": ("at", *MATRICES),  # of the section of each channel, such as [schedule.airspeed]
}
SETTINGS = KEYS["gain"][3:]
OPTIONAL = ("gain", "unknown", "record", "actuators", "uncertainty")
REQUIRED = {
    "model": ("dt", "states", "outputs", "A", "C", "R"),
    "prior": ("mean", "covariance"),
    "gain": ("mean", "covariance"),
}
LOST = ("zero", "hold")


@saved
class GainSection(NamedTuple):
    """The section [gain] of a model file: the prior of an unknown gain, and other settings of `UnknownGain`."""

    prior: Prior
    settings: dict[str, Any] = {}  # noqa: RUF012  never changed


@saved
class ModelFile(NamedTuple):
    """The contents of a model file, as read by `read_model`.

    - `model` and `prior`: the model and the prior of its state.
    - `gain`: the section [gain]. None: the file has no such section.
    - `unknown`: the names of the unknown inputs.
    - `record`: arguments of `read_record`.
    - `uncertainty`: the section [uncertainty]. None: the file has no such section.
    - `actuators`: {input: `Actuator`}. The record then holds the commands of these inputs (`through_actuators`).
    """

    model: StateSpace
    prior: Prior
    gain: GainSection | None = None
    unknown: tuple[str, ...] = ()
    record: dict[str, Any] = {}  # noqa: RUF012  never changed
    actuators: dict[str, Actuator] = {}  # noqa: RUF012  never changed
    uncertainty: ModelUncertainty | None = None


def read_model(path: str | Path) -> ModelFile:
    """Read a model file: the model, its prior, and optionally an unknown gain, unknown inputs and options of records.

    A TOML file has the sections [model] (keys dt, states, outputs, A, C, R, and optionally inputs, B, D, Q, G, S) and [prior]
    (mean, covariance, and optionally diffuse). The sections [operating_point], [gain], [record], [unknown], for each
    commanded input [actuators.NAME], and for matrices that follow a channel [schedule.CHANNEL] (at, and tables of A, B, ..)
    are optional.

    A Python file (.py) is executed. It defines `model` (a `StateSpace` or a `NonlinearModel`) and `prior`. It may define
    `gain` (a `GainSection`; for a nonlinear model it describes the parameters), `unknown`, `record` and `actuators`.

    Returns a `ModelFile`. Raises `InputError` if the file does not exist or is not TOML, if a key is missing, unknown or of a
    wrong shape, or if its Python code fails.
    """
    found = checks.existing_file(path)
    try:
        if found.suffix == ".py":
            return _from_python(found)
        with found.open("rb") as file:
            return _from_sections(tomllib.load(file))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        checks.refuse(f"{path} is not TOML: {error}.")
    except checks.InputError as error:
        raise checks.InputError(*(f"{path}: {fault}" for fault in error.faults)) from error.__cause__


def _from_python(path: Path) -> ModelFile:
    try:
        found = runpy.run_path(str(path))
    except checks.InputError:
        raise
    except (Exception, SystemExit) as error:  # any exception of the user's code
        raise checks.InputError(f"its Python code failed: {type(error).__name__}: {error}.") from error
    faults = checks.Faults()
    for name, kinds, words in (
        ("model", (StateSpace, NonlinearModel), "a StateSpace or a NonlinearModel"),
        ("prior", (Prior,), "a Prior"),
    ):
        if not isinstance(found.get(name), kinds):
            faults.add(f"a Python model file must define `{name}`, {words}.")
    faults.finish()
    optional = {name: found[name] for name in OPTIONAL if name in found}
    file = ModelFile(found["model"], found["prior"], **optional)
    _check_file(file, faults)
    faults.finish()
    return file._replace(unknown=tuple(file.unknown))


def _from_sections(sections: dict[str, Any]) -> ModelFile:
    faults = checks.Faults()
    _check_keys(sections, faults)
    faults.finish()
    given = sections["model"]
    try:
        parts = {name: sections[name] for name in ("operating_point", "schedule") if name in sections}
        model = StateSpace(**given, **parts)
    except checks.InputError as error:
        faults.sentences += [f"[model] {fault}" for fault in error.faults]
        model = None
    prior = _prior("prior", sections["prior"], faults)
    gain = sections.get("gain")
    gain_prior = None if gain is None else _prior("gain", gain, faults)
    unknown, record = sections.get("unknown", {}).get("inputs", ()), dict(sections.get("record", {}))
    if model is None or prior is None:
        raise checks.InputError(*faults.sentences)
    section = None
    if gain is not None and gain_prior is not None:
        section = GainSection(gain_prior, {key: gain[key] for key in SETTINGS if key in gain})
    actuators = {name: _actuator(name, given, faults) for name, given in sections.get("actuators", {}).items()}
    uncertainty = _uncertainty(sections.get("uncertainty"), faults)
    faults.finish()
    file = ModelFile(model, prior, section, unknown, record, actuators, uncertainty)
    _check_file(file, faults)
    faults.finish()
    return file._replace(unknown=tuple(unknown))


def _check_keys(sections: dict[str, Any], faults: checks.Faults) -> None:
    for name, section in sections.items():
        if name not in KEYS:
            faults.add(f"a model file has no section [{name}].{checks.suggestion(name, KEYS)}")
        elif not isinstance(section, dict):
            faults.add(f"{name!r} must be a section [{name}] with keys {checks.listed(KEYS[name])}.")
        else:
            _check_section(name, section, faults)
    _check_required(sections, faults)


def _check_required(sections: dict[str, Any], faults: checks.Faults) -> None:
    for name in ("model", "prior"):
        if name not in sections:
            faults.add(f"the section [{name}] is missing.")
    for name, required in REQUIRED.items():
        section = sections.get(name)
        missing = [key for key in required if isinstance(section, dict) and key not in section]
        if missing:
            faults.add(f"[{name}] needs {checks.listed(missing)}.")


def _check_names(section: str, given: Iterable[str], keys: tuple[str, ...], faults: checks.Faults) -> None:
    for key in given:
        if key not in keys:
            near = checks.suggestion(key, keys)
            faults.add(f"[{section}] has no key {key!r}. Its keys are {checks.listed(keys)}.{near}")


def _check_section(name: str, section: dict[str, Any], faults: checks.Faults) -> None:
    if name == "actuators":
        for channel, given in section.items():
            _check_actuator(channel, given, faults)
    elif name != "schedule":
        _check_names(name, section, KEYS[name], faults)


def _check_actuator(channel: str, given: Tree, faults: checks.Faults) -> None:
    """Check the keys of the section [actuators.channel]."""
    if not isinstance(given, dict):
        faults.add(
            f"[actuators] {channel} must be a section [actuators.{channel}] with keys {checks.listed(KEYS['actuators'])}."
        )
        return
    _check_names(f"actuators.{channel}", given, KEYS["actuators"], faults)
    if "bandwidth" not in given:
        faults.add(f"[actuators.{channel}] needs bandwidth, in 1/s (inf: no lag).")


def _actuator(channel: str, given: dict[str, Any], faults: checks.Faults) -> Any:
    try:
        return Actuator(**given)
    except checks.InputError as error:
        faults.sentences += [f"[actuators.{channel}] {fault}" for fault in error.faults]
        return None


def _uncertainty(given: dict[str, Any] | None, faults: checks.Faults) -> ModelUncertainty | None:
    try:
        return None if given is None else ModelUncertainty(**given)
    except checks.InputError as error:
        faults.sentences += [f"[uncertainty] {fault}" for fault in error.faults]
        return None


def _prior(section: str, given: dict[str, Any], faults: checks.Faults) -> Prior | None:
    try:
        return Prior(given["mean"], given["covariance"], diffuse=given.get("diffuse"))
    except checks.InputError as error:
        faults.sentences += [f"[{section}] {fault}" for fault in error.faults]
        return None


def _check_file(file: ModelFile, faults: checks.Faults) -> None:
    """Check that the prior, gain, unknown inputs and record options fit the model."""
    model, prior, gain, unknown, record, _, uncertainty = file
    if prior.size != model.n:
        faults.add(f"[prior] must describe n = {model.n} states: {model.size_source}. Got {prior.size}.")
    for name in faults.names("[unknown] inputs", unknown, "", ""):
        if name not in model.inputs:
            near = checks.suggestion(name, model.inputs)
            inputs = checks.listed(model.inputs)
            faults.add(f"[unknown] names {name!r}, which is not an input of the model. Its inputs are {inputs}.{near}")
    if gain is not None and not isinstance(gain, GainSection):
        faults.add(f"`gain` must be a GainSection(prior, settings). Got {type(gain).__name__}.")
    elif gain is not None:
        _check_names("gain", gain.settings, SETTINGS, faults)
    if uncertainty is not None and faults.instance("uncertainty", uncertainty, ModelUncertainty):
        uncertainty.check(model, faults)
    _check_record(record, faults)
    _check_actuators(file, faults)


def _check_actuators(file: ModelFile, faults: checks.Faults) -> None:
    model, record, actuators = file.model, file.record, file.actuators
    if actuators:
        by_input(actuators, model.inputs, "actuators", faults)
        if isinstance(record, dict) and record.get("hold", HOLDS[0]) != HOLDS[0]:
            faults.add(
                '[record] hold must be "zero_order" with [actuators]: commands are constant from sample to sample.'
            )


def _check_record(record: Any, faults: checks.Faults) -> None:
    if not isinstance(record, dict):
        faults.add(f"[record] must hold {checks.listed(KEYS['record'])}. Got {checks.short(record)}.")
        return
    _check_names("record", record, KEYS["record"], faults)
    faults.choice("[record] hold", record.get("hold", HOLDS[0]), HOLDS)
    faults.choice("[record] lost", record.get("lost", LOST[0]), LOST)
    if "dt" in record:
        faults.number("[record] dt", record["dt"], above=0.0, unit="seconds")
    for name in ("grid", "max_gap"):
        if name in record:
            faults.number(f"[record] {name}", record[name], above=0.0, unit="seconds")
    if not isinstance(record.get("time", ""), str):
        faults.add(f"`[record] time` must be the name of a column. Got {checks.short(record['time'])}.")
    if "na_values" in record:
        faults.array("[record] na_values", record["na_values"], "marks")
    units = record.get("units", {})
    if not (isinstance(units, dict) and all(isinstance(unit, str) for unit in units.values())):
        faults.add(
            f'`[record] units` must be a table of channels and units, such as level = "m". Got {checks.short(units)}.'
        )


def write_model(
    path: str | Path,
    model: StateSpace,
    prior: Prior,
    *,
    gain: GainSection | None = None,
    unknown: tuple[str, ...] = (),
    record: dict[str, Any] | None = None,
    actuators: Actuators | None = None,
    uncertainty: ModelUncertainty | None = None,
) -> None:
    """Write a TOML model file that `read_model` reads back exactly.

    Raises `InputError` with all faults of the call. A model file cannot hold a model that varies in time or has `B_end`:
    use `save` for it.
    """
    import tomli_w

    inputs: tuple[str, ...] = getattr(model, "inputs", ())
    given = dict.fromkeys(inputs, actuators) if isinstance(actuators, Actuator) else dict(actuators or {})
    file = ModelFile(model, prior, gain, unknown, record or {}, given, uncertainty)
    _check_writable(file)
    text = _NUMBERS.sub(_on_one_line, tomli_w.dumps(_plain(_sections_of(file))))
    writing.write(path, lambda stream: stream.write(text.encode()))


def _sections_of(file: ModelFile) -> dict[str, Any]:
    """The sections of the file, without those that are empty."""
    model, point, gain, uncertainty = file.model, file.model.operating_point, file.gain, file.uncertainty
    keys = ("dt", "states", "inputs", "outputs", "A", "B", "C", "D", "G", "Q", "R", "S")
    matrices = {key: getattr(model, key) for key in keys if not _is_default(model, key)}
    angles = {name: [lower, lower + period] for name, lower, period in model.angles}
    sections = {
        "model": matrices | ({"angles": angles} if angles else {}),
        "prior": _prior_section(file.prior),
        "operating_point": point and {part: getattr(point, part) for part in PARTS},
        "schedule": {one.channel: {"at": one.at} | one.tables for one in model.schedule or ()},
        "gain": gain and _prior_section(gain.prior) | gain.settings,
        "record": file.record,
        "unknown": {"inputs": file.unknown} if file.unknown else None,
        "actuators": {name: vars(actuator) for name, actuator in file.actuators.items()},
        "uncertainty": uncertainty and {key: getattr(uncertainty, key) for key in KEYS["uncertainty"]},
    }
    return {name: section for name, section in sections.items() if section}


_NUMBERS = re.compile(r"\[\s*((?:[-+.\deinfa]+,?\s*)+)\]")


def _on_one_line(row: re.Match) -> str:
    """A row of numbers on one line; tomli_w writes one number a line."""
    return "[" + ", ".join(row[1].replace(",", " ").split()) + "]"


def _is_default(model: StateSpace, key: str) -> bool:
    """Whether a matrix is the default of `StateSpace`."""
    if key == "D":
        return not model.D.any()
    return key == "G" and np.array_equal(model.G, np.eye(model.n))


def _check_writable(file: ModelFile) -> None:
    faults = checks.Faults()
    for name, kind in (("model", StateSpace), ("prior", Prior)):
        thing = getattr(file, name)
        if not isinstance(thing, kind):
            faults.add(f"`{name}` must be a {kind.__name__}. Got {type(thing).__name__}.")
    faults.finish()
    if file.model.varying or file.model.B_end is not None:
        faults.add("a model file holds a constant model without `B_end`: use save(path, model) for this one.")
    if any(one.function is not None for one in file.model.schedule or ()):
        faults.add(
            "a model file holds a `schedule` as a table, not as a function: give a table, or write the model in Python."
        )
    if file.model.R is None:
        faults.add("a model file needs `R`, the covariance of the measurement noise.")
    _check_file(file, faults)
    faults.finish()


def _prior_section(prior: Prior) -> dict[str, Any]:
    diffuse = {} if prior.diffuse is None else {"diffuse": prior.diffuse}
    return {"mean": prior.mean, "covariance": prior.covariance, **diffuse}


def _plain(value: Tree) -> Any:
    """Arrays as lists, for TOML."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items() if item is not None}
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, tuple | list):
        return [_plain(item) for item in value]
    return value
