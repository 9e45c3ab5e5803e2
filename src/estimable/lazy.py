"""Public names that are loaded when they are first asked for."""

import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

ROOT = __name__.partition(".")[0]


def lazy(package: str, homes: Mapping[str, str]) -> Callable[[str], Any]:
    """`__getattr__` of a package (PEP 562): `homes` has the module of each of its names, within estimable.

    A name whose module is of the same name is that module.
    """

    def load(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        home = import_module(f"{ROOT}.{homes[name]}")
        found = home if homes[name] == name else getattr(home, name)
        setattr(sys.modules[package], name, found)
        return found

    return load
