"""A straight line of scalars as machine code: the loop over time inside, several runs side by side in SIMD lanes.

Memory is float64 throughout, entry after entry, each entry `lanes` numbers long. What depends on nothing that changes is
computed before the loop. Compiled objects are kept on disk, under a name made of the text, the versions and the processor.
"""

import ctypes
import hashlib
import os
import struct
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from .straight_line import TRANSCENDENTAL, TRUTHS, Program, UnsupportedError

ARITHMETIC = {"add": "fadd", "sub": "fsub", "mul": "fmul", "div": "fdiv"}
LOGIC = {"and": "and", "or": "or", "xor": "xor"}
COMPARE = {"eq": "oeq", "ne": "une", "lt": "olt", "le": "ole", "gt": "ogt", "ge": "oge"}
INTRINSICS = {"abs": "fabs", "sqrt": "sqrt", "log": "log", "exp": "exp", "exp2": "exp2", "pow": "pow", "round": "roundeven",
              "floor": "floor", "truncate": "trunc"} | {name: name for name in TRANSCENDENTAL}  # fmt: skip


class Loop(NamedTuple):
    """A program run row by row: which of its inputs are fixed, carried from row to row, or read from the row.

    Its outputs are the next carry, then what is written of each row, then what is written of the last row only.
    """

    program: Program
    fixed: tuple[int, ...]
    carry: tuple[int, ...]
    row: tuple[int, ...]
    next_carry: tuple[int, ...]
    each: tuple[int, ...]
    last: tuple[int, ...]


class _Text:
    """LLVM's assembly of one loop."""

    def __init__(self, loop: Loop, lanes: int):
        self.loop, self.lanes = loop, lanes
        self.number = "double" if lanes == 1 else f"<{lanes} x double>"
        self.truth = "i1" if lanes == 1 else f"<{lanes} x i1>"
        self.suffix = "f64" if lanes == 1 else f"v{lanes}f64"
        self.declared: set[str] = set()
        self.count = 0

    def fresh(self) -> str:
        self.count += 1
        return f"%t{self.count}"

    def constant(self, value: Any) -> str:
        word = ("true" if value else "false") if isinstance(value, bool) else _hexadecimal(value)
        if self.lanes == 1:
            return word
        kind = "i1" if isinstance(value, bool) else "double"
        return "<" + ", ".join([f"{kind} {word}"] * self.lanes) + ">"

    def load(self, base: str, place: int, lines: list[str]) -> str:
        pointer, value = self.fresh(), self.fresh()
        lines.append(f"{pointer} = getelementptr inbounds double, ptr {base}, i64 {place * self.lanes}")
        lines.append(f"{value} = load {self.number}, ptr {pointer}, align 8")
        return value

    def store(self, value: str, base: str, place: int, lines: list[str]) -> None:
        pointer = self.fresh()
        lines.append(f"{pointer} = getelementptr inbounds double, ptr {base}, i64 {place * self.lanes}")
        lines.append(f"store {self.number} {value}, ptr {pointer}, align 8")

    def intrinsic(self, name: str, arguments: list[str]) -> str:
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
        elif name in INTRINSICS:
            text = self.intrinsic(INTRINSICS[name], a)
        elif name == "select":
            kind = self.truth if kinds[1] == "truth" else self.number
            text = f"select {self.truth} {a[0]}, {kind} {a[1]}, {kind} {a[2]}"
        else:
            text = self.rest(name, a, lines)
        result = self.fresh()
        lines.append(f"{result} = {text}")
        return result

    def rest(self, name: str, a: list[str], lines: list[str]) -> str:
        """The operations that LLVM has no single word for."""
        if name == "neg":
            return f"fneg {self.number} {a[0]}"
        if name == "not":
            return f"xor {self.truth} {a[0]}, {self.constant(True)}"
        if name == "number":
            return f"uitofp {self.truth} {a[0]} to {self.number}"
        if name == "truth":
            return f"fcmp une {self.number} {a[0]}, {self.constant(0.0)}"
        if name == "is_finite":
            size = self.fresh()
            lines.append(f"{size} = {self.intrinsic('fabs', a)}")
            return f"fcmp olt {self.number} {size}, {self.constant(float('inf'))}"
        beyond, undefined, first = self.fresh(), self.fresh(), self.fresh()  # max and min: a NaN wins, as in JAX
        lines.append(f"{beyond} = fcmp {'ogt' if name == 'max' else 'olt'} {self.number} {a[0]}, {a[1]}")
        lines.append(f"{undefined} = fcmp uno {self.number} {a[0]}, {a[0]}")
        lines.append(f"{first} = or {self.truth} {beyond}, {undefined}")
        return f"select {self.truth} {first}, {self.number} {a[0]}, {self.number} {a[1]}"

    def write(self) -> str:
        """The function `run(rows, fixed, carry, row data, of each row, of the last row)`."""
        loop = self.loop
        before: list[str] = []
        inside: list[str] = []
        phis = {name: f"%carry{i}" for i, name in enumerate(loop.carry)}
        starts = {name: self.load("%carry", i, before) for i, name in enumerate(loop.carry)}
        names = self._scalars(phis, before, inside)

        def number(name: int) -> str:
            """A scalar as memory holds it."""
            truth = _is_truth(loop.program, name)
            return self.operation("number", [names[name]], ["truth"], inside) if truth else names[name]

        for place, base in ((loop.each, "%out"), (loop.last, "%end")):
            for i, name in enumerate(place):
                self.store(number(name), base, i, inside)
        nexts = [number(name) for name in loop.next_carry]
        return self._function(before, inside, phis, starts, nexts)

    def _scalars(self, phis: dict[int, str], before: list[str], inside: list[str]) -> list[str]:
        """LLVM's name of each scalar, computed before the loop where it is the same in every row."""
        places, still, program = self._places(), self._still(), self.loop.program
        names: list[str] = []
        for i, op in enumerate(program.operations):
            lines = before if still[i] else inside
            if op.name == "constant":
                names.append(self.constant(op.value))
            elif op.name in ("input", "truth_input"):
                value = phis[i] if i in phis else self.load(*places[i], lines)
                names.append(self.operation("truth", [value], ["number"], lines) if op.name == "truth_input" else value)
            else:
                kinds = ["truth" if _is_truth(program, a) else "number" for a in op.arguments]
                names.append(self.operation(op.name, [names[a] for a in op.arguments], kinds, lines))
        return names

    def _places(self) -> dict[int, tuple[str, int]]:
        fixed = {name: ("%fixed", i) for i, name in enumerate(self.loop.fixed)}
        return fixed | {name: ("%here", i) for i, name in enumerate(self.loop.row)}

    def _still(self) -> list[bool]:
        """Whether each scalar is the same in every row."""
        moving = set(self.loop.carry) | set(self.loop.row)
        still: list[bool] = []
        for i, op in enumerate(self.loop.program.operations):
            still.append(i not in moving and all(still[a] for a in op.arguments))
        return still

    def _function(self, before, inside, phis, starts, nexts) -> str:
        loop = self.loop
        step = "mul i64 %k, {}\n  {} = getelementptr inbounds double, ptr {}, i64 {}"
        head = [f"{phi} = phi {self.number} [{starts[name]}, %entry], [{after}, %loop]"
                for (name, phi), after in zip(phis.items(), nexts, strict=True)]  # fmt: skip
        here = [
            f"%at = {step.format(len(loop.row) * self.lanes, '%here', '%rows', '%at')}",
            f"%to = {step.format(len(loop.each) * self.lanes, '%out', '%each', '%to')}",
        ]
        tail = ["%k1 = add i64 %k, 1", "%more = icmp slt i64 %k1, %T", "br i1 %more, label %loop, label %exit"]
        last: list[str] = []
        for i, value in enumerate(nexts):
            self.store(value, "%carry", i, last)
        body = ["%k = phi i64 [0, %entry], [%k1, %loop]", *head, *here, *inside, *tail]
        return "\n".join(
            [
                *sorted(self.declared),
                "define void @run(i64 %T, ptr noalias %fixed, ptr noalias %carry, ptr noalias %rows, ptr noalias %each, "
                "ptr noalias %end) {",
                "entry:", *(f"  {line}" for line in before), "  br label %loop",
                "loop:", *(f"  {line}" for line in body),
                "exit:", *(f"  {line}" for line in last), "  ret void", "}", "",
            ]
        )  # fmt: skip


def _is_truth(program: Program, name: int) -> bool:
    op = program.operations[name]
    if op.name == "select":
        return _is_truth(program, op.arguments[1])
    return op.name in TRUTHS or op.name == "truth_input" or (op.name == "constant" and isinstance(op.value, bool))


def _hexadecimal(value: float) -> str:
    return f"0x{struct.unpack('<Q', struct.pack('<d', value))[0]:016X}"


class Compiled:
    """A loop in machine code; calling it releases Python's lock."""

    def __init__(self, loop: Loop, lanes: int = 1):
        _processor()  # without LLVM there is nothing to write for
        self.lanes, self.loop = lanes, loop
        self._engine = _engine(_Text(loop, lanes).write())
        kind = ctypes.CFUNCTYPE(None, ctypes.c_int64, *[ctypes.c_void_p] * 5)
        self.address = kind(self._engine.get_function_address("run"))

    def __call__(self, rows: int, fixed, carry, row, each, last) -> None:
        """Run `rows` rows; the arrays are contiguous float64 and `carry`, `each`, `last` are written."""
        self.address(rows, *(array.ctypes.data for array in (fixed, carry, row, each, last)))


@cache
def _processor() -> tuple[str, str]:
    """Name and features of this processor, with LLVM made ready for it."""
    try:
        import llvmlite.binding as llvm
    except (ImportError, OSError) as reason:
        raise UnsupportedError("llvmlite cannot be imported") from reason

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()


def _machine() -> Any:
    """A target machine; an engine takes over the one that it is given."""
    import llvmlite.binding as llvm

    name, features = _processor()
    return llvm.Target.from_default_triple().create_target_machine(cpu=name, features=features, opt=3, jit=True)


def _engine(text: str) -> Any:
    """The compiled module, from the disk where it was compiled before."""
    import llvmlite
    import llvmlite.binding as llvm

    words = "|".join((text, llvmlite.__version__, *_processor()))
    path = _cache_folder() / f"{hashlib.sha256(words.encode()).hexdigest()}.o"
    kept = _kept(path)
    module = llvm.parse_assembly(text)
    if kept is None:
        options = llvm.create_pipeline_tuning_options(speed_level=3)
        options.slp_vectorization = True
        builder = llvm.create_pass_builder(_machine(), options)
        builder.getModulePassManager().run(module, builder)
    engine = llvm.create_mcjit_compiler(module, _machine())
    engine.set_object_cache(lambda _, compiled: _keep(path, compiled), lambda _: kept)
    engine.finalize_object()
    return engine


def _cache_folder() -> Path:
    """Where objects are kept: ESTIMABLE_CACHE, or the user's cache."""
    given = os.environ.get("ESTIMABLE_CACHE")
    return Path(given or os.path.join(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"), "estimable"))


def _kept(path: Path) -> bytes | None:
    """An object that is there and whole; a damaged one would take the process with it."""
    try:
        found = path.read_bytes()
    except OSError:
        return None
    return found[32:] if hashlib.sha256(found[32:]).digest() == found[:32] else None


def _keep(path: Path, compiled: bytes) -> None:
    """Write an object whole or not at all; a folder that cannot be written is no error."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        draft = path.with_suffix(f".{os.getpid()}")
        draft.write_bytes(hashlib.sha256(compiled).digest() + compiled)
        draft.replace(path)
    except OSError:
        return
