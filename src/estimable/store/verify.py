"""Checks of a loaded record: the kinds of its fields, consistent shapes, and the checks of its constructor."""

import dataclasses
from typing import Any

import jax
import numpy as np

from .. import checks
from ..annotations import AnyRecord, Tree
from ..frozen import field_names
from .axes import Axes, Shape, asymmetry
from .declared import Declared, declared, may_hold, worded
from .resumable import Resumable

ARRAYS = np.ndarray | jax.Array | np.generic | float | int


def verify(thing: Tree | Resumable, where: str, batch: Shape = ()) -> list[str]:
    """All faults of a thing and its contents. `batch`: leading axes of all its arrays, which its constructor does not allow."""
    if isinstance(thing, Resumable):
        return verify(thing.progress, where)
    if field_names(type(thing)):
        return _of_record(thing, where, batch)
    if isinstance(thing, tuple | list | dict):
        items = thing.items() if isinstance(thing, dict) else enumerate(thing)
        return [fault for key, value in items for fault in verify(value, f"{where}[{key!r}]", batch)]
    return []


def _of_record(thing: Tree, where: str, batch: Shape) -> list[str]:
    fields = declared(type(thing))
    faults = [
        f"`{field.name}` must be {worded(field.kind)}. Got {checks.short(getattr(thing, field.name))}."
        for field in fields
        if not may_hold(field.kind, getattr(thing, field.name))
    ]
    batches = {}
    if not faults:
        faults, batches = _of_axes(thing, fields, batch)
    if faults:
        return [f"{where}: {fault}" for fault in faults]
    values = {field.name: getattr(thing, field.name) for field in fields}
    faults = [fault for name, value in values.items() for fault in verify(value, f"{where}.{name}", batches[name])]
    if faults or not dataclasses.is_dataclass(thing) or not hasattr(thing, "__post_init__"):
        return faults
    return [f"{where}: {fault}" for fault in _of_construction(thing, batch)]


def _of_axes(thing: Tree, fields: tuple[Declared, ...], batch: Shape) -> tuple[list[str], dict[str, Shape]]:
    """The faults of arrays that do not fit the others; the leading axes of the contents of each field."""
    counts = {field.name: value for field in fields if type(value := getattr(thing, field.name)) is int}
    axes, batches = Axes(batch, counts), {field.name: batch for field in fields}
    given = [(f"`{f.name}`", f, value, f.axes) for f in fields if (value := getattr(thing, f.name)) is not None]
    for name, field, value, letters in given:
        if letters is not None and isinstance(value, ARRAYS):
            axes.end(name, value, letters)
            axes.faults += asymmetry(name, value) if field.symmetric else []
    for name, field, value, letters in given:
        if letters is not None and not isinstance(value, ARRAYS):
            batches[field.name] = axes.begin(name, value, letters)
    return axes.faults, batches


def _of_construction(thing: AnyRecord, batch: Shape) -> list[str]:
    """The values that the constructor refuses or would change; for a batch, those of its first faulty item."""
    cls = type(thing)
    for i in np.ndindex(batch):
        one = jax.tree_util.tree_map(lambda leaf, i=i: leaf[i], thing) if batch else thing
        try:
            again = cls(**{field.name: getattr(one, field.name) for field in dataclasses.fields(cls) if field.init})
            faults = _differences(one, again)
        except checks.InputError as error:
            faults = error.faults
        except Exception as error:  # a constructor may fail anywhere on wrong values
            faults = [f"no {cls.__name__} can be made of this: {type(error).__name__}: {error}."]
        if faults:
            return [f"item {', '.join(map(str, i))}: {fault}" if batch else fault for fault in faults]
    return []


def _differences(one: AnyRecord, again: AnyRecord) -> list[str]:
    """The fields that the constructor would change to another form."""
    faults = []
    for field in dataclasses.fields(again):
        found, made = getattr(one, field.name), getattr(again, field.name)
        if not field.init and (made is None or _has_more_arguments(type(again))):
            continue  # set later, or from an argument that is not a field
        if found != made if field.metadata.get("static") else _form(found) != _form(made):
            faults.append(f"`{field.name}` must be {checks.short(made)}. Got {checks.short(found)}.")
    return faults


def _has_more_arguments(cls: type) -> bool:
    return any(isinstance(kind, dataclasses.InitVar) for kind in cls.__annotations__.values())


def _form(value: Tree) -> tuple[Any, list[tuple[Shape, np.dtype]]]:
    """The structure of a value, without its numbers."""
    leaves, structure = jax.tree_util.tree_flatten(value)
    return structure, [(np.shape(leaf), np.asarray(leaf).dtype) for leaf in leaves]
