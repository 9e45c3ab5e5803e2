"""Save and load: one .npz with a JSON header. Known classes only; never pickle."""

import json
from pathlib import Path
from typing import Any

import jax
import numpy as np

from . import catalogue, checks
from .controllers.gain_reconfiguration import GainReconfiguration
from .controllers.proportional_integral import ProportionalIntegral
from .controllers.state_feedback import StateFeedback
from .controllers.tracking import Tracking
from .data.record import Record
from .estimation.fit_noise import NoiseFit
from .estimation.online import Progress
from .estimation.stack import Stacked
from .filters.alpha_beta import Track
from .filters.belief import Belief
from .filters.change_detection import Watch
from .filters.fang_steps import FangState
from .filters.moving_window import Copies
from .filters.smoothed import Average
from .filters.unknown_layout import Layout
from .frozen import leaf_fields, static_fields
from .identifiers.joint_output_error import JointBelief
from .identifiers.recursive_output_error import Recursion
from .kernels.tangents import Dynamics
from .models.armax import ARMAX
from .models.arx import ARX
from .models.controlled import Change, ControlledPlant, Failure
from .models.operating_point import OperatingPoint
from .models.output_error import OutputError
from .models.prior import Prior
from .models.state_space import StateSpace
from .networks.links import BernoulliLink, DelayLink, GilbertElliottLink, PerfectLink
from .networks.trace import Trace
from .protocols import Resumable
from .results import (
    Check,
    Estimate,
    EstimateBank,
    Fit,
    Forecast,
    Info,
    Names,
    Origin,
    Outcome,
    Simulation,
    SmoothedEstimate,
    Validation,
)
from .simulation.close_loop import ClosedLoop, ClosedLoopBank

FORMAT = 1


def has_functions(identifier: catalogue.Entry) -> bool:
    """Whether it always holds functions of the user's, which no file does."""
    return identifier.name == "adaptive-identification"


RECORDS = {
    cls.__name__: cls
    for cls in (
        *(entry.cls for entry in catalogue.ENTRIES), *(one.cls for one in catalogue.IDENTIFIERS if not has_functions(one)),
        StateSpace, OperatingPoint, Prior, Record,
        Average, Belief, Track, Copies, FangState, Watch, Info, Estimate, EstimateBank, Simulation, Stacked, Progress, Forecast,
        NoiseFit, Origin, SmoothedEstimate, OutputError, Recursion, Fit, PerfectLink, BernoulliLink, GilbertElliottLink,
        DelayLink, Trace, ARMAX, ARX, StateFeedback, ProportionalIntegral, GainReconfiguration, JointBelief, Tracking,
        Change, ControlledPlant, Failure,
        ClosedLoop, ClosedLoopBank,
    )
}  # fmt: skip
TUPLES = {cls.__name__: cls for cls in (Check, Dynamics, Layout, Names, Outcome, Validation)}


def save(path: str | Path, thing: Any) -> None:
    """Write an algorithm, model, prior, record, result or a running `online` to one .npz file, exactly.

    Raises `InputError` for a thing of another kind.
    """
    arrays: dict[str, np.ndarray] = {}
    header = {"estimable": FORMAT, "thing": _encode(thing, "thing", arrays)}
    try:
        with Path(path).open("wb") as file:
            np.savez_compressed(file, header=np.array(json.dumps(header)), **arrays)  # type: ignore[arg-type]
    except (OSError, TypeError) as error:
        checks.refuse(f"{path} could not be written: {error}.")


def load(path: str | Path) -> Any:
    """Read back what `save` wrote.

    Raises `InputError` where the file is not there or was not written by `save`.
    """
    found = checks.existing_file(path)
    try:
        with found.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            header = json.loads(str(file["header"]))
            if header["estimable"] != FORMAT:
                checks.refuse(f"{path} has format {header['estimable']}; this version reads format {FORMAT}.")
            return _decode(header["thing"], file)
    except checks.InputError:
        raise
    except Exception as error:  # a damaged file may fail anywhere: in its zip, an array, the header or a record
        checks.refuse(f"{path} was not written by estimable.save, or is damaged: {type(error).__name__}.")


def _encode(thing: Any, where: str, arrays: dict[str, np.ndarray]) -> Any:
    """A JSON value; numbers in arrays are put aside under their path."""
    if isinstance(thing, Resumable):
        return {"online": _encode(thing.progress, where, arrays)}
    name = type(thing).__name__
    if RECORDS.get(name) is type(thing):
        fields = (*leaf_fields(type(thing)), *static_fields(type(thing)))
        return {"record": name, "fields": {f: _encode(getattr(thing, f), f"{where}.{f}", arrays) for f in fields}}
    if isinstance(thing, np.ndarray | jax.Array | np.generic):
        arrays[where] = np.asarray(thing)
        return {"array": where}
    if isinstance(thing, tuple):
        kind = name if TUPLES.get(name) is type(thing) else "tuple"
        return {"tuple": kind, "items": [_encode(item, f"{where}.{i}", arrays) for i, item in enumerate(thing)]}
    if isinstance(thing, dict):
        return {"dict": {key: _encode(value, f"{where}.{key}", arrays) for key, value in thing.items()}}
    if thing is None or isinstance(thing, bool | int | float | str):
        return {"value": thing}
    checks.refuse(f"`thing` must be one of {checks.listed(RECORDS)} or a running online. Got {name} (at {where}).")


def _decode(code: Any, arrays) -> Any:
    if "online" in code:
        return _decode(code["online"], arrays).resumed()
    if "array" in code:
        return arrays[code["array"]]
    if "tuple" in code:
        items = [_decode(item, arrays) for item in code["items"]]
        return tuple(items) if code["tuple"] == "tuple" else TUPLES[code["tuple"]](*items)
    if "dict" in code:
        return {key: _decode(value, arrays) for key, value in code["dict"].items()}
    if "value" in code:
        return code["value"]
    cls = RECORDS[code["record"]]
    thing = object.__new__(cls)
    for field in (*leaf_fields(cls), *static_fields(cls)):
        object.__setattr__(thing, field, _decode(code["fields"][field], arrays))
    return thing
