"""What each primitive makes of its arrays."""

from collections.abc import Callable
from typing import Any

import numpy as np

from ..program.arrays import Operation
from ..program.straight_line import FOLDS, UnsupportedError
from . import moves, sums
from .blocks import Blocks, Value, number
from .elementwise import ENTRIES, each

Rule = Callable[[Blocks, Operation, list[Value]], Value]


def define(blocks: Blocks, operation: Operation, values: list[Value]) -> Value:
    """The array that an operation gives. Raises `UnsupportedError` for a primitive that has no rule."""
    if operation.name not in RULES:
        raise UnsupportedError(f"the primitive {operation.name}")
    return RULES[operation.name](blocks, operation, values)


def _constant(blocks: Blocks, operation: Operation, values: list[Value]) -> Value:
    array = operation.value
    if array.size <= 1 or (array == array.flat[0]).all():
        return _all(operation, array.flat[0] if array.size else 0)
    return blocks.lying(blocks.table(array, operation.kind), operation.shape, operation.kind)._replace(known=array)


def _all(operation: Operation, entry: Any) -> Value:
    """An array of which every entry is the same."""
    text, known = number(operation.kind, entry), np.full(operation.shape, entry)
    return Value(operation.shape, operation.kind, lambda index: text, known=known)


def _count(blocks: Blocks, operation: Operation, values: list[Value]) -> Value:
    """0, 1, 2, .. along an axis."""
    axis, kind = operation.value["dimension"], operation.kind
    if kind == "i64":
        return Value(operation.shape, kind, lambda index: index[axis])
    return Value(operation.shape, kind, lambda index: blocks.assign(f"sitofp i64 {index[axis]} to double"))


RULES: dict[str, Rule] = {
    "constant": _constant, "iota": _count, **dict.fromkeys(ENTRIES, each), **dict.fromkeys(FOLDS, sums.reduced),
    "broadcast_in_dim": moves.broadcast, "reshape": moves.reshaped, "squeeze": moves.reshaped, "expand_dims": moves.reshaped,
    "transpose": moves.transposed, "slice": moves.sliced, "rev": moves.turned, "concatenate": moves.joined,
    "stack": moves.stacked, "dynamic_slice": moves.part, "dynamic_update_slice": moves.replaced, "gather": moves.looked_up,
    "scatter": moves.put, "dot_general": sums.product, "argmax": sums.largest, "cumsum": sums.running,
    "cholesky": sums.factor,
}  # fmt: skip
