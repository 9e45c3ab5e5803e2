"""Elementwise operations on arrays, according to the table of primitives."""

from ..program.arrays import KINDS, TYPES, ArrayOperation
from ..program.composed import composed, type_of_value
from ..program.primitives import Scalar, UnsupportedError, row
from .blocks import Blocks, Value
from .moves import stretched

Entry = tuple[str, str]  # type and name


class _Printed:
    """Entries as lines of assembly."""

    def __init__(self, blocks: Blocks):
        self.blocks = blocks

    def each(self, name: str, *entries: Entry) -> Entry:
        """A row of the table."""
        types = tuple(type_ for type_, _ in entries)
        names = [word for _, word in entries]
        return row(name, types).result, self.blocks.scalars.operation(name, names, types, self.blocks.lines)

    def constant(self, value: Scalar) -> Entry:
        """A known entry."""
        return type_of_value(value), self.blocks.scalars.constant(value)


def each(blocks: Blocks, operation: ArrayOperation, values: list[Value]) -> Value:
    """The operation entry by entry, computed where an entry is read; axes of length one, and scalars, are broadcast."""
    types, shape = [TYPES[value.kind] for value in values], operation.shape
    alike = [stretched(blocks, v, shape, range(len(shape) - len(v.shape), len(shape))) for v in values]

    def at(index: list[str]) -> str:
        entries = [(type_, v.at(index)) for type_, v in zip(types, alike, strict=True)]
        type_, entry = composed(_Printed(blocks), operation.name, operation.value, *entries)
        if KINDS[type_] != operation.kind:
            given = " and ".join(map(str, operation.value.given))
            raise UnsupportedError(f"the primitive {operation.name} of {given} is not supported")
        return entry

    return Value(shape, operation.kind, at, work=True)


def converted(blocks: Blocks, value: Value, kind: str) -> Value:
    """The array with entries of another kind."""
    name = f"to_{TYPES[kind]}"
    if value.kind == kind:
        return value
    return Value(value.shape, kind, lambda index: scalar(blocks, name, [value.kind], [value.at(index)]), work=True)


def scalar(blocks: Blocks, name: str, kinds: list[str], names: list[str]) -> str:
    """One row of the table applied to scalars of these kinds."""
    return blocks.scalars.operation(name, names, tuple([TYPES[kind] for kind in kinds]), blocks.lines)
