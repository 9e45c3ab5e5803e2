"""Data that an algorithm looks up by row (the matrices of a time-varying model), laid out as additional data of each row."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import numpy as np

from .. import forks
from ..annotations import Array, Tree
from ..frozen import frozen, static
from .step import Samples, Stepping


@frozen
class ByRow:
    """An algorithm with some leaves supplied by each row, as (sample, leaves) and (interval, leaves).

    `first`: those leaves at the first row, for `init`. `places`: their indices.
    """

    same: Any
    first: Any
    places: tuple[bool, ...] = static()
    structure: Any = static()

    def at(self, k: int | Array) -> "ByRow":
        """The same object: the row supplies the looked-up leaves."""
        return self

    def now(self, looked_up: Sequence[Array]) -> Any:
        """The algorithm at a row."""
        same, moving = iter(self.same), iter(looked_up)
        leaves = [next(moving) if moves else next(same) for moves in self.places]
        return jax.tree_util.tree_unflatten(self.structure, leaves)

    def init(self, prior: Tree) -> Any:
        """The state before the first row."""
        return self.now(self.first).init(prior)

    def correct(self, state: Tree, row: tuple[Tree, list[Array]]) -> Any:
        """Update with one sample and the leaves of its row."""
        return self.now(row[1]).correct(state, row[0])

    def predict(self, state: Tree, row: tuple[Tree, list[Array]]) -> Any:
        """Move to the next sample, with the leaves of this row."""
        return self.now(row[1]).predict(state, row[0])


class _Lookup(NamedTuple):
    """The leaves of the algorithm that are looked up, the sources of the others, and the lookup function."""

    places: tuple[bool, ...]
    sources: tuple[int, ...]
    structure: Any
    look: Any


def laid_out(algorithm: Stepping, samples: Samples, intervals: Tree, axes: tuple) -> tuple[Any, Any, Any, tuple]:
    """(algorithm, samples, intervals, axes) without lookups by row."""
    a, r, p = axes
    T = samples.seen.shape[0 if r is None else 1]
    by_row, moving = looked_up(algorithm, T, a)
    if by_row is algorithm:
        return algorithm, samples, intervals, axes
    if a is None and r == 0:
        moving = [np.broadcast_to(array, (len(samples.seen), *array.shape)) for array in moving]
    elif a == 0 and r is None:
        samples, intervals = (jax.tree_util.tree_map(lambda leaf: np.broadcast_to(leaf, (len(moving[0]), *leaf.shape)), part)
                              for part in (samples, intervals))  # fmt: skip
        r = 0
    return by_row, (samples, moving), (intervals, moving), (a, r, p)


def looked_up(algorithm: Stepping, T: int, axis: int | None = None) -> tuple[Any, list[np.ndarray]]:
    """The algorithm without its looked-up leaves, and those leaves for T rows; itself and no leaves where it looks up nothing.

    `axis`: that of a batch of algorithms, or None.
    """
    leaves, structure = jax.tree_util.tree_flatten(algorithm)
    leaves = [np.asarray(leaf) for leaf in leaves]
    shapes = tuple((leaf.shape if axis is None else leaf.shape[1:], leaf.dtype.str) for leaf in leaves)
    lookup = _lookup(structure, shapes)
    if lookup is None:
        return algorithm, []
    look = lookup.look if axis is None else jax.vmap(lookup.look, in_axes=(0, None))
    moving = [np.asarray(array) for array in forks.jit(look)(leaves, np.arange(T))]
    first = [array[0] if axis is None else array[:, 0] for array in moving]
    same = [leaves[i] for i in lookup.sources]
    return ByRow(same, first, lookup.places, lookup.structure), moving


@lru_cache(256)
def _lookup(structure: Any, shapes: tuple) -> _Lookup | None:
    """The lookup of an algorithm; None where there is none."""
    example = [np.zeros(shape, dtype) for shape, dtype in shapes]
    seen = {}

    def now(leaves: list[Array], k: int | Array):
        algorithm = jax.tree_util.tree_unflatten(structure, leaves).at(k)
        leaves, seen["structure"] = jax.tree_util.tree_flatten(algorithm)
        return leaves

    jaxpr = jax.make_jaxpr(now)(example, 0).jaxpr
    given = {id(var): i for i, var in enumerate(jaxpr.invars)}
    sources = [given.get(id(var)) for var in jaxpr.outvars]
    if seen["structure"] == structure:
        return None
    places = tuple(i is None for i in sources)

    def look(leaves: list[Array], rows: Array):
        return jax.vmap(lambda k: [leaf for leaf, moves in zip(now(leaves, k), places, strict=True) if moves])(rows)

    return _Lookup(places, tuple(i for i in sources if i is not None), seen["structure"], look)
