"""Scalars as lines of LLVM assembly, several runs side by side in SIMD lanes."""

from collections.abc import Sequence

from ..program.primitives import BOOL, FLOAT, INTEGER, Scalar
from ..program.straight_line import Program
from .logarithm import Logarithm
from .spelling import ELEMENTS, Word, spelled


class Scalars:
    """Prints the operations of a program, one line or a few at a time.

    A float in memory is itself, a bool is 1.0 or 0.0, and an integer its 64 bits: each is a word of eight bytes.
    """

    def __init__(self, program: Program, lanes: int):
        self.program, self.lanes = program, lanes
        self.words = {type_: Word(element, lanes) for type_, element in ELEMENTS.items()}
        self.float, self.integer, self.bool = (str(self.words[type_]) for type_ in (FLOAT, INTEGER, BOOL))
        self.declared: set[str] = set()
        self.count = 0

    def assign(self, text: str, lines: list[str]) -> str:
        """A new name for the result of `text`."""
        self.count += 1
        lines.append(f"%t{self.count} = {text}")
        return f"%t{self.count}"

    def constant(self, value: Scalar) -> str:
        """A constant, in every lane."""
        if isinstance(value, bool):
            return format(self.words[BOOL], str(value).lower())
        return format(self.words[INTEGER if isinstance(value, int) else FLOAT], repr(value))

    def type_of(self, name: int) -> str:
        """The type of a scalar."""
        return self.program.operations[name].type

    def define(self, name: int, names: dict[int, str], lines: list[str]) -> str:
        """The scalar `name`, a constant or an operation on named scalars."""
        operations = self.program.operations
        op = operations[name]
        if op.name == "constant":
            return self.constant(op.value)
        types = tuple([operations[a].type for a in op.arguments])
        return self.operation(op.name, [names[a] for a in op.arguments], types, lines)

    def load(self, name: int, base: str, entry: int, kind: str, lines: list[str]) -> str:
        """The scalar `name` from an entry of `base`."""
        if kind == "double":
            return self.from_memory(name, self.read(base, entry, lines), lines)
        byte = self.assign(f"load i8, ptr {self.place(base, entry, kind, lines)}", lines)
        return self.assign(f"icmp ne i8 {byte}, 0", lines)

    def read(self, base: str, entry: int, lines: list[str]) -> str:
        """The word at an entry of `base`."""
        return self.assign(f"load {self.float}, ptr {self.place(base, entry, 'double', lines)}, align 8", lines)

    def write(self, value: str, base: str, entry: int, lines: list[str]) -> None:
        """Write a word to an entry of `base`."""
        lines.append(f"store {self.float} {value}, ptr {self.place(base, entry, 'double', lines)}, align 8")

    def place(self, base: str, entry: int, kind: str, lines: list[str]) -> str:
        """A pointer to an entry of `base`."""
        return self.assign(f"getelementptr inbounds {kind}, ptr {base}, i64 {entry * self.lanes}", lines)

    def store(self, name: int, value: str, base: str, entry: int, kind: str, lines: list[str]) -> None:
        """Write the scalar `name` to an entry of `base`."""
        if kind == "double":
            self.write(self.in_memory(name, value, lines), base, entry, lines)
            return
        held = self.assign(f"zext i1 {value} to i8", lines) if kind == "i8" else value
        lines.append(f"store {kind} {held}, ptr {self.place(base, entry, kind, lines)}")

    def copy(self, base: str, source: int, target: int, kind: str, lines: list[str]) -> None:
        """Copy one entry of `base` to another."""
        held = self.float if kind == "double" else kind
        align = 1 if kind == "i8" else 8
        value = self.assign(f"load {held}, ptr {self.place(base, source, kind, lines)}, align {align}", lines)
        lines.append(f"store {held} {value}, ptr {self.place(base, target, kind, lines)}, align {align}")

    def row_of(self, name: str, base: str, kind: str, items: int, row: str, lines: list[str]) -> None:
        """Point `name` to a row of `base`."""
        offset = self.assign(f"mul i64 {row}, {items * self.lanes}", lines)
        lines.append(f"{name} = getelementptr inbounds {kind}, ptr {base}, i64 {offset}")

    def begin(self, rows: list[str], lines: list[str]) -> None:
        """No lines: each array of rows holds those of all lanes."""

    def function(self, rows: list[str], sizes: list[int], body: str) -> str:
        """The function that runs one group of runs side by side."""
        pointers = ", ".join(f"ptr noalias {base}" for base in ("%fixed", "%carry", "%last", *rows))
        return f"define void @run(i64 %T, {pointers}) {{\n{body}\n}}\n"

    def in_memory(self, name: int, value: str, lines: list[str]) -> str:
        """A scalar as a word."""
        row_of = {FLOAT: "", INTEGER: "from_bits", BOOL: "to_float"}[self.type_of(name)]
        return self.operation(row_of, [value], (self.type_of(name),), lines) if row_of else value

    def from_memory(self, name: int, value: str, lines: list[str]) -> str:
        """The scalar in a word."""
        row_of = {FLOAT: "", INTEGER: "bits", BOOL: "to_bool"}[self.type_of(name)]
        return self.operation(row_of, [value], (FLOAT,), lines) if row_of else value

    def all_equal(self, pairs: list[tuple[str, str]], type_: str, lines: list[str]) -> str:
        """Whether the values of every pair are bitwise equal, in all lanes."""
        equal = self.constant(True)
        for a, b in pairs:
            if type_ == FLOAT:
                a, b = (self.assign(f"bitcast {self.float} {x} to {self.integer}", lines) for x in (a, b))
            same = self.assign(f"icmp eq {self.bool if type_ == BOOL else self.integer} {a}, {b}", lines)
            equal = self.assign(f"and {self.bool} {equal}, {same}", lines)
        if self.lanes == 1:
            return equal
        reduce = f"i1 @llvm.vector.reduce.and.v{self.lanes}i1"
        self.declared.add(f"declare {reduce}({self.bool})")
        return self.assign(f"call {reduce}({self.bool} {equal})", lines)

    def operation(self, name: str, arguments: Sequence[str], types: tuple[str, ...], lines: list[str]) -> str:
        """The name of the result of a row of the table."""
        if name == "log" and self.lanes > 1:
            return Logarithm(self, lines).of(arguments[0])
        texts, declared, by_lane = spelled(name, types, self.lanes)
        if declared:
            self.declared.update(declared)
        if by_lane:
            return self.lane_by_lane(name, arguments, types, lines)
        given = [*arguments, "", ""][:3]
        for text in texts:
            given.append(self.assign(text.format(*given), lines))
        return given[-1]

    def lane_by_lane(self, name: str, arguments: Sequence[str], types: tuple[str, ...], lines: list[str]) -> str:
        """The result of a function of scalars."""
        (line,), vector = spelled(name, types, 1).lines, "poison"
        for lane in range(self.lanes):
            given = [self.assign(f"extractelement {self.float} {x}, i64 {lane}", lines) for x in arguments]
            value = self.assign(line.format(*given), lines)
            vector = self.assign(f"insertelement {self.float} {vector}, double {value}, i64 {lane}", lines)
        return vector
