"""Write a record to a file."""

import json
import math
import re
from datetime import datetime
from pathlib import Path
from types import NoneType
from typing import Any, TypeAlias, TypeGuard

import jax
import numpy as np

from .. import checks, writing
from ..annotations import Array, Tree
from ..frozen import field_names
from . import header, npz_arrays
from .resumable import Resumable
from .verify import verify

Thing: TypeAlias = Tree | Resumable
PLAIN = (NoneType, bool, int, float, str)


def save(path: str | Path, thing: Thing) -> None:
    """Write an object to a .npz file, from which `load` reads back exactly the same object.

    The object is an algorithm, a model, a prior, a record, a result, a run made by `online`, or a tuple, list or dictionary
    of these. An existing file of that name is replaced only when the new one is complete.

    Raises `InputError` for values that a file cannot hold, such as a function, and if the file cannot be written.
    """
    writer = Writer()
    code = writer.encode(thing, "thing")
    if faults := verify(thing, "thing"):
        checks.refuse(*(f"`thing` cannot be saved: {fault}" for fault in faults))
    text = np.array(json.dumps(header.described(writer.modules, code), allow_nan=False))
    writing.write(path, lambda stream: np.savez_compressed(stream, header=text, **writer.arrays))


def _is_plain(thing: Thing) -> TypeGuard[str | float | None]:
    return type(thing) in PLAIN


class Writer:
    """Encodes things as JSON, and collects their arrays under the paths of their fields."""

    def __init__(self):
        self.arrays: dict[str, Any] = {}
        self.modules: dict[str, str] = {}

    def encode(self, thing: Thing, where: str) -> header.Json:
        """A thing as a JSON value."""
        if isinstance(thing, jax.Array | np.generic) or type(thing) is np.ndarray:
            return self._array(thing, where)
        if type(thing) is tuple or type(thing) is list:
            items = [self.encode(item, f"{where}[{i}]") for i, item in enumerate(thing)]
            return items if type(thing) is list else {"tuple": items}
        if type(thing) is dict:
            return {"dict": [[self.encode(k, where), self.encode(v, f"{where}[{k!r}]")] for k, v in thing.items()]}
        if type(thing) is float and not math.isfinite(thing):
            return {"float": str(thing)}
        if isinstance(thing, datetime):
            return {"datetime": thing.isoformat()}
        return thing if _is_plain(thing) else self._record(thing, where)

    def _record(self, thing: Thing, where: str) -> dict[str, header.Json]:
        if (cls := header.record_class(thing)) is not None:
            self.modules[cls.__name__] = header.module_of(cls)
            fields = {name: self.encode(getattr(thing, name), f"{where}.{name}") for name in field_names(cls)}
            return {"record": {"class": cls.__name__, "fields": fields}}
        if callable(thing):
            what = "class" if isinstance(thing, type) else "function"
            checks.refuse(f"`thing` cannot be saved: {where} is a {what}, which a file cannot hold.")
        if isinstance(thing, Resumable):
            return {"online": self.encode(thing.progress, where)}
        kind = f"{type(thing).__module__}.{type(thing).__qualname__}".removeprefix("builtins.")
        checks.refuse(
            f"`thing` cannot be saved: {where} is of type {kind}. "
            "A file can hold records of estimable, arrays, numbers and strings."
        )

    def _array(self, thing: Array | np.generic, where: str) -> dict[str, header.Json]:
        if getattr(thing.dtype, "kind", None) not in npz_arrays.KINDS:  # a random key has none
            checks.refuse(f"`thing` cannot be saved: {where} is an array of {thing.dtype}.")
        entry = re.sub(r"[^\w.\[\]-]", "_", where.replace("'", ""))
        while entry in self.arrays:
            entry += "_"
        self.arrays[entry] = np.asarray(thing)
        return {"scalar" if isinstance(thing, np.generic) else "array": entry}
