"""Reductions of arrays: sums, products, running sums, and the index of the largest entry."""

import math
from collections.abc import Sequence

import numpy as np

from ..program.arrays import DTYPES, ArrayOperation
from ..program.primitives import UnsupportedError
from ..program.reductions import FOLDS, RUNNING, empty
from .blocks import Blocks, Memory, Value, number
from .elementwise import scalar
from .libraries import cholesky, large_gram, large_product
from .moves import transposed

LARGE = 32**3  # multiplications, from which a matrix library is faster


def reduced(blocks: Blocks, operation: ArrayOperation, values: list[Value]) -> Value:
    """A reduction along some axes."""
    return _reduced(blocks, FOLDS[operation.name], values[0], operation.value["axes"])


def _reduced(blocks: Blocks, name: str, value: Value, axes: Sequence[int]) -> Value:
    """A reduction, written to memory at once.

    If it reduces the last axis, entry by entry; otherwise row by row, so that the innermost loop runs along memory.
    """
    kept = [axis for axis in range(len(value.shape)) if axis not in axes]
    shape = tuple(value.shape[axis] for axis in kept)
    memory = blocks.region(shape, value.kind)
    last = len(value.shape) - 1
    reduce = _rows if kept and kept[-1] == last and value.shape[last] > 1 else _entries
    reduce(blocks, name, value, kept, list(axes), memory)
    return blocks.lying(memory, shape, value.kind)


def _entries(blocks: Blocks, name: str, value: Value, kept: list[int], axes: list[int], memory: Memory) -> None:
    """The entries of a reduction, one after the other."""

    def total(place: dict[int, str], axes: list[int], so_far: str) -> str:
        if not axes:
            return _joined(blocks, name, value.kind, so_far, _entry(value, place))
        ((_, so_far),) = blocks.fold(
            value.shape[axes[0]], ((value.kind, so_far),),
            lambda i, state: ((value.kind, total(place | {axes[0]: i}, axes[1:], state[0][1])),),
        )  # fmt: skip
        return so_far

    def write(index: list[str]) -> None:
        place = dict(zip(kept, index, strict=True))
        blocks.store(memory, value.kind, index, total(place, axes, _empty(name, value.kind)))

    blocks.every(tuple(value.shape[axis] for axis in kept), write)


def _rows(blocks: Blocks, name: str, value: Value, kept: list[int], axes: list[int], memory: Memory) -> None:
    """The rows of a reduction, one after the other, by adding rows of the array."""
    kind, (*outer, last) = value.kind, kept

    def write(index: list[str]) -> None:
        def add(upon: list[str]) -> None:
            place = dict(zip((*outer, *axes), (*index, *upon), strict=True))

            def one(j: str) -> None:
                so_far = blocks.load(memory, kind, [*index, j])
                total = _joined(blocks, name, kind, so_far, _entry(value, place | {last: j}))
                blocks.store(memory, kind, [*index, j], total)

            blocks.loop(value.shape[last], one)

        empty = _empty(name, kind)
        blocks.loop(value.shape[last], lambda j: blocks.store(memory, kind, [*index, j], empty))
        blocks.every(tuple(value.shape[axis] for axis in axes), add)

    blocks.every(tuple(value.shape[axis] for axis in outer), write)


def _empty(name: str, kind: str) -> str:
    """The initial value of a reduction."""
    return number(kind, empty(name, np.dtype(DTYPES[kind])))


def _entry(value: Value, place: dict[int, str]) -> str:
    """The entry at a place along each axis."""
    return value.at([place[axis] for axis in range(len(value.shape))])


def _joined(blocks: Blocks, name: str, kind: str, total: str, term: str) -> str:
    """One more term of a sum or another fold; the order of a sum is not fixed."""
    if kind == "double" and name in ("add", "mul"):
        return blocks.assign(f"f{name} reassoc contract double {total}, {term}")
    return scalar(blocks, name, [kind, kind], [total, term])


def product(blocks: Blocks, operation: ArrayOperation, values: list[Value]) -> Value:
    """Σ_k a[.., k] b[k, ..]: a matrix library where it is large."""
    contract, batch = operation.value["dimension_numbers"]
    if batch[0] or len(contract[0]) != 1 or {operation.kind, *(value.kind for value in values)} != {"double"}:
        raise UnsupportedError("a product along several axes, or of integers, is not supported")
    a, b = (_last(blocks, value, axes[0]) for value, axes in zip(values, contract, strict=True))
    if len(a.shape) == len(b.shape) == 2 and math.prod(a.shape) * b.shape[0] >= LARGE:
        alike = a.memory is not None and (a.memory, a.shape) == (b.memory, b.shape)
        return large_gram(blocks, a) if alike else large_product(blocks, a, b)
    rows, others = len(a.shape) - 1, len(b.shape) - 1
    steps = b.memory.strides if b.memory else ()
    along = len(steps) > 1 and steps[-2] == 1 != steps[-1]  # rows of b are contiguous where its last axis is not
    k = rows if along else rows + others

    def at(index: list[str]) -> str:
        free = [*index[:k], *index[k + 1 :]]
        names = a.at([*free[:rows], index[k]]), b.at([*free[rows:], index[k]])
        return blocks.assign(f"fmul contract double {names[0]}, {names[1]}")

    free = (*a.shape[:-1], *b.shape[:-1])
    terms = Value((*free[:k], a.shape[-1], *free[k:]), "double", at)
    return _reduced(blocks, "add", terms, [k])


def _last(blocks: Blocks, value: Value, axis: int) -> Value:
    """The array with this axis last."""
    value = blocks.ready(value)
    order = [i for i in range(len(value.shape)) if i != axis] + [axis]
    shape = tuple(value.shape[i] for i in order)
    return transposed(blocks, ArrayOperation("transpose", (), shape, value.kind, {"permutation": order}), [value])


def extreme(blocks: Blocks, operation: ArrayOperation, values: list[Value]) -> Value:
    """The index of the largest (least) entry along an axis: the first of several; the first NaN takes precedence."""
    value = _last(blocks, values[0], operation.value["axes"][0])
    kind, beyond = value.kind, "gt" if operation.name == "argmax" else "lt"
    memory = blocks.region(operation.shape, "i64")

    def write(index: list[str]) -> None:
        def further(k: str, state: tuple) -> tuple:
            entry, best = value.at([*index, k]), state[0][1]
            better = scalar(blocks, beyond, [kind, kind], [entry, best])
            if kind == "double":
                undefined = [scalar(blocks, name, [kind, kind], [x, x]) for name, x in (("ne", entry), ("eq", best))]
                better = scalar(blocks, "or", ["i1", "i1"], [better, scalar(blocks, "and", ["i1", "i1"], undefined)])
            return tuple(
                (held, scalar(blocks, "select", ["i1", held, held], [better, new, old]))
                for (held, old), new in zip(state, (entry, k), strict=True)
            )

        first = ((kind, value.at([*index, "0"])), ("i64", "0"))
        blocks.store(memory, "i64", index, blocks.fold(value.shape[-1], first, further)[1][1])

    blocks.every(operation.shape, write)
    return blocks.lying(memory, operation.shape, "i64")


def running(blocks: Blocks, operation: ArrayOperation, values: list[Value]) -> Value:
    """Sums (products, ..) of all entries up to each, along an axis."""
    kind, name, shape, axis = operation.kind, RUNNING[operation.name], operation.shape, operation.value["axis"]
    memory = blocks.region(shape, kind)

    def along(index: list[str]) -> None:
        def further(i: str, state: Sequence[tuple[str, str]]) -> tuple:
            k = blocks.affine([i], [-1], shape[axis] - 1) if operation.value["reverse"] else i
            place = [*index[:axis], k, *index[axis:]]
            total = _joined(blocks, name, kind, state[0][1], values[0].at(place))
            blocks.store(memory, kind, place, total)
            return ((kind, total),)

        blocks.fold(shape[axis], ((kind, _empty(name, kind)),), further)

    blocks.every(tuple(count for i, count in enumerate(shape) if i != axis), along)
    return blocks.lying(memory, shape, kind)


def factor(blocks: Blocks, operation: ArrayOperation, values: list[Value]) -> Value:
    """Cholesky's factor."""
    if len(operation.shape) != 2:
        raise UnsupportedError("several factorisations at once are not supported")
    return cholesky(blocks, values[0])
