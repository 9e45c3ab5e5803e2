"""Read back what `save` wrote."""

import json
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from types import NoneType
from typing import Any
from zipfile import ZipFile

from .. import checks
from ..annotations import Tree
from ..frozen import field_names, set_field
from . import header, npz_arrays
from .verify import verify


def load(path: str | Path) -> Any:
    """Read back what `save` wrote. Everything in the file is checked, and nothing in it is executed.

    Raises `InputError` if the file does not exist, was not written by `save`, or if its contents are inconsistent.
    """
    found = checks.existing_file(path)
    try:
        with ZipFile(found) as archive:
            npz_arrays.check_sizes(archive, found.stat().st_size)
            return _read(archive)
    except checks.InputError as error:
        raise checks.InputError(*(f"{path}: {sentence}" for sentence in error.faults)) from None
    except (PermissionError, MemoryError) as error:
        checks.refuse(f"{path} could not be read: {getattr(error, 'strerror', None) or 'there is not enough memory'}.")
    except Exception as error:  # a damaged zip, array or header can raise anything
        checks.refuse(f"{path} was not written by estimable.save, or is damaged: {type(error).__name__}.")


def _read(archive: ZipFile) -> Any:
    found = json.loads(str(npz_arrays.read(archive, "header")), parse_constant=_refuse_constant)
    header.check(found)
    reader = Reader(archive, found["modules"])
    thing = reader.decode(found["thing"], "thing")
    if unread := {entry.filename.removesuffix(".npy") for entry in archive.infolist()} - reader.read:
        checks.refuse(f"its header does not mention its entries {checks.listed(sorted(unread))}.")
    return checked(thing, "thing")


def _refuse_constant(name: str) -> Any:
    checks.refuse(f"its header holds {name}, which is not JSON.")


def checked(thing: Tree, where: str) -> Any:
    """The thing, after everything in it is verified."""
    if faults := verify(thing, where):
        checks.refuse(*faults)
    return thing


class Reader:
    """Decodes JSON values into things, with the arrays of the file."""

    def __init__(self, archive: ZipFile, modules: dict[str, str]):
        self.archive, self.modules = archive, modules
        self.read = {"header"}

    def decode(self, code: header.Json, where: str) -> Any:
        """The thing that a JSON value describes."""
        if isinstance(code, list):
            return [self.decode(item, f"{where}[{i}]") for i, item in enumerate(code)]
        if not isinstance(code, dict):
            return code
        kind, content = next(iter(code.items())) if len(code) == 1 else ("", None)
        expected, read = KINDS.get(kind, (NoneType, None))
        if read is None or not isinstance(content, expected):
            checks.refuse(f"{where} is {checks.short(code)}, which `save` does not write.")
        return read(self, content, where)

    def _array(self, name: str, where: str) -> Any:
        self.read.add(name)
        return npz_arrays.read(self.archive, name)

    def _scalar(self, name: str, where: str) -> Any:
        return self._array(name, where)[()]

    def _float(self, text: str, where: str) -> float:
        if text not in ("nan", "inf", "-inf"):
            checks.refuse(
                f"{where} holds the text {text!r} as a number. `save` writes only 'nan', 'inf' and '-inf' as text."
            )
        return float(text)

    def _datetime(self, text: str, where: str) -> datetime:
        try:
            return datetime.fromisoformat(text)
        except ValueError:
            checks.refuse(f"{where} holds {checks.short(text)} as a date, which `save` does not write.")

    def _tuple(self, items: list, where: str) -> tuple:
        return tuple(self.decode(items, where))

    def _dict(self, pairs: list, where: str) -> dict:
        if not all(isinstance(pair, list) and len(pair) == 2 for pair in pairs):
            checks.refuse(f"{where} is a dictionary whose items are not pairs, which `save` does not write.")
        return dict(self.decode(pairs, where))

    def _record(self, code: dict, where: str) -> Any:
        name, fields = code.get("class"), code.get("fields")
        if not isinstance(name, str) or not isinstance(fields, dict):
            checks.refuse(f"{where} is a record without a class or without fields.")
        cls = header.find_class(name, self.modules)
        wanted, fields = field_names(cls), header.ADDED.get(cls.__name__, {}) | fields
        if missing := [field for field in wanted if field not in fields]:
            checks.refuse(f"{where} is of class {name}, whose fields {checks.listed(missing)} are missing.")
        if unknown := [field for field in fields if field not in wanted]:
            checks.refuse(f"{where} is of class {name}, which has no fields {checks.listed(unknown)}.")
        values = [self.decode(fields[field], f"{where}.{field}") for field in wanted]
        if issubclass(cls, tuple):
            return cls(*values)
        thing = object.__new__(cls)
        set_field(thing, **dict(zip(wanted, values, strict=True)))
        return thing

    def _online(self, code: dict, where: str) -> Any:
        progress = checked(self.decode(code, where), where)
        if not hasattr(progress, "resumed"):
            checks.refuse(f"{where} is a run that resumes from {type(progress).__name__}, which `save` does not write.")
        return progress.resumed()


KINDS: dict[str, tuple[type, Callable[[Reader, Any, str], Any]]] = {
    "array": (str, Reader._array),
    "scalar": (str, Reader._scalar),
    "float": (str, Reader._float),
    "datetime": (str, Reader._datetime),
    "tuple": (list, Reader._tuple),
    "dict": (list, Reader._dict),
    "record": (dict, Reader._record),
    "online": (dict, Reader._online),
}
