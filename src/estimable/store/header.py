"""What a file says of itself: its format, and the classes of the records in it."""

import re
from collections.abc import Mapping
from importlib import import_module
from typing import Any, TypeAlias

from .. import __version__, checks
from ..annotations import Tree
from ..frozen import PACKAGE, RECORDS
from ..protocols import Resumable

Json: TypeAlias = Mapping[str, "Json"] | list["Json"] | str | float | None  # what a JSON text holds

FORMAT = 2
# For older files: (module, class) as they say it: (module, class) of today; class: fields that they lack, as they would say them.
MOVED: dict[tuple[str, str], tuple[str, str]] = {}
ADDED: dict[str, dict[str, Any]] = {}
MODULE = re.compile(r"[a-z][a-z0-9_]*(\.[a-z][a-z0-9_]*)*")
FIELDS = {"format", "estimable", "modules", "thing"}


def record_class(thing: Tree | Resumable) -> type | None:
    """The class under which a thing is saved: its own, or the first base that is a record; None where it has none."""
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
    """Refuse a header of another format, or of another form."""
    if not isinstance(header, dict):
        checks.refuse("its header is no JSON object.")
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
    """The class of a record that a file names; only the package's own modules are imported."""
    said = modules.get(name)
    if said is None:
        checks.refuse(f"its header names no module of {name!r}.")
    module, name = MOVED.get((said, name), (said, name))
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
