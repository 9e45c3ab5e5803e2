"""The rule of each primitive for arrays."""

from collections.abc import Callable
from typing import Any

import numpy as np

from ..program.arrays import ArrayOperation
from ..program.composed import is_entrywise
from ..program.primitives import UnsupportedError
from ..program.reductions import FOLDS, RUNNING
from . import moves, sums
from .blocks import Blocks, Value, number
from .elementwise import each

Rule = Callable[[Blocks, ArrayOperation, list[Value]], Value]


def define(blocks: Blocks, operation: ArrayOperation, values: list[Value]) -> Value:
    """The result of an operation. Raises `UnsupportedError` for a primitive without a rule."""
    if is_entrywise(operation.name):
        return each(blocks, operation, values)
    if operation.name not in RULES:
        raise UnsupportedError(f"the primitive {operation.name} is not supported")
    return RULES[operation.name](blocks, operation, values)


def _constant(blocks: Blocks, operation: ArrayOperation, values: list[Value]) -> Value:
    array = operation.value
    if array.size <= 1 or (array == array.flat[0]).all():
        return _all(operation, array.flat[0] if array.size else 0)
    return blocks.lying(blocks.table(array, operation.kind), operation.shape, operation.kind)._replace(known=array)


def _all(operation: ArrayOperation, entry: Any) -> Value:
    """An array of equal entries."""
    text, known = number(operation.kind, entry), np.full(operation.shape, entry)
    return Value(operation.shape, operation.kind, lambda index: text, known=known)


def _count(blocks: Blocks, operation: ArrayOperation, values: list[Value]) -> Value:
    """0, 1, 2, .. along an axis."""
    axis, kind = operation.value["dimension"], operation.kind
    if kind == "i64":
        return Value(operation.shape, kind, lambda index: index[axis])
    return Value(operation.shape, kind, lambda index: blocks.assign(f"sitofp i64 {index[axis]} to double"))


RULES: dict[str, Rule] = {
    "constant": _constant, "iota": _count, **dict.fromkeys(RUNNING, sums.running), **dict.fromkeys(FOLDS, sums.reduced),
    "broadcast_in_dim": moves.broadcast, "reshape": moves.reshaped, "squeeze": moves.reshaped, "expand_dims": moves.reshaped,
    "transpose": moves.transposed, "slice": moves.sliced, "rev": moves.turned, "concatenate": moves.joined,
    "stack": moves.stacked, "dynamic_slice": moves.part, "dynamic_update_slice": moves.replaced, "gather": moves.looked_up,
    "scatter": moves.put, "dot_general": sums.product, "argmax": sums.extreme, "argmin": sums.extreme,
    "cholesky": sums.factor,
}  # fmt: skip
