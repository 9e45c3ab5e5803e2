"""The header of a file: its format, and the classes of its records."""

import re
from collections.abc import Mapping
from importlib import import_module
from typing import Any, TypeAlias

from .. import __version__, checks
from ..annotations import Tree
from ..frozen import PACKAGE, RECORDS
from .resumable import Resumable

Json: TypeAlias = Mapping[str, "Json"] | list["Json"] | str | float | None  # the values of a JSON text

FORMAT = 2
# For older files. MOVED: {old (module, class): current (module, class)}; ADDED: {class: values of fields they lack}.
MOVED: dict[tuple[str, str], tuple[str, str]] = {
    ("estimation.online", "Progress"): ("estimation.online_run", "Progress"),
}
ADDED: dict[str, dict[str, Any]] = {
    "StateSpace": {"schedule": None, "disturbance": None, "angles": ()},
    "Kalman": {"uncertainty": None},
    "UnknownGain": {"uncertainty": None},
    "ExtendedKalman": {"uncertainty": None},
    "SecondOrderKalman": {"uncertainty": None},
    "UnscentedKalman": {"uncertainty": None},
    "ModelUncertainty": {"parameters": None},
    "ModelFile": {"uncertainty": None},
    "DetectableLoss": {"intervals": ()},
    "GainAssessment": {"rows": ()},
    "Progress": {"schedule": None, "gaps": None},
    "Fit": {"covariance_white": None, "rivals": None},
    "Validation": {"scores": ()},
    "OutputError": {"level": None},
    "OutputErrorML": {"level": "none"},
    "Names": {"angles": ()},
    "ClosedLoop": {"schedule": None},
    "Estimate": {"gaps": ()},
    "EstimateBank": {"gaps": ()},
    "SmoothedEstimate": {"origin": None, "gaps": ()},
    "Record": {
        "breaks": (),
        "origin": None,
        "grid": None,
        "placing": (),
        "sources": (),
        "notes": (),
        "sigma": None,
        "angles": (),
    },
}
MODULE = re.compile(r"[a-z][a-z0-9_]*(\.[a-z][a-z0-9_]*)*")
FIELDS = {"format", "estimable", "modules", "thing"}


def record_class(thing: Tree | Resumable) -> type | None:
    """The class under which a thing is saved: its own, or the first base that is a record; None if there is none."""
    if type(thing).__module__.partition(".")[0] != PACKAGE:
        return None
    return next((cls for cls in type(thing).__mro__ if RECORDS.get(cls.__name__) is cls), None)


def module_of(cls: type) -> str:
    """The module of a record, within the package."""
    return cls.__module__.partition(".")[2]


def described(modules: dict[str, str], code: Json) -> Mapping[str, Json]:
    """The header of a file."""
    return {"format": FORMAT, "estimable": __version__, "modules": modules, "thing": code}


def check(header: Json) -> None:
    """Refuse a header with an unknown format or wrong keys."""
    if not isinstance(header, dict):
        checks.refuse("its header is not a JSON object.")
    found = header.get("format", header.get("estimable"))
    if found != FORMAT:
        checks.refuse(f"it has format {checks.short(found)}; this version reads format {FORMAT}.")
    if wrong := FIELDS ^ set(header):
        keys = f"its header must have the keys {checks.listed(sorted(FIELDS))}"
        checks.refuse(f"{keys}. Missing or unknown: {checks.listed(sorted(wrong))}.")
    modules = header["modules"]
    if not isinstance(modules, dict) or not all(isinstance(module, str) for module in modules.values()):
        checks.refuse("`modules` of its header must name a module for each class.")


def find_class(name: str, modules: dict[str, str]) -> type:
    """The class of a record in a file; only modules of this package are imported."""
    written = modules.get(name)
    if written is None:
        checks.refuse(f"its header names no module for {name!r}.")
    module, name = MOVED.get((written, name), (written, name))
    if MODULE.fullmatch(module) and module.partition(".")[0] != "commands":
        try:
            import_module(f"{PACKAGE}.{module}")
        except ModuleNotFoundError as error:
            if not str(error.name).startswith(PACKAGE):
                raise
        cls = RECORDS.get(name)
        if cls is not None and module_of(cls) == module:
            return cls
    checks.refuse(f"it holds a {name!r} of {PACKAGE}.{module}, which estimable {__version__} does not have.")
