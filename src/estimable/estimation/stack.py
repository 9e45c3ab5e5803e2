"""Several algorithms, records or priors as one, with a leading batch axis."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from .. import checks
from ..annotations import AnyRecord, Tree
from ..data.record import Record
from ..frozen import static_fields
from ..results import Stacked


def stack(items: Sequence[Any]) -> Stacked:
    """Stack several algorithms, records or priors into one object, for `estimate_bank`.

    They must have the same kind, shapes, names and other fixed settings. Raises `InputError` that names the first one that
    differs.

    >>> len(stack([Prior([0.0], [[1.0]]), Prior([1.0], [[2.0]])]))
    2
    """
    if not isinstance(items, Sequence) or isinstance(items, str):
        checks.refuse(f"`items` must be a list of objects of one kind. Got {checks.short(items)}.")
    things = [item.without_notes if isinstance(item, Record) else item for item in items]
    if not things:
        checks.refuse("`items` must hold at least one thing to stack.")
    if not dataclasses.is_dataclass(type(things[0])):
        checks.refuse(f"`items` must be algorithms, models, records or priors. Got {checks.short(things[0])}.")
    first = jax.tree_util.tree_structure(things[0])
    shapes = _shapes(things[0])
    for i, thing in enumerate(things[1:], start=1):
        if type(thing) is not type(things[0]):
            checks.refuse(
                f"only objects of one kind can be stacked: item 0 is a {type(things[0]).__name__}, "
                f"item {i} a {type(thing).__name__}."
            )
        if jax.tree_util.tree_structure(thing) != first:
            checks.refuse(f"item {i} differs from item 0 in {_first_fixed_difference(things[0], thing)}.")
        if _shapes(thing) != shapes:
            checks.refuse(f"item {i} differs from item 0 in shape: {_first_difference(things[0], thing)}.")
    return Stacked(jax.tree_util.tree_map(lambda *leaves: np.stack(leaves), *things), len(things))


def _shapes(thing: Tree) -> list[tuple[int, ...]]:
    return [np.shape(leaf) for leaf in jax.tree_util.tree_leaves(thing)]


def _first_difference(a: Tree, b: Tree) -> str:
    pairs = zip(jax.tree_util.tree_leaves_with_path(a), jax.tree_util.tree_leaves(b), strict=True)
    path, left, right = next((p, x, y) for (p, x), y in pairs if np.shape(x) != np.shape(y))
    return f"`{jax.tree_util.keystr(path).lstrip('.')}` is {np.shape(left)} and {np.shape(right)}"


def _first_fixed_difference(a: AnyRecord, b: AnyRecord) -> str:
    """The first non-numeric field that differs: a name, an option, or a part given in only one of them."""
    for field in dataclasses.fields(a):
        left, right = getattr(a, field.name), getattr(b, field.name)
        if jax.tree_util.tree_structure(left) != jax.tree_util.tree_structure(right) or field.name in static_fields(
            type(a)
        ):
            if dataclasses.is_dataclass(type(left)) and type(left) is type(right):
                return f"`{field.name}`: {_first_fixed_difference(left, right)}"
            if field.name not in static_fields(type(a)) or left != right:
                return f"`{field.name}`: {checks.short(left)} and {checks.short(right)}"
    return "names or options"
