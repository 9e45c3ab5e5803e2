"""The rows of the table of primitives in LLVM's notation."""

import re
import struct
from functools import cache
from typing import NamedTuple

from ..program.primitives import BOOL, FLOAT, INTEGER, UnsupportedError, row

ARGUMENT = re.compile(r"(\{\w+\}) \{[^{}]*\}")  # an argument of a call: its type and its name
ELEMENTS = {FLOAT: "double", INTEGER: "i64", BOOL: "i1"}


class Word(NamedTuple):
    """A type of LLVM; its format specification is a constant of that type, in every lane."""

    element: str
    lanes: int

    def __str__(self) -> str:
        return self.element if self.lanes == 1 else f"<{self.lanes} x {self.element}>"

    def __format__(self, constant: str) -> str:
        if not constant:
            return str(self)
        word = hexadecimal(float(constant)) if self.element == "double" else constant
        return word if self.lanes == 1 else "<" + ", ".join([f"{self.element} {word}"] * self.lanes) + ">"

    @property
    def suffix(self) -> str:
        """The type in the name of an intrinsic."""
        element = "f64" if self.element == "double" else self.element
        return element if self.lanes == 1 else f"v{self.lanes}{element}"


class Spelling(NamedTuple):
    """The lines of a row for a number of lanes: {0}, {1}, {2} are its arguments, {3}, {4}, .. the preceding lines.

    `by_lane`: whether it is a call of the C library, which processes one lane at a time.
    """

    lines: tuple[str, ...]
    declared: tuple[str, ...]
    by_lane: bool


@cache
def spelled(name: str, types: tuple[str, ...], lanes: int) -> Spelling:
    """A row of the table in LLVM's notation. Raises `UnsupportedError` where there is no such row or function."""
    lines = row(name, types).llvm
    functions = [line[line.index("@") + 1 : line.index("(")] for line in lines if line.startswith("call")]
    from_library = [function for function in functions if not function.startswith("llvm.")]
    for function in from_library:
        provide_function(function)
    one = 1 if from_library else lanes
    words = {letter: Word(ELEMENTS[type_], one) for letter, type_ in zip("fip", ELEMENTS, strict=True)}
    words |= {"sf": words["f"].suffix, "si": words["i"].suffix}
    heads = [ARGUMENT.sub(r"\1", line.replace("call", "declare")) for line in lines if line.startswith("call")]
    arguments = {letter: f"{{{i}}}" for i, letter in enumerate("abc")}
    before = [f"{{{i + 3}}}" for i in range(len(lines))]
    return Spelling(
        tuple(line.format(*before, **arguments, **words) for line in lines),
        tuple(head.format(**words) for head in heads), bool(from_library) and lanes > 1,
    )  # fmt: skip


def hexadecimal(value: float) -> str:
    """A float in LLVM's notation, to the last bit."""
    return f"0x{struct.unpack('<Q', struct.pack('<d', value))[0]:016X}"


@cache
def provide_function(name: str) -> None:
    """Raise `UnsupportedError` for a function that the C library of this process lacks: LLVM would end the process."""
    import llvmlite.binding as llvm

    if llvm.address_of_symbol(name) is None:
        raise UnsupportedError(f"the C library has no function {name}")
