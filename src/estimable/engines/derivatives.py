"""A step together with its derivative along one direction, as a step: a bank of them runs one direction in each lane.

The derivative is `jax.jvp` of the step, lowered once. So one program serves every number of directions and of rows, and the step
itself, which is the same in all lanes, adds nothing to the cost of its derivative.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..annotations import Array, Tree
from ..frozen import frozen

ROUNDING = 8 * np.finfo(float).eps  # change of a row of a derivative, relative to it, that is rounding


def derivative(function: Callable[[Any], Any], thing: Tree, slope: Tree) -> tuple[Any, Any]:
    """The value of a function of trees at `thing`, and its derivative along `slope`, a tree of the same form.

    Entries that are not floats have no derivative: it repeats those of the value.
    """
    leaves, structure = jax.tree_util.tree_flatten(thing)
    slopes = jax.tree_util.tree_leaves(slope)
    moving = [i for i, leaf in enumerate(leaves) if _is_float(leaf)]

    def of(floats: list[Array]):
        everything = list(leaves)
        for i, leaf in zip(moving, floats, strict=True):
            everything[i] = leaf
        return function(jax.tree_util.tree_unflatten(structure, everything))

    floats = [jnp.asarray(leaves[i]) for i in moving]
    along = [jnp.asarray(slopes[i], floats[at].dtype) for at, i in enumerate(moving)]
    value, moved = jax.jvp(of, (floats,), (along,))
    return value, jax.tree_util.tree_map(lambda leaf, dot: dot if _is_float(leaf) else leaf, value, moved)


def _is_float(leaf: Array | float) -> bool:
    return jnp.issubdtype(jnp.result_type(leaf), jnp.floating)


@frozen
class Moved:
    """A state and its derivative; `before`: its derivative at the sample before, None where no sample was seen."""

    state: Any
    slope: Any
    before: Any = None


@frozen
class Sloped:
    """An info and its derivative, with what an engine sums."""

    info: Any
    slope: Any
    log_likelihood: Any
    outcome: Any


@frozen
class Along:
    """An algorithm and a direction in its numbers, `slope`, a tree of the same form. Its prior is a pair alike."""

    algorithm: Any
    slope: Any

    def at(self, k: int | Array) -> "Along":
        """The same at row k: a row is looked up in the numbers and in their direction alike."""
        return Along(self.algorithm.at(k), self.slope.at(k))

    def init(self, prior: tuple[Tree, Tree]) -> Moved:
        """The state before the first row, and its derivative."""
        return Moved(
            *derivative(lambda pair: pair[0].init(pair[1]), (self.algorithm, prior[0]), (self.slope, prior[1]))
        )

    def correct(self, state: Moved, sample: Tree) -> tuple[Moved, Sloped]:
        """The state after a sample, the info, and their derivatives."""
        pair, slopes = (self.algorithm, state.state), (self.slope, state.slope)
        (after, info), (slope, info_slope) = derivative(lambda pair: pair[0].correct(pair[1], sample), pair, slopes)
        return Moved(after, slope, state.slope), Sloped(info, info_slope, info.log_likelihood, info.outcome)

    def predict(self, state: Moved, interval: Tree) -> Moved:
        """The state at the next row, and its derivative."""
        pair, slopes = (self.algorithm, state.state), (self.slope, state.slope)
        after, slope = derivative(lambda pair: pair[0].predict(pair[1], interval), pair, slopes)
        return Moved(after, jax.tree_util.tree_map(_settled, slope, state.before))


def _settled(slope: Array, before: Array) -> Array:
    """A derivative of a matrix that differs from the one a row before by rounding only stays that one.

    So it ends in one matrix where the matrix does, and machine code computes both no more.
    """
    if not _is_float(slope) or jnp.ndim(slope) != 2 or jnp.shape(slope) != jnp.shape(before):
        return slope
    moved, size = jnp.sum((slope - before) ** 2, axis=1), jnp.sum(before**2, axis=1)
    return jnp.where(jnp.all(moved <= ROUNDING**2 * size), before, slope)
