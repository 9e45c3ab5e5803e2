"""Lines of LLVM assembly with loops: the building blocks of arrays in machine code."""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ..program.primitives import Scalar
from ..program.straight_line import Program
from .scalars import Scalars
from .spelling import hexadecimal

BYTES = {"double": 8, "i64": 8, "i1": 1}
ALIGNED = 64  # bytes of a cache line
FEW = 2  # rounds up to which a loop is unrolled
LOOPS = 1_000_000  # numbers of metadata on loops begin here, above those on memory


class Memory(NamedTuple):
    """The location of an array: entry i, j, .. is `offset` + i strides[0] + j strides[1] + .. entries after `pointer`.

    Memories of different regions (0: unknown) do not overlap.
    """

    pointer: str
    strides: tuple[int, ...]
    offset: int = 0
    region: int = 0


class Value(NamedTuple):
    """An array: `at(index)` writes the lines that compute an entry, and returns its name.

    `memory`: its location, if it has one; `work`: whether an entry needs arithmetic, so that it should not be computed twice;
    `known`: the entries of an array known at compile time.
    """

    shape: tuple[int, ...]
    kind: str
    at: Callable[[list[str]], str]
    memory: Memory | None = None
    work: bool = False
    known: np.ndarray | None = None

    @property
    def lies(self) -> Memory:
        """The location of an array in memory."""
        if self.memory is None:
            raise ValueError("this array is computed where it is read")
        return self.memory


class Blocks:
    """The lines so far, the current block, and the memory they use."""

    def __init__(self):
        self.scalars = Scalars(Program((), (), ()), 1)
        self.lines: list[str] = []
        self.block = "entry"
        self.declared: list[str] = []
        self.given: dict[str, str] = {}
        self.begun: list[str] = []
        self.loops = ['!0 = !{!"llvm.loop.unroll.disable"}']
        self.bytes = self.count = self.regions = 0

    def assign(self, text: str) -> str:
        """A new name for the result of `text`."""
        return self.scalars.assign(text, self.lines)

    def begin(self, block: str) -> None:
        """Begin a block."""
        self.lines.append(f"{block}:")
        self.block = block

    def label(self) -> str:
        """A name for a block."""
        self.count += 1
        return f"b{self.count}"

    def loop(self, count: int, body: Callable[[str], None]) -> None:
        """`body(i)` for i = 0 .. count - 1."""
        self.fold(count, (), lambda i, _: body(i) or ())

    def fold(self, count: int, first: tuple, body: Callable[[str, tuple], tuple]) -> tuple:
        """`state = body(i, state)` for i = 0 .. count - 1; a state is a tuple of (kind, name)."""
        if count <= FEW:
            for i in range(count):
                first = body(str(i), first)
            return first
        before, label = self.block, self.label()
        mark = LOOPS + self.count
        self.lines.append(f"br label %{label}")
        self.begin(label)
        i, further = f"%{label}.i", f"{label}.further"
        self.lines.append(f"{i} = phi i64 [0, %{before}], [{i}.next, %{further}]")
        state = tuple((kind, f"%{label}.s{j}") for j, (kind, _) in enumerate(first))
        for j, (kind, name) in enumerate(first):
            self.lines.append(f"%{label}.s{j} = phi {kind} [{name}, %{before}], [%{label}.t{j}, %{further}]")
        after = body(i, state)
        self.lines.append(f"br label %{further}")
        self.begin(further)
        for j, (kind, name) in enumerate(after):
            self.lines.append(f"%{label}.t{j} = {_same(kind, name)}")
        self.lines += [f"{i}.next = add nuw nsw i64 {i}, 1", f"%{label}.more = icmp ult i64 {i}.next, {count}",
                       f"br i1 %{label}.more, label %{label}, label %{label}.end, !llvm.loop !{mark}"]  # fmt: skip
        self.loops.append(f"!{mark} = distinct !{{!{mark}, !0}}")
        self.begin(f"{label}.end")
        return tuple((kind, f"%{label}.t{j}") for j, (kind, _) in enumerate(first))

    def region(self, shape: tuple[int, ...], kind: str) -> Memory:
        """New memory for an array, row after row."""
        start = self.bytes
        self.bytes += -(-_size(shape, kind) // ALIGNED) * ALIGNED
        self.regions += 1
        self.begun.append(f"%m{self.regions} = getelementptr inbounds i8, ptr %memory, i64 {start}")
        return Memory(f"%m{self.regions}", row_after_row(shape), region=self.regions)

    def new_region(self) -> int:
        """The number of a region that overlaps no other."""
        self.regions += 1
        return self.regions

    def table(self, array: np.ndarray, kind: str) -> Memory:
        """Memory for a known array."""
        held = "i8" if kind == "i1" else kind
        entries = ", ".join(
            f"{held} {number('i64' if kind == 'i1' else kind, entry)}" for entry in array.ravel().tolist()
        )
        name = f"@table{len(self.declared)}"
        self.declared.append(f"{name} = private constant [{array.size} x {held}] [{entries}], align 8")
        return Memory(name, row_after_row(array.shape))

    def argument(self, text: str) -> str:
        """The address of a known scalar, for a routine with arguments by address."""
        if text not in self.given:
            self.given[text] = f"@given{len(self.given)}"
            self.declared.append(f"{self.given[text]} = private constant {text}")
        return self.given[text]

    def assembly(self, arguments: str) -> str:
        """The function `run` of the lines so far."""
        body = (line if line.endswith(":") else f"  {line}" for line in self.lines)
        regions = range(1, self.regions + 1)
        scopes = [f"!{2 * r + 1} = !{{!{2 * r + 1}, !1}}" for r in regions]
        apart = [f"!{2 * r} = !{{{', '.join(f'!{2 * q + 1}' for q in regions if q != r)}}}" for r in regions]
        declared, begun = [*self.declared, *sorted(self.scalars.declared)], (f"  {line}" for line in self.begun)
        head = [f"define void @run({arguments}) {{", "entry:"]
        return "\n".join([*declared, *head, *begun, *body, "}", "!1 = !{!1}", *scopes, *apart, *self.loops, ""])

    def affine(self, index: list[str], strides: Sequence[int], offset: int) -> str:
        """offset + index · strides."""
        total = ""
        for i, stride in zip(index, strides, strict=True):
            if i.isdigit():
                offset += int(i) * stride
            elif stride:
                term = i if stride == 1 else self.assign(f"mul nsw i64 {i}, {stride}")
                total = self.assign(f"add nsw i64 {total}, {term}") if total else term
        if not total:
            return str(offset)
        return self.assign(f"add nsw i64 {total}, {offset}") if offset else total

    def place(self, memory: Memory, kind: str, index: list[str]) -> str:
        """A pointer to an entry."""
        where = self.affine(index, memory.strides, memory.offset)
        held = "i8" if kind == "i1" else kind
        return (
            memory.pointer
            if where == "0"
            else self.assign(f"getelementptr inbounds {held}, ptr {memory.pointer}, i64 {where}")
        )

    def load(self, memory: Memory, kind: str, index: list[str]) -> str:
        """An entry."""
        place = self.place(memory, kind, index)
        if kind != "i1":
            return self.assign(f"load {kind}, ptr {place}, align 8{self.mine(memory)}")
        return self.assign(f"trunc i8 {self.assign(f'load i8, ptr {place}, align 1{self.mine(memory)}')} to i1")

    def mine(self, memory: Memory) -> str:
        """Metadata that declares to LLVM which memory is read."""
        return f", !alias.scope !{{!{2 * memory.region + 1}}}" if memory.region else ""

    def others(self, memory: Memory) -> str:
        """Metadata that declares to LLVM which memory is written, and that no other is."""
        return f"{self.mine(memory)}, !noalias !{2 * memory.region}" if memory.region else ""

    def store(self, memory: Memory, kind: str, index: list[str], name: str) -> None:
        """Write an entry."""
        place = self.place(memory, kind, index)
        if kind != "i1":
            self.lines.append(f"store {kind} {name}, ptr {place}, align 8{self.others(memory)}")
            return
        self.lines.append(f"store i8 {self.assign(f'zext i1 {name} to i8')}, ptr {place}, align 1{self.others(memory)}")

    def lying(self, memory: Memory, shape: tuple[int, ...], kind: str) -> Value:
        """An array in memory."""
        return Value(shape, kind, lambda index: self.load(memory, kind, index), memory)

    def every(self, shape: tuple[int, ...], body: Callable[[list[str]], None], index: tuple[str, ...] = ()) -> None:
        """`body(index)` for every entry of an array."""
        if len(index) == len(shape):
            body(list(index))
            return
        self.loop(shape[len(index)], lambda i: self.every(shape, body, (*index, i)))

    def fill(self, memory: Memory, value: Value) -> None:
        """Write an array."""
        if 0 in value.shape:
            return
        if value.memory is not None and value.memory.strides == memory.strides == row_after_row(value.shape):
            size = _size(value.shape, value.kind)
            if size > 32:
                self.copy(self.place(memory, value.kind, ["0"] * len(value.shape)),
                          self.place(value.memory, value.kind, ["0"] * len(value.shape)), size, BYTES[value.kind])  # fmt: skip
                return
        self.every(value.shape, lambda index: self.store(memory, value.kind, index, value.at(index)))

    def copy(self, target: str, source: str, size: int, align: int) -> None:
        """Copy bytes."""
        self.scalars.declared.add("declare void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1)")
        self.lines.append(
            f"call void @llvm.memcpy.p0.p0.i64(ptr align {align} {target}, ptr align {align} {source}, i64 {size}, i1 false)"
        )

    def kept(self, value: Value) -> Value:
        """The array, written to new memory."""
        memory = self.region(value.shape, value.kind)
        self.fill(memory, value)
        return self.lying(memory, value.shape, value.kind)

    def ready(self, value: Value) -> Value:
        """The array in a form whose entries can be read repeatedly."""
        return self.kept(value) if value.work else value


def number(kind: str, value: Scalar) -> str:
    """A known entry in LLVM's notation."""
    if kind == "i1":
        return "true" if value else "false"
    return str(int(value)) if kind == "i64" else hexadecimal(float(value))


def _size(shape: tuple[int, ...], kind: str) -> int:
    """The bytes of an array."""
    return BYTES[kind] * math.prod(shape)


def row_after_row(shape: tuple[int, ...]) -> tuple[int, ...]:
    """The strides of an array with contiguous rows."""
    strides, step = [], 1
    for count in reversed(shape):
        strides.append(step)
        step *= count
    return tuple(reversed(strides))


def _same(kind: str, name: str) -> str:
    return f"select i1 true, {kind} {name}, {kind} {name}"
