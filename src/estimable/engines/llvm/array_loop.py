"""The loop over time around operations on arrays, as LLVM assembly: `scalar_loop` for arrays instead of scalars."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar

from ..program.arrays import Arrays
from ..program.steady_state import SteadyPart, same_in_every_row, steady_part
from .blocks import Blocks, Memory, Value, row_after_row
from .elementwise import converted
from .emit import commit, compute, emit, read_again, row_of
from .scalar_loop import RowArray, ScalarLoop

BITS = {"double": "i64", "i64": "i64", "i1": "i1"}
HELD = {"double": "double", "i64": "i64", "i1": "double"}  # type of an entry in a word of eight bytes


@dataclass(eq=False)
class ArrayLoop:
    """A program of arrays run row by row.

    `start`: from the fixed arrays to the first state; None where there is no state. `program`: from the fixed arrays, a state and
    a row to the next state, `count` arrays written for each row, and further arrays written for the last row only. `fixed` and
    the outputs of the last row are consecutive words in memory. `seek_steady` as in `ScalarLoop`. `bytes`: the memory needed,
    known once the assembly is.
    """

    program: Arrays
    start: Arrays | None
    fixed: int
    states: int
    count: int
    seek_steady: bool = True
    bytes: int = 0
    has_loops: ClassVar[bool] = True  # inside a row
    integers: ClassVar[int] = 1  # arguments of the function before its arrays

    @property
    def each(self) -> tuple[int, ...]:
        """The arrays written for each row."""
        return self.program.outputs[self.states : self.states + self.count]

    @property
    def last(self) -> tuple[int, ...]:
        """The arrays written for the last row."""
        return self.program.outputs[self.states + self.count :]

    @property
    def rows(self) -> int:
        """The number of arrays that a row is read from."""
        return len(self.program.inputs) - self.fixed - self.states

    @property
    def pointers(self) -> int:
        """The number of arrays that the function takes."""
        return 3 + self.rows + len(self.each)

    def assembly(self, lanes: int = 1) -> str:
        """The function `run(rows, fixed, memory of `bytes`, last, an array of each of the row's, of each that is written)`."""
        text = _ArrayLoopText(self)
        written = text.write()
        self.bytes = text.blocks.bytes
        return written


class _ArrayLoopText:
    """The blocks: those of `scalar_loop`, with the carry in memory.

    The steady part remains in place, where `rest` reads it. `differ` returns to `whole`.
    """

    def __init__(self, loop: ArrayLoop):
        self.loop, self.blocks, self.program = loop, Blocks(), loop.program
        inputs, outputs, begin = loop.program.inputs, loop.program.outputs, loop.fixed + loop.states
        self.alive = [i for i in range(loop.states) if inputs[loop.fixed + i] >= 0]
        self.carry = tuple(inputs[loop.fixed + i] for i in self.alive)
        self.next = tuple(outputs[i] for i in self.alive)
        read = RowArray(tuple(name for name in inputs[begin:] if name >= 0))
        flat = ScalarLoop(loop.program, (), self.carry, (read,), self.next, (), ())  # pyright: ignore[reportArgumentType]
        self.same = same_in_every_row(flat)
        part = steady_part(flat, self.same) if loop.seek_steady else None
        self.part = part or SteadyPart(frozenset(), tuple(False for _ in self.same), ())
        groups = [{name for name, yes in enumerate(group) if yes} for group in (self.same, self.part.slow)]
        self.again = read_again(loop.program, groups)
        self.rows = [self._outside(f"%row{i}") for i in range(loop.rows)]
        self.each = [self._outside(f"%each{i}") for i in range(len(loop.each))]
        self.fixed, self.last = self._outside("%fixed"), self._outside("%last")

    def _outside(self, pointer: str) -> Memory:
        """Memory of the caller."""
        return Memory(pointer, (), region=self.blocks.new_region())

    def write(self) -> str:
        values = self._entry()
        values = self._whole(values)
        if self.part.carry:
            self._rest(values)
        self.blocks.begin("exit")
        self.blocks.lines.append("ret void")
        arrays = [memory.pointer for memory in (*self.rows, *self.each)]
        pointers = ", ".join(f"ptr noalias {pointer}" for pointer in ("%fixed", "%memory", "%last", *arrays))
        return self.blocks.assembly(f"i64 %T, {pointers}")

    def _entry(self) -> dict[int, Value]:
        """The values that are the same in every row, and the first state."""
        blocks, fixed = self.blocks, self._fixed()
        values = {name: value for name, value in zip(self.program.inputs, fixed, strict=False) if name >= 0}
        types = [self.program.operations[name] for name in self.carry]
        self.memories = [blocks.region(kind.shape, kind.kind) for kind in types]
        if self.loop.start is not None:
            first = emit(blocks, self.loop.start, fixed)
            commit(blocks, self.memories, [first[i] for i in self.alive])
        same = [name for name, yes in enumerate(self.same) if yes]
        compute(blocks, self.program, values, same, self.again)
        for name, memory, kind in zip(self.carry, self.memories, types, strict=True):
            values[name] = blocks.lying(memory, kind.shape, kind.kind)
        self.came = blocks.block
        blocks.lines.append("br label %whole")
        return values

    def _fixed(self) -> list[Value]:
        """The fixed arrays, one after the other."""
        values, offset = [], 0
        for shape, kind in self.program.types[: self.loop.fixed]:
            memory = self.fixed._replace(strides=row_after_row(shape), offset=offset)
            values.append(converted(self.blocks, self.blocks.lying(memory, shape, HELD[kind]), kind))
            offset += math.prod(shape)
        return values

    def _whole(self, values: dict[int, Value]) -> dict[int, Value]:
        """A whole row."""
        blocks, choices = self.blocks, self.part.choices
        self.held = [blocks.region(self.program.operations[choice].shape, "i1") for choice in choices]
        blocks.begin("whole")
        back = ", [%rest.row, %differ]" if self.part.carry else ""
        blocks.lines.append(f"%whole.row = phi i64 [0, %{self.came}], [%whole.next, %again]{back}")
        values = self._computed(values, "whole")
        self._write_row(values, "whole")
        steady = self._all_equal([(values[self.carry[i]], values[self.next[i]]) for i in sorted(self.part.carry)])
        for memory, choice in zip(self.held, choices, strict=True):
            blocks.fill(memory, values[choice])
        self._commit(values, range(len(self.alive)))
        self._go_on("whole", "again")
        blocks.begin("again")
        blocks.lines.append(f"br i1 {steady}, label %rest, label %whole" if self.part.carry else "br label %whole")
        return values

    def _rest(self, whole: dict[int, Value]) -> None:
        """A row without its steady part, while the choices that this part depends on are unchanged."""
        blocks, slow = self.blocks, self.part.slow
        blocks.begin("rest")
        blocks.lines.append("%rest.row = phi i64 [%whole.next, %again], [%rest.next, %more]")
        there = {name: value for name, value in whole.items() if slow[name] or self.same[name] or name in self.carry}
        values = self._computed(there, "rest")
        held = [blocks.lying(memory, values[choice].shape, "i1")
                for memory, choice in zip(self.held, self.part.choices, strict=True)]  # fmt: skip
        holds = self._all_equal(list(zip(held, (values[choice] for choice in self.part.choices), strict=True)))
        blocks.lines.append(f"br i1 {holds}, label %commit, label %differ")
        blocks.begin("differ")
        blocks.lines.append("br label %whole")
        blocks.begin("commit")
        self._write_row(values, "rest")
        self._commit(values, [i for i in range(len(self.alive)) if i not in self.part.carry])
        self._go_on("rest", "more")
        blocks.begin("more")
        blocks.lines.append("br label %rest")

    def _computed(self, values: dict[int, Value], block: str) -> dict[int, Value]:
        """The values, extended by those of a row."""
        values, begin = dict(values), self.loop.fixed + self.loop.states
        for memory, name in zip(self.rows, self.program.inputs[begin:], strict=True):
            if name >= 0:
                operation = self.program.operations[name]
                values[name] = self._row(memory, operation.shape, operation.kind, block)
        compute(self.blocks, self.program, values, range(len(self.same)), self.again)
        return values

    def _row(self, memory: Memory, shape: tuple[int, ...], kind: str, block: str) -> Value:
        """A row of an array."""
        rows = memory._replace(strides=(math.prod(shape), *row_after_row(shape)))
        return row_of(self.blocks, self.blocks.lying(rows, (0, *shape), kind), f"%{block}.row")

    def _write_row(self, values: dict[int, Value], block: str) -> None:
        """Write the outputs of a row."""
        for memory, name in zip(self.each, self.loop.each, strict=True):
            value = values[name]
            self.blocks.fill(self._row(memory, value.shape, value.kind, block).lies, value)
        offset = 0
        for name in self.loop.last:
            value = converted(self.blocks, values[name], HELD[values[name].kind])
            self.blocks.fill(self.last._replace(strides=row_after_row(value.shape), offset=offset), value)
            offset += math.prod(value.shape)

    def _commit(self, values: dict[int, Value], which: Iterable[int]) -> None:
        """Write the next state."""
        which = list(which)
        commit(self.blocks, [self.memories[i] for i in which], [values[self.next[i]] for i in which])

    def _go_on(self, block: str, more: str) -> None:
        """Continue with the next row."""
        self.blocks.lines += [f"%{block}.next = add nuw nsw i64 %{block}.row, 1",
                              f"%{block}.more = icmp slt i64 %{block}.next, %T",
                              f"br i1 %{block}.more, label %{more}, label %exit"]  # fmt: skip

    def _all_equal(self, pairs: list[tuple[Value, Value]]) -> str:
        """Whether the values of every pair are bitwise equal."""
        blocks, same = self.blocks, "true"

        def further(a: Value, b: Value, index: list[str], so_far: str) -> str:
            if len(index) == len(a.shape):
                bits = BITS[a.kind]
                one, two = (blocks.assign(f"bitcast {a.kind} {value.at(index)} to {bits}") for value in (a, b))
                equal = blocks.assign(f"icmp eq {bits} {one}, {two}")
                return blocks.assign(f"and i1 {so_far}, {equal}")
            ((_, equal),) = blocks.fold(
                a.shape[len(index)],
                (("i1", so_far),),
                lambda i, state: (("i1", further(a, b, [*index, i], state[0][1])),),
            )
            return equal

        for a, b in pairs:
            same = further(a, b, [], same)
        return same
