"""Model files: TOML, or Python that defines `model` and `prior`."""

import runpy
import tomllib
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .. import checks
from .prior import Prior
from .state_space import StateSpace

MATRICES = ("A", "B", "C", "D", "Q", "R", "G", "S")
KEYS = {
    "model": ("dt", "states", "inputs", "outputs", *MATRICES),
    "prior": ("mean", "covariance", "diffuse"),
    "operating_point": ("states", "inputs", "outputs"),
    "gain": ("mean", "covariance", "walk", "forgetting", "directions", "fixed", "feedthrough"),
    "record": ("time", "dt", "hold", "lost"),
    "unknown": ("inputs",),
}
REQUIRED = {"model": ("dt", "states", "outputs", "A", "C", "R"), "prior": ("mean", "covariance"), "gain": ("mean", "covariance")}


class GainSection(NamedTuple):
    """What a model file says of an unknown gain: its prior, and the settings of `UnknownGain`."""

    prior: Prior
    settings: dict[str, Any]


class ModelFile(NamedTuple):
    """What a model file holds. `gain` is None where it says nothing of one; `record` holds arguments of `read_record`."""

    model: StateSpace
    prior: Prior
    gain: GainSection | None = None
    unknown: tuple[str, ...] = ()
    record: dict[str, Any] = {}  # noqa: RUF012  never changed


def read_model(path: str | Path) -> ModelFile:
    """The model, prior, gain, unknown inputs and record options in a model file.

    TOML: sections [model] (dt, states, outputs, A, C, R; also inputs, B, D, Q, G, S) and [prior] (mean, covariance; also
    diffuse) are required; [operating_point], [gain], [record] and [unknown] are optional. A `.py` file defines `model`
    and `prior`, and may define `gain` (a `GainSection`), `unknown` and `record`; it is run.

    Raises `InputError` where the file is not there, is not TOML, or a key is missing, unknown or of a wrong shape.
    """
    path = Path(path)
    if not path.is_file():
        checks.refuse(f"the model file {path} is not there.")
    try:
        if path.suffix == ".py":
            return _from_python(path)
        with path.open("rb") as file:
            return _from_sections(tomllib.load(file))
    except tomllib.TOMLDecodeError as error:
        checks.refuse(f"{path} is not TOML: {error}.")
    except checks.InputError as error:
        raise checks.InputError(*(f"{path}: {fault}" for fault in error.faults)) from None


def _from_python(path: Path) -> ModelFile:
    found = runpy.run_path(str(path))
    faults = checks.Faults()
    for name, kind in (("model", StateSpace), ("prior", Prior)):
        if not isinstance(found.get(name), kind):
            faults.add(f"a Python model file must define `{name}`, a {kind.__name__}.")
    faults.finish()
    optional = {name: found[name] for name in ("gain", "unknown", "record") if name in found}
    return ModelFile(found["model"], found["prior"], **optional)


def _from_sections(sections: dict[str, Any]) -> ModelFile:
    faults = checks.Faults()
    _check_keys(sections, faults)
    faults.finish()
    given = sections["model"]
    try:
        model = StateSpace(**given, operating_point=sections.get("operating_point"))
    except checks.InputError as error:
        faults.sentences += [f"[model] {fault}" for fault in error.faults]
        model = None
    prior = _prior("prior", sections["prior"], faults)
    gain = sections.get("gain")
    gain_prior = None if gain is None else _prior("gain", gain, faults)
    unknown = tuple(sections.get("unknown", {}).get("inputs", ()))
    _check_unknown(unknown, model, faults)
    faults.finish()
    assert model is not None and prior is not None
    if prior.size != model.n:
        checks.refuse(f"[prior] must describe n = {model.n} states: `A` is {model.n} × {model.n}. Got {prior.size}.")
    section = None
    if gain is not None and gain_prior is not None:
        section = GainSection(gain_prior, {key: gain[key] for key in KEYS["gain"][2:] if key in gain})
    return ModelFile(model, prior, section, unknown, dict(sections.get("record", {})))


def _check_keys(sections: dict[str, Any], faults: checks.Faults) -> None:
    for name, section in sections.items():
        if name not in KEYS:
            faults.add(f"there is no section [{name}] in a model file.{checks.suggestion(name, KEYS)}")
        elif not isinstance(section, dict):
            faults.add(f"{name!r} must be a section [{name}] with keys {checks.listed(KEYS[name])}.")
        else:
            for key in section:
                if key not in KEYS[name]:
                    faults.add(f"[{name}] has no key {key!r}. Its keys are {checks.listed(KEYS[name])}.{checks.suggestion(key, KEYS[name])}")
    for name in ("model", "prior"):
        if name not in sections:
            faults.add(f"the section [{name}] is missing.")
    for name, required in REQUIRED.items():
        section = sections.get(name)
        missing = [key for key in required if isinstance(section, dict) and key not in section]
        if missing:
            faults.add(f"[{name}] needs {checks.listed(missing)}.")


def _prior(section: str, given: dict[str, Any], faults: checks.Faults) -> Prior | None:
    try:
        return Prior(given["mean"], given["covariance"], diffuse=given.get("diffuse"))
    except checks.InputError as error:
        faults.sentences += [f"[{section}] {fault}" for fault in error.faults]
        return None


def _check_unknown(unknown: tuple[str, ...], model: StateSpace | None, faults: checks.Faults) -> None:
    for name in unknown if model is not None else ():
        if name not in model.inputs:
            faults.add(f"[unknown] names {name!r}, which is no input of the model: {checks.listed(model.inputs)}.")


def write_model(
    path: str | Path,
    model: StateSpace,
    prior: Prior,
    *,
    gain: GainSection | None = None,
    unknown: tuple[str, ...] = (),
    record: dict[str, Any] | None = None,
) -> None:
    """Write a TOML model file that `read_model` reads back to the last bit.

    Raises `InputError` where the model varies in time, or has a `B_end`: such a model has no place in a file.
    """
    import tomli_w

    if model.varying or model.B_end is not None:
        checks.refuse("a model file holds a constant model without `B_end`: use save(path, model) for this one.")
    S = {} if model.S is None else {"S": model.S}
    if model.R is None:
        checks.refuse("a model file needs `R`, the covariance of the measurement noise.")
    sections: dict[str, Any] = {
        "model": {"dt": model.dt, "states": model.states, "inputs": model.inputs, "outputs": model.outputs, "A": model.A,
                  "B": model.B, "C": model.C, "D": model.D, "G": model.G, "Q": model.Q, "R": model.R, **S},
        "prior": _prior_section(prior),
    }  # fmt: skip
    if model.operating_point is not None:
        point = model.operating_point
        sections["operating_point"] = {"states": point.states, "inputs": point.inputs, "outputs": point.outputs}
    if gain is not None:
        sections["gain"] = _prior_section(gain.prior) | gain.settings
    if record:
        sections["record"] = record
    if unknown:
        sections["unknown"] = {"inputs": unknown}
    Path(path).write_text(tomli_w.dumps(_plain(sections)))


def _prior_section(prior: Prior) -> dict[str, Any]:
    diffuse = {} if prior.diffuse is None else {"diffuse": prior.diffuse}
    return {"mean": prior.mean, "covariance": prior.covariance, **diffuse}


def _plain(value: Any) -> Any:
    """Arrays as lists, for TOML."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items() if item is not None}
    if isinstance(value, np.ndarray | tuple | list):
        return [_plain(item) for item in (value.tolist() if isinstance(value, np.ndarray) else value)]
    return value
