"""`@frozen`: an immutable record that JAX can map, differentiate and pass through a compiled function.

A field is a *leaf* (numbers: replaceable, mappable, differentiable) unless it is declared with `static()`. A static field
determines a shape or a branch and must be hashable. A leaf that holds a string (a named choice instead of numbers) is static too.

`save` writes every frozen record of the package, and records of other kinds that are marked with `@saved`.
"""

import dataclasses
import operator
from collections.abc import Callable, Iterable
from typing import Any, TypeVar, dataclass_transform

import jax

from .annotations import AnyRecord

Cls = TypeVar("Cls")
Aux = tuple[tuple[Any, ...], tuple[str | None, ...]]  # the static fields of a record, and its leaves that are strings
PACKAGE = __name__.partition(".")[0]
RECORDS: dict[str, type] = {}  # the records that `save` writes and `load` makes, by name


def static(**kwargs: Any) -> Any:
    """A field that determines a shape or a branch: compared and hashed, never traced."""
    return dataclasses.field(metadata={"static": True}, **kwargs)


def static_fields(cls: type) -> tuple[str, ...]:
    """Names of the fields that were declared with `static()`."""
    return tuple(f.name for f in dataclasses.fields(cls) if f.metadata.get("static"))


def leaf_fields(cls: type) -> tuple[str, ...]:
    """Names of the fields that hold numbers, or records of numbers."""
    return tuple(f.name for f in dataclasses.fields(cls) if not f.metadata.get("static"))


def saved(cls: type[Cls]) -> type[Cls]:
    """Let `save` write a record of the package (a NamedTuple or a dataclass); `@frozen` includes it.

    A file names the class, so no two records have the same name. A name that begins with an underscore is not saved.
    """
    if cls.__module__.partition(".")[0] == PACKAGE and not cls.__name__.startswith("_"):
        known = RECORDS.get(cls.__name__, cls)
        if known.__module__ != cls.__module__:
            raise TypeError(f"{known.__module__} and {cls.__module__} both have a record {cls.__name__}: rename one")
        RECORDS[cls.__name__] = cls
    return cls


def field_names(cls: type) -> tuple[str, ...]:
    """Names of all fields of a dataclass or a NamedTuple; none for another class."""
    if issubclass(cls, tuple):
        return getattr(cls, "_fields", ())
    return tuple(f.name for f in dataclasses.fields(cls)) if dataclasses.is_dataclass(cls) else ()


@dataclass_transform(frozen_default=True, field_specifiers=(static, dataclasses.field))
def frozen(cls: type[Cls]) -> type[Cls]:
    """Make `cls` a frozen dataclass and register it as a pytree.

    Constructors run `__post_init__` and may check; unflattening fills the fields and checks nothing, so that a leaf may
    be a tracer, a batch or a gradient.
    """
    record = dataclasses.dataclass(frozen=True, eq=False)(cls)
    leaves, statics = leaf_fields(record), static_fields(record)
    numbers, fixed, no_words = _getter(leaves), _getter(statics), (None,) * len(leaves)

    def flatten(
        thing: Cls,
    ) -> tuple[tuple[Any, ...], Aux]:  # called about thirty times in each driver call, so optimised
        values = numbers(thing)
        if not any([isinstance(value, str) for value in values]):
            return values, (fixed(thing), no_words)
        words = tuple(value if isinstance(value, str) else None for value in values)
        return tuple(None if isinstance(value, str) else value for value in values), (fixed(thing), words)

    def flatten_with_keys(thing: Cls) -> tuple[list[tuple[Any, Any]], Aux]:
        children, aux = flatten(thing)
        return list(zip(map(jax.tree_util.GetAttrKey, leaves), children, strict=True)), aux

    def unflatten(aux: Aux, children: Iterable[Any]) -> Cls:
        fixed, words = aux
        thing = object.__new__(record)
        for name, value in zip(statics, fixed, strict=True):
            object.__setattr__(thing, name, value)
        for name, child, word in zip(leaves, children, words, strict=True):
            object.__setattr__(thing, name, child if word is None else word)
        return thing

    jax.tree_util.register_pytree_with_keys(record, flatten_with_keys, unflatten, flatten)
    return saved(record)


def _getter(names: tuple[str, ...]) -> Callable[[Any], tuple]:
    """A function that returns the named fields of a record."""
    if len(names) > 1:
        return operator.attrgetter(*names)
    return lambda thing: tuple(getattr(thing, name) for name in names)


def replace(thing: Cls, **changes: Any) -> Cls:
    """A copy of a frozen record with some fields changed; without checks, so that leaves may be tracers."""
    unknown = set(changes) - {f.name for f in dataclasses.fields(thing)}  # type: ignore[arg-type]
    if unknown:
        raise TypeError(f"{type(thing).__name__} has no field {sorted(unknown)}")
    copy = object.__new__(type(thing))
    for field in dataclasses.fields(thing):  # type: ignore[arg-type]
        object.__setattr__(copy, field.name, changes.get(field.name, getattr(thing, field.name)))
    return copy


def set_field(thing: AnyRecord, **values: Any) -> None:
    """Set fields of a record under construction (in `__post_init__` only)."""
    for name, value in values.items():
        object.__setattr__(thing, name, value)
