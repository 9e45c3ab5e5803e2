"""Operations that only move entries: nothing is written where entries can be read in place."""

import math
from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from ..program.arrays import ArrayOperation
from ..program.primitives import UnsupportedError
from .blocks import Blocks, Memory, Value, row_after_row

PRIMITIVES = {"gather": lax.gather_p, "scatter": lax.scatter_p}


def stretched(blocks: Blocks, value: Value, shape: tuple[int, ...], axes: Sequence[int]) -> Value:
    """The array with its axes at `axes` of a larger one, along which it is repeated."""
    if value.shape == shape:
        return value
    if math.prod(shape) > math.prod(value.shape):
        value = blocks.ready(value)
    repeated = [value.shape[i] == 1 != shape[axis] for i, axis in enumerate(axes)]

    def source(index: list[str]):
        return ["0" if r else index[axis] for axis, r in zip(axes, repeated, strict=True)]

    def strides(memory: Memory):
        steps = {axis: 0 if r else m for axis, r, m in zip(axes, repeated, memory.strides, strict=True)}
        return memory._replace(strides=tuple(steps.get(axis, 0) for axis in range(len(shape))))

    return _moved(value, shape, source, strides)


def _moved(value: Value, shape: tuple[int, ...], source: Callable, strides: Callable | None = None) -> Value:
    """The entries at other places: `source(index)` is the original place, `strides(memory)` the place in memory."""
    memory = strides(value.memory) if strides and value.memory else None
    return Value(shape, value.kind, lambda index: value.at(source(index)), memory, value.work)


def broadcast(blocks: Blocks, operation: ArrayOperation, values: list[Value]) -> Value:
    """An array repeated along new axes."""
    return stretched(blocks, values[0], operation.shape, operation.value["broadcast_dimensions"])


def reshaped(blocks: Blocks, operation: ArrayOperation, values: list[Value]) -> Value:
    """The entries in the same order in another shape."""
    value = values[0]
    wide, wanted = ([i for i, count in enumerate(shape) if count != 1] for shape in (value.shape, operation.shape))
    if [value.shape[i] for i in wide] == [operation.shape[i] for i in wanted]:
        return _squeezed(value, operation.shape, wide, wanted)
    if value.memory is None or value.memory.strides != row_after_row(value.shape):
        value = blocks.kept(value)
    memory = value.lies._replace(strides=row_after_row(operation.shape))
    return blocks.lying(memory, operation.shape, value.kind)


def _squeezed(value: Value, shape: tuple[int, ...], wide: list[int], wanted: list[int]) -> Value:
    """The same entries with other axes of length one."""
    to = dict(zip(wide, wanted, strict=True))

    def source(index: list[str]):
        return [index[to[axis]] if axis in to else "0" for axis in range(len(value.shape))]

    def strides(memory: Memory):
        steps = {to[axis]: memory.strides[axis] for axis in to}
        return memory._replace(strides=tuple(steps.get(axis, 0) for axis in range(len(shape))))

    return _moved(value, shape, source, strides)


def transposed(blocks: Blocks, operation: ArrayOperation, values: list[Value]) -> Value:
    """The axes in another order."""
    order = operation.value["permutation"]
    back = np.argsort(order)
    return _moved(values[0], operation.shape, lambda index: [index[i] for i in back],
                  lambda memory: memory._replace(strides=tuple(memory.strides[i] for i in order)))  # fmt: skip


def sliced(blocks: Blocks, operation: ArrayOperation, values: list[Value]) -> Value:
    """A part with known bounds and steps."""
    begin = operation.value["start_indices"]
    steps = operation.value["strides"] or (1,) * len(begin)
    return _stepped(blocks, values[0], operation.shape, begin, steps)


def turned(blocks: Blocks, operation: ArrayOperation, values: list[Value]) -> Value:
    """Axes in reverse order."""
    turned = operation.value["dimensions"]
    begin = [count - 1 if axis in turned else 0 for axis, count in enumerate(operation.shape)]
    steps = [-1 if axis in turned else 1 for axis in range(len(begin))]
    return _stepped(blocks, values[0], operation.shape, begin, steps)


def _stepped(blocks: Blocks, value: Value, shape: tuple, begin: Sequence[int], steps: Sequence[int]) -> Value:
    """Entries from `begin` on, in `steps`."""

    def source(index: list[str]):
        return [blocks.affine([i], [step], first) for i, first, step in zip(index, begin, steps, strict=True)]

    def strides(memory: Memory):
        first = sum(b * s for b, s in zip(begin, memory.strides, strict=True))
        steep = tuple(a * b for a, b in zip(steps, memory.strides, strict=True))
        return memory._replace(strides=steep, offset=memory.offset + first)

    return _moved(value, shape, source, strides)


def joined(blocks: Blocks, operation: ArrayOperation, values: list[Value]) -> Value:
    """Arrays one after the other along an axis."""
    axis, parts = operation.value["dimension"], [value for value in values if 0 not in value.shape]
    if len(parts) <= 1:
        return parts[0] if parts else values[0]._replace(shape=operation.shape)
    memory, begin = blocks.region(operation.shape, operation.kind), 0
    for part in parts:
        blocks.fill(memory._replace(offset=begin * memory.strides[axis]), part)
        begin += part.shape[axis]
    return blocks.lying(memory, operation.shape, operation.kind)


def stacked(blocks: Blocks, operation: ArrayOperation, values: list[Value]) -> Value:
    """Arrays side by side along a new axis."""
    axis = operation.value.get("axis", operation.value.get("dimension", 0))
    shape = tuple(1 if i == axis else count for i, count in enumerate(operation.shape))
    wide = [reshaped(blocks, ArrayOperation("reshape", (), shape, v.kind), [v]) for v in values]
    return joined(blocks, operation._replace(value={"dimension": axis}), wide)


def split(blocks: Blocks, operation: ArrayOperation, values: list[Value]) -> list[Value]:
    """Parts of an array along an axis."""
    value, axis, begin, parts = values[0], operation.value["axis"], 0, []
    for size in operation.value["sizes"]:
        shape = tuple(size if i == axis else count for i, count in enumerate(value.shape))
        starts = [begin if i == axis else 0 for i in range(len(shape))]
        parts.append(_stepped(blocks, value, shape, starts, (1,) * len(shape)))
        begin += size
    return parts


def _starts(blocks: Blocks, indices: list[Value], shape: tuple, size: tuple) -> list[str]:
    """The start of a part, clamped to the array as in JAX."""
    starts = []
    for index, whole, part in zip(indices, shape, size, strict=True):
        start = index.at([])
        if whole == part:
            start = "0"
        elif not start.isdigit() or int(start) > whole - part:
            start = _clamped(blocks, start, whole - part)
        starts.append(start)
    return starts


def _clamped(blocks: Blocks, start: str, most: int) -> str:
    """An integer between 0 and `most`."""
    least = blocks.assign(f"call i64 @llvm.smin.i64(i64 {start}, i64 {most})")
    blocks.scalars.declared |= {"declare i64 @llvm.smin.i64(i64, i64)", "declare i64 @llvm.smax.i64(i64, i64)"}
    return blocks.assign(f"call i64 @llvm.smax.i64(i64 {least}, i64 0)")


def part(blocks: Blocks, operation: ArrayOperation, values: list[Value]) -> Value:
    """The part that begins at a computed index."""
    value = values[0] if values[0].memory else blocks.kept(values[0])
    memory = _from(blocks, value, _starts(blocks, values[1:], value.shape, operation.shape))
    return blocks.lying(memory, operation.shape, operation.kind)


def _from(blocks: Blocks, value: Value, starts: list[str]) -> Memory:
    return value.lies._replace(pointer=blocks.place(value.lies, value.kind, starts), offset=0)


def replaced(blocks: Blocks, operation: ArrayOperation, values: list[Value]) -> Value:
    """An array with a part replaced by another."""
    value, part = blocks.kept(values[0]), values[1]
    blocks.fill(_from(blocks, value, _starts(blocks, values[2:], value.shape, part.shape)), part)
    return value


def looked_up(blocks: Blocks, operation: ArrayOperation, values: list[Value]) -> Value:
    """Entries at known places; JAX itself determines the places."""
    value = values[0] if _plain(values[0]) else blocks.kept(values[0])
    count = math.prod(value.shape)
    places = _places(operation, np.arange(count).reshape(value.shape), values[1:])
    table = blocks.lying(blocks.table(places, "i64"), operation.shape, "i64")
    flat = value.lies._replace(strides=(1,))
    return Value(operation.shape, operation.kind, lambda index: blocks.load(flat, operation.kind, [table.at(index)]))


def put(blocks: Blocks, operation: ArrayOperation, values: list[Value]) -> Value:
    """An array with entries written to known places."""
    value, update = blocks.kept(values[0]), values[2] if _plain(values[2]) else blocks.kept(values[2])
    count = math.prod(value.shape)
    new = count + np.arange(math.prod(update.shape)).reshape(update.shape)
    places = _places(operation, np.arange(count).reshape(value.shape), [values[1], new]).ravel()
    targets = np.flatnonzero(places >= count)
    if len(targets):
        to, source = (
            blocks.lying(blocks.table(t, "i64"), (len(targets),), "i64") for t in (targets, places[targets] - count)
        )
        whole, part = value.lies._replace(strides=(1,)), update.lies._replace(strides=(1,))
        blocks.loop(len(targets), lambda i: blocks.store(
            whole, value.kind, [to.at([i])], blocks.load(part, value.kind, [source.at([i])])))  # fmt: skip
    return value


def _plain(value: Value) -> bool:
    return value.memory is not None and value.memory.strides == row_after_row(value.shape)


def _places(operation: ArrayOperation, moved: np.ndarray, others: list) -> np.ndarray:
    """The place from which JAX takes each entry."""
    if any(isinstance(other, Value) and other.known is None for other in others):
        raise UnsupportedError(f"{operation.name} at a computed index is not supported")
    with jax.ensure_compile_time_eval():
        given = [jnp.asarray(other.known if isinstance(other, Value) else other) for other in others]
        outside = {"fill_value": -1} if operation.name == "gather" else {}
        places = np.asarray(PRIMITIVES[operation.name].bind(jnp.asarray(moved), *given, **operation.value | outside))
    if (places < 0).any():
        raise UnsupportedError(f"{operation.name} at an index outside the array is not supported")
    return places
