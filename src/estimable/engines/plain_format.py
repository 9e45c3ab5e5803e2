"""Lowered steps as JSON and back: the format cannot hold executable code.

A value without a JSON type is {its kind: its content}. A row of records of one class is written column by column, which is
many times faster to read than record by record.
"""

import dataclasses
import importlib
import json
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from ..frozen import field_names
from .program.primitives import UnsupportedError

PLAIN = (type(None), bool, int, float, str)
PACKAGE = __name__.partition(".")[0]
_LAX = (jax.lax.GatherDimensionNumbers, jax.lax.ScatterDimensionNumbers, jax.lax.GatherScatterMode, jax.lax.RoundingMethod,
        jax.lax.Precision)  # fmt: skip
OF_JAX = {(kind.__module__, kind.__qualname__): kind for kind in _LAX}


def dumps(value: Any) -> bytes:
    """The JSON of a value. Raises `TypeError` where it holds anything but arrays, records and plain values."""
    return json.dumps(_written(value), separators=(",", ":")).encode()


def loads(text: bytes) -> Any:
    """The value. Raises `ValueError` where the text is not such JSON."""
    try:
        return _read(json.loads(text))
    except (ValueError, TypeError, AttributeError, LookupError, ImportError, RecursionError) as reason:
        raise ValueError("the text is not a record of the operations of a step") from reason


def _written(value: Any) -> Any:
    kind = type(value)
    if kind in PLAIN:
        return value
    if kind is tuple and len(value) > 1 and _is_record(type(value[0])) and len(set(map(type, value))) == 1:
        return {"rows": [_name(type(value[0])), [_column(column) for column in zip(*map(_fields, value), strict=True)]]}
    if kind in WRITERS:
        name, write = WRITERS[kind]
        return {name: write(value)}
    if isinstance(value, np.dtype):
        return {"dtype": _dtype(value)}
    if isinstance(value, np.generic):
        return {"number": [_dtype(value.dtype), value.item()]}
    if (kind.__module__, kind.__qualname__) in OF_JAX and not isinstance(value, tuple):
        return {"enum": [_name(kind), value.name]}
    if _is_record(kind):
        return {_name(kind): [_written(field) for field in _fields(value)]}
    raise TypeError(f"{kind.__name__} has no plain form")


def _column(values: tuple) -> Any:
    """A field of many records: plain values, tuples of them, or other values."""
    if all(type(value) in PLAIN for value in values):
        return ["plain", values]
    if all(type(value) is tuple and all(type(part) in PLAIN for part in value) for value in values):
        return ["tuples", values]
    return ["each", [_written(value) for value in values]]


def _read(value: Any) -> Any:
    if not isinstance(value, dict):
        return value
    ((name, held),) = value.items()
    if name in READERS:
        return READERS[name](held)
    return _make(_class(name), [_read(field) for field in held])


def _rows(held: list) -> tuple:
    kind, columns = _class(held[0]), held[1]
    fields = [COLUMNS[how](values) for how, values in columns]
    if issubclass(kind, tuple):
        return tuple(map(kind, *fields))
    return tuple(_make(kind, row) for row in zip(*fields, strict=True))


COLUMNS: dict[str, Callable[[list], Any]] = {
    "plain": lambda values: values, "tuples": lambda values: map(tuple, values), "each": lambda values: map(_read, values),
}  # fmt: skip
WRITERS: dict[type, tuple[str, Callable[[Any], Any]]] = {
    tuple: ("tuple", lambda value: [_written(part) for part in value]),
    list: ("list", lambda value: [_written(part) for part in value]),
    dict: ("dict", lambda value: [[_written(key), _written(part)] for key, part in value.items()]),
    np.ndarray: ("array", lambda value: [_dtype(value.dtype), value.shape, value.ravel().tolist()]),
    jax.ShapeDtypeStruct: ("form", lambda value: [value.shape, _dtype(value.dtype)]),
    UnsupportedError: ("unsupported", lambda value: [str(part) for part in value.args]),
}
READERS: dict[str, Callable[[Any], Any]] = {
    "tuple": lambda held: tuple([_read(part) for part in held]),
    "list": lambda held: [_read(part) for part in held],
    "dict": lambda held: {_read(key): _read(part) for key, part in held},
    "array": lambda held: np.array(held[2], _numbers(held[0])).reshape(held[1]),
    "number": lambda held: _numbers(held[0]).type(held[1]),
    "dtype": lambda held: _numbers(held),
    "form": lambda held: jax.ShapeDtypeStruct(tuple(held[0]), _numbers(held[1])),
    "unsupported": lambda held: UnsupportedError(*held),
    "enum": lambda held: _class(held[0])[held[1]],
    "rows": _rows,
}


def _dtype(dtype: np.dtype) -> str:
    if dtype.kind not in "fiubc":
        raise TypeError(f"entries of the kind {dtype} have no plain form")
    return dtype.str


def _numbers(name: str) -> np.dtype:
    """The dtype of this name, if it is numeric."""
    return np.dtype(_dtype(np.dtype(name)))


def _is_record(kind: type) -> bool:
    """Whether its fields determine it: a record of this package, or one of JAX."""
    own = kind.__module__.partition(".")[0] == PACKAGE or (kind.__module__, kind.__qualname__) in OF_JAX
    return own and (dataclasses.is_dataclass(kind) or (issubclass(kind, tuple) and hasattr(kind, "_fields")))


def _fields(value: Any) -> tuple:
    return tuple([getattr(value, name) for name in field_names(type(value))])


def _name(kind: type) -> str:
    return f"{kind.__module__}:{kind.__qualname__}"


def _class(name: str) -> Any:
    module, _, qualified = name.partition(":")
    if (module, qualified) in OF_JAX:
        return OF_JAX[module, qualified]
    kind = getattr(importlib.import_module(module), qualified) if module.partition(".")[0] == PACKAGE else None
    if not isinstance(kind, type) or not _is_record(kind):
        raise TypeError(f"{name} is not a record")
    return kind


def _make(kind: Any, fields: Any) -> Any:
    """A record with these fields, without the checks of its constructor: they hold shapes instead of numbers."""
    if issubclass(kind, tuple):
        return kind(*fields)
    made = object.__new__(kind)
    for name, value in zip(field_names(kind), fields, strict=True):
        object.__setattr__(made, name, value)
    return made
