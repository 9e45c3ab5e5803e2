"""The operations on arrays in order, with scans as loops."""

from collections.abc import Collection, Iterable, Sequence
from typing import Any

from ..program.arrays import ArrayOperation, Arrays, Repeated
from ..program.primitives import UnsupportedError
from .blocks import Blocks, Memory, Value
from .libraries import triangle
from .moves import split
from .rules import define


def emit(blocks: Blocks, program: Arrays, inputs: list[Value]) -> list[Value]:
    """The outputs of a program."""
    values: dict[int, Any] = {name: value for name, value in zip(program.inputs, inputs, strict=True) if name >= 0}
    compute(blocks, program, values, range(len(program.operations)), read_again(program))
    return [values[name] for name in program.outputs]


def read_again(program: Arrays, groups: Sequence[Collection[int]] = ()) -> set[int]:
    """The arrays that are read more than once, or from outside their own group."""
    readers: dict[int, list[int]] = {}
    for name, operation in enumerate(program.operations):
        for a in operation.arguments:
            readers.setdefault(a, []).append(name)
    again = {name for name, found in readers.items() if len(found) > 1}
    again |= {name for name in program.outputs if name in readers}
    for group in groups:
        again |= {
            name for name in group if name in program.outputs or any(r not in group for r in readers.get(name, ()))
        }
    return again


def compute(blocks: Blocks, program: Arrays, values: dict, wanted: Iterable[int], again: set[int]) -> None:
    """Compute the wanted operations in order; arrays read more than once are written to memory."""
    for name in wanted:
        if name in values:
            continue
        operation = program.operations[name]
        arguments = [values[a] for a in operation.arguments]
        if operation.name == "result":
            values[name] = arguments[0][operation.value]
            if values[name] is None:
                primitive = program.operations[operation.arguments[0]].name
                raise UnsupportedError(f"a result of the primitive {primitive} is not supported")
            continue
        if operation.name in SEVERAL:
            values[name] = SEVERAL[operation.name](blocks, operation, arguments)
            continue
        value = define(blocks, operation, arguments)
        values[name] = blocks.ready(value) if name in again else value


def commit(blocks: Blocks, memories: list[Memory], values: list[Value]) -> None:
    """Overwrite the former arrays after all new ones are computed; those that read former arrays go to other memory first."""
    regions = {memory.region for memory in memories}
    moved = [(m, v) for m, v in zip(memories, values, strict=True) if v.memory is None or v.memory != m]
    apart = [v.known is not None or (v.memory is not None and v.memory.region not in regions) for _, v in moved]
    inside = [v if safe else blocks.kept(v) for (_, v), safe in zip(moved, apart, strict=True)]
    for (memory, _), value in zip(moved, inside, strict=True):
        blocks.fill(memory, value)


def _scan(blocks: Blocks, operation: ArrayOperation, values: list[Value]) -> list[Value]:
    repeated: Repeated = operation.value
    begin, end = repeated.constants, repeated.constants + repeated.carried
    constants = [blocks.ready(value) for value in values[:begin]]
    carries = [blocks.kept(value) for value in values[begin:end]]
    rows = [value if value.memory else blocks.kept(value) for value in values[end:]]
    program, memories = repeated.program, [carry.lies for carry in carries]
    types = [program.operations[name] for name in program.outputs[repeated.carried :]]
    written = [blocks.region((repeated.length, *kind.shape), kind.kind) for kind in types]

    def body(i: str) -> None:
        k = blocks.affine([i], [-1], repeated.length - 1) if repeated.backwards else i
        here = [row_of(blocks, row, k) for row in rows]
        out = emit(blocks, program, [*constants, *carries, *here])
        for memory, value in zip(written, out[repeated.carried :], strict=True):
            blocks.fill(
                row_of(blocks, blocks.lying(memory, (repeated.length, *value.shape), value.kind), k).lies, value
            )
        commit(blocks, memories, out[: repeated.carried])

    blocks.loop(repeated.length, body)
    shaped = [
        blocks.lying(m, (repeated.length, *kind.shape), kind.kind) for m, kind in zip(written, types, strict=True)
    ]
    return [*carries, *shaped]


def row_of(blocks: Blocks, value: Value, k: str) -> Value:
    """One row of an array in memory."""
    shape, memory = value.shape[1:], value.lies
    start = blocks.place(memory, value.kind, [k, *["0"] * len(shape)])
    return blocks.lying(memory._replace(pointer=start, strides=memory.strides[1:], offset=0), shape, value.kind)


def _qr(blocks: Blocks, operation: ArrayOperation, values: list[Value]) -> list[Value | None]:
    shape = values[0].shape
    if operation.value["full_matrices"] or operation.value["pivoting"] or len(shape) != 2 or shape[0] < shape[1]:
        raise UnsupportedError("a QR factorisation of this form is not supported")
    return [None, triangle(blocks, values[0])]


def _choice(blocks: Blocks, operation: ArrayOperation, values: list[Value]) -> list[Value]:
    """One of two programs; only the chosen one runs."""
    if len(operation.value.programs) != 2:
        raise UnsupportedError("a choice among more than two branches is not supported")
    (no, yes), which, given = operation.value.programs, values[0].at([]), [blocks.ready(value) for value in values[1:]]
    types = [yes.operations[name] for name in yes.outputs]
    memories, label = [blocks.region(kind.shape, kind.kind) for kind in types], blocks.label()
    chosen = blocks.assign(f"icmp ne i64 {which}, 0")
    blocks.lines.append(f"br i1 {chosen}, label %{label}.yes, label %{label}.no")
    for name, program in (("yes", yes), ("no", no)):
        blocks.begin(f"{label}.{name}")
        for memory, value in zip(memories, emit(blocks, program, given), strict=True):
            blocks.fill(memory, value)
        blocks.lines.append(f"br label %{label}.end")
    blocks.begin(f"{label}.end")
    return [blocks.lying(memory, kind.shape, kind.kind) for memory, kind in zip(memories, types, strict=True)]


SEVERAL = {"cond": _choice, "scan": _scan, "qr": _qr, "split": split}
