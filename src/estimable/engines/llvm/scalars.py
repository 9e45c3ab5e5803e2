"""Scalars as lines of LLVM's assembly, several runs side by side in SIMD lanes."""

import struct
from typing import Any

from ..program.straight_line import TRANSCENDENTAL, Program
from .logarithm import Logarithm

ARITHMETIC = {"add": "fadd", "sub": "fsub", "mul": "fmul", "div": "fdiv"}
LOGIC = {"and": "and", "or": "or", "xor": "xor"}
COMPARE = {"eq": "oeq", "ne": "une", "lt": "olt", "le": "ole", "gt": "ogt", "ge": "oge"}
INTRINSICS = {"abs": "fabs", "sqrt": "sqrt", "log": "log", "exp": "exp", "exp2": "exp2", "pow": "pow", "round": "roundeven",
              "floor": "floor", "truncate": "trunc"} | {name: name for name in TRANSCENDENTAL}  # fmt: skip


class Scalars:
    """Prints the operations of a program, one line or a few at a time."""

    def __init__(self, program: Program, lanes: int):
        self.program, self.lanes = program, lanes
        self.number = "double" if lanes == 1 else f"<{lanes} x double>"
        self.truth = "i1" if lanes == 1 else f"<{lanes} x i1>"
        self.bits = "i64" if lanes == 1 else f"<{lanes} x i64>"
        self.suffix = "f64" if lanes == 1 else f"v{lanes}f64"
        self.declared: set[str] = set()
        self.count = 0

    def assign(self, text: str, lines: list[str]) -> str:
        """A new name for what `text` gives."""
        self.count += 1
        lines.append(f"%t{self.count} = {text}")
        return f"%t{self.count}"

    def constant(self, value: Any) -> str:
        """A constant, in every lane."""
        word = ("true" if value else "false") if isinstance(value, bool) else hexadecimal(value)
        if self.lanes == 1:
            return word
        kind = "i1" if isinstance(value, bool) else "double"
        return "<" + ", ".join([f"{kind} {word}"] * self.lanes) + ">"

    def is_truth(self, name: int) -> bool:
        """Whether a scalar is a truth."""
        return self.program.is_truth(name)

    def define(self, name: int, names: dict[int, str], lines: list[str]) -> str:
        """The scalar `name`, a constant or an operation on scalars that have names."""
        op = self.program.operations[name]
        if op.name == "constant":
            return self.constant(op.value)
        kinds = ["truth" if self.is_truth(a) else "number" for a in op.arguments]
        return self.operation(op.name, [names[a] for a in op.arguments], kinds, lines)

    def load(self, name: int, base: str, entry: int, kind: str, lines: list[str]) -> str:
        """The scalar `name` from an entry of what `base` points to."""
        if kind == "double":
            return self.from_memory(name, self.read(base, entry, lines), lines)
        byte = self.assign(f"load i8, ptr {self.place(base, entry, kind, lines)}", lines)
        return self.assign(f"icmp ne i8 {byte}, 0", lines)

    def read(self, base: str, entry: int, lines: list[str]) -> str:
        """The number at an entry of what `base` points to."""
        return self.assign(f"load {self.number}, ptr {self.place(base, entry, 'double', lines)}, align 8", lines)

    def write(self, value: str, base: str, entry: int, lines: list[str]) -> None:
        """Write a number to an entry of what `base` points to."""
        lines.append(f"store {self.number} {value}, ptr {self.place(base, entry, 'double', lines)}, align 8")

    def place(self, base: str, entry: int, kind: str, lines: list[str]) -> str:
        """A pointer to an entry of what `base` points to."""
        return self.assign(f"getelementptr inbounds {kind}, ptr {base}, i64 {entry * self.lanes}", lines)

    def store(self, name: int, value: str, base: str, entry: int, kind: str, lines: list[str]) -> None:
        """Write the scalar `name` to an entry of what `base` points to."""
        if kind == "double":
            self.write(self.in_memory(name, value, lines), base, entry, lines)
            return
        change = "zext i1" if self.is_truth(name) else "fptosi double"
        whole = self.assign(f"{change} {value} to {kind}", lines)
        lines.append(f"store {kind} {whole}, ptr {self.place(base, entry, kind, lines)}")

    def copy(self, base: str, source: int, target: int, kind: str, lines: list[str]) -> None:
        """Write what one entry of what `base` points to holds to another."""
        held = self.number if kind == "double" else kind
        align = 1 if kind == "i8" else 8
        value = self.assign(f"load {held}, ptr {self.place(base, source, kind, lines)}, align {align}", lines)
        lines.append(f"store {held} {value}, ptr {self.place(base, target, kind, lines)}, align {align}")

    def row_of(self, name: str, base: str, kind: str, items: int, row: str, lines: list[str]) -> None:
        """`name` points to a row of what `base` points to."""
        offset = self.assign(f"mul i64 {row}, {items * self.lanes}", lines)
        lines.append(f"{name} = getelementptr inbounds {kind}, ptr {base}, i64 {offset}")

    def begin(self, rows: list[str], lines: list[str]) -> None:
        """Nothing: each array of rows holds those of all lanes."""

    def function(self, rows: list[str], sizes: list[int], body: str) -> str:
        """The function that runs one group of runs side by side."""
        pointers = ", ".join(f"ptr noalias {base}" for base in ("%fixed", "%carry", "%last", *rows))
        return f"define void @run(i64 %T, {pointers}) {{\n{body}\n}}\n"

    def in_memory(self, name: int, value: str, lines: list[str]) -> str:
        """A scalar as a number."""
        return self.operation("number", [value], ["truth"], lines) if self.is_truth(name) else value

    def from_memory(self, name: int, value: str, lines: list[str]) -> str:
        """A number as the scalar that it is."""
        return self.operation("truth", [value], ["number"], lines) if self.is_truth(name) else value

    def all_equal(self, pairs: list[tuple[str, str]], kind: str, lines: list[str]) -> str:
        """Whether the two of every pair are the same to the last bit, in all lanes."""
        equal = self.constant(True)
        for a, b in pairs:
            if kind == "number":
                a, b = (self.assign(f"bitcast {self.number} {x} to {self.bits}", lines) for x in (a, b))
            same = self.assign(f"icmp eq {self.bits if kind == 'number' else self.truth} {a}, {b}", lines)
            equal = self.assign(f"and {self.truth} {equal}, {same}", lines)
        if self.lanes == 1:
            return equal
        reduce = f"i1 @llvm.vector.reduce.and.v{self.lanes}i1"
        self.declared.add(f"declare {reduce}({self.truth})")
        return self.assign(f"call {reduce}({self.truth} {equal})", lines)

    def intrinsic(self, name: str, arguments: list[str]) -> str:
        """A call of one of LLVM's functions of numbers."""
        kinds = ", ".join([self.number] * len(arguments))
        self.declared.add(f"declare {self.number} @llvm.{name}.{self.suffix}({kinds})")
        return f"call {self.number} @llvm.{name}.{self.suffix}({', '.join(f'{self.number} {a}' for a in arguments)})"

    def operation(self, name: str, a: list[str], kinds: list[str], lines: list[str]) -> str:
        """The name of the result."""
        if name in ARITHMETIC:
            text = f"{ARITHMETIC[name]} contract {self.number} {a[0]}, {a[1]}"
        elif name in LOGIC:
            text = f"{LOGIC[name]} {self.truth} {a[0]}, {a[1]}"
        elif name in COMPARE and kinds[0] == "truth":
            text = f"icmp {'eq' if name == 'eq' else 'ne'} {self.truth} {a[0]}, {a[1]}"
        elif name in COMPARE:
            text = f"fcmp {COMPARE[name]} {self.number} {a[0]}, {a[1]}"
        elif name == "log" and self.lanes > 1:
            return Logarithm(self, lines).of(a[0])
        elif name in INTRINSICS:
            text = self.intrinsic(INTRINSICS[name], a)
        elif name == "select":
            kind = self.truth if kinds[1] == "truth" else self.number
            text = f"select {self.truth} {a[0]}, {kind} {a[1]}, {kind} {a[2]}"
        else:
            text = self.rest(name, a, lines)
        return self.assign(text, lines)

    def rest(self, name: str, a: list[str], lines: list[str]) -> str:
        """The operations that LLVM has no single word for."""
        if name == "neg":
            return f"fneg {self.number} {a[0]}"
        if name == "settles":
            return f"and {self.truth} {a[0]}, {a[0]}"
        if name == "not":
            return f"xor {self.truth} {a[0]}, {self.constant(True)}"
        if name == "number":
            return f"uitofp {self.truth} {a[0]} to {self.number}"
        if name == "truth":
            return f"fcmp une {self.number} {a[0]}, {self.constant(0.0)}"
        if name == "is_finite":
            size = self.assign(self.intrinsic("fabs", a), lines)
            return f"fcmp olt {self.number} {size}, {self.constant(float('inf'))}"
        further = "ogt" if name == "max" else "olt"  # max and min: a NaN wins, as in JAX
        beyond = self.assign(f"fcmp {further} {self.number} {a[0]}, {a[1]}", lines)
        chosen = self.assign(f"select {self.truth} {beyond}, {self.number} {a[0]}, {self.number} {a[1]}", lines)
        undefined = self.assign(f"fcmp uno {self.number} {a[0]}, {a[0]}", lines)
        return f"select {self.truth} {undefined}, {self.number} {a[0]}, {self.number} {chosen}"


def hexadecimal(value: float) -> str:
    """A number as LLVM writes it, to the last bit."""
    return f"0x{struct.unpack('<Q', struct.pack('<d', value))[0]:016X}"
