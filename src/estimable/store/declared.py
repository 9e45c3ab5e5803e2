"""The values that a field may hold, from its annotation.

The annotation names the axes: `covariance: Annotated[Any, "n n", "symmetric"]`, next to `mean: Annotated[Any, "n"]`.
"""

import typing
from collections.abc import Mapping, Sequence
from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Any, NamedTuple

import jax
import numpy as np

from ..annotations import Tree
from ..frozen import field_names

SCALARS = {bool: "b", int: "iu", float: "fiu", str: "U"}  # and the dtype kinds of their arrays
WORDS = {bool: "a bool", int: "an integer", float: "a number", str: "a text", np.ndarray: "an array", NoneType: "None"}


class Declared(NamedTuple):
    """A field: the kind of its value, its axes (None: not declared), and whether it is a symmetric matrix."""

    name: str
    kind: Any
    axes: tuple[str, ...] | None
    symmetric: bool


@cache
def declared(cls: type) -> tuple[Declared, ...]:
    """The fields of a record."""
    hints = typing.get_type_hints(cls, include_extras=True)
    return tuple(_declared(name, hints[name]) for name in field_names(cls))


def _declared(name: str, hint: Any) -> Declared:
    if typing.get_origin(hint) is not Annotated:
        return Declared(name, hint, None, False)
    kind, axes, *more = typing.get_args(hint)
    return Declared(name, kind, tuple(axes.split()), "symmetric" in more)


def may_hold(kind: Any, value: Tree) -> bool:
    """Whether a field of this kind may hold the value. A number may be an array of numbers, as in a batch."""
    origin, inner = typing.get_origin(kind), typing.get_args(kind)
    if origin in (typing.Union, UnionType):
        return any(may_hold(one, value) for one in inner)
    if origin is tuple and inner[1:] != (...,):
        return type(value) is tuple and len(value) == len(inner) and all(map(may_hold, inner, value))
    if origin in (tuple, list, Sequence):
        return isinstance(value, tuple if origin is tuple else list | tuple) and all(
            may_hold(inner[0], item) for item in value
        )
    if origin in (dict, Mapping):
        return isinstance(value, dict)
    if kind in SCALARS:
        return type(value) is kind or (kind is float and type(value) is int) or _dtype_kind(value) in SCALARS[kind]
    if kind in (np.ndarray, jax.Array):
        return isinstance(value, np.ndarray | jax.Array)
    if kind is Any or not isinstance(kind, type) or getattr(kind, "_is_protocol", False):
        return True
    return isinstance(value, kind)


def _dtype_kind(value: Tree) -> str:
    """The dtype kind of an array; "none" for other values."""
    return np.dtype(value.dtype).kind if isinstance(value, np.ndarray | np.generic | jax.Array) else "none"


def worded(kind: Any) -> str:
    """The kind, for messages."""
    if typing.get_origin(kind) in (typing.Union, UnionType):
        return " or ".join(map(worded, typing.get_args(kind)))
    if kind in WORDS or not isinstance(kind, type):
        return WORDS.get(kind, str(kind))
    return f"{'an' if kind.__name__[0] in 'AEIOU' else 'a'} {kind.__name__}"
