"""Loops in machine code, cached on disk under a name from the program, the versions and the processor."""

import ctypes
import hashlib
import pickle
from collections.abc import Callable
from functools import cache
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import disk_cache
from ..program.primitives import UnsupportedError
from . import libraries
from .scalar_loop import ScalarLoop

if TYPE_CHECKING:
    from .array_loop import ArrayLoop


WORD = 8  # bytes
LONG = 1_000_000  # characters of a module, above which LLVM's passes take minutes


class Compiled:
    """A loop in machine code; calling it releases Python's lock."""

    def __init__(self, loop: "ScalarLoop | ArrayLoop", lanes: int = 1):
        _processor()  # fails without LLVM
        self.lanes, self.loop = lanes, loop
        self._engine = _engine(loop, f"lanes {lanes}", lambda: loop.assembly(lanes))
        kind = ctypes.CFUNCTYPE(None, *[ctypes.c_int64] * loop.integers, *[ctypes.c_void_p] * loop.pointers)
        self.address = kind(self._engine.get_function_address("run"))

    def __call__(self, rows: int, fixed: np.ndarray, carry: np.ndarray, last: np.ndarray, *arrays: np.ndarray) -> None:
        """Run `rows` rows over contiguous arrays, those of `loop.row` and then those of `loop.each`; `carry`, `last` and
        `loop.each` are written."""
        self.address(rows, *(array.ctypes.data for array in (fixed, carry, last, *arrays)))


class OneRow:
    """A loop without carry, for one row: a function of one address.

    That address holds the addresses of `fixed` and of the arrays read and written. The function holds Python's lock, so that
    all steps may share its memory, and returns word `last` of the last array, an integer.
    """

    def __init__(self, loop: "ScalarLoop | ArrayLoop", last: int):
        _processor()
        self._engine = _engine(loop, f"one row, {last}", lambda: self._assembly(loop, last))
        self.address = ctypes.PYFUNCTYPE(ctypes.c_int64, ctypes.c_void_p)(self._engine.get_function_address("one"))

    @staticmethod
    def _assembly(loop: "ScalarLoop | ArrayLoop", last: int) -> str:
        arrays, assembly, lines = loop.pointers - 2, loop.assembly(1), []
        for i in range(arrays):
            lines += [f"%at{i} = getelementptr inbounds ptr, ptr %places, i64 {i}", f"%array{i} = load ptr, ptr %at{i}"]
        pointers = ", ".join(
            f"ptr {name}" for name in ("%array0", "@memory", "null", *(f"%array{i}" for i in range(1, arrays)))
        )
        lines += [f"call void @run(i64 1, {pointers})",
                  f"%place = getelementptr inbounds double, ptr %array{arrays - 1}, i64 {last}",
                  "%code = load i64, ptr %place", "ret i64 %code"]  # fmt: skip
        memory = f"@memory = internal global [{loop.bytes} x i8] zeroinitializer, align 64\n"
        text = "\n  ".join(["define i64 @one(ptr %places) {", *lines]) + "\n}\n"
        return assembly + memory + text


@cache
def _processor() -> tuple[str, str]:
    """Name and features of this processor, with LLVM initialised for it."""
    try:
        import llvmlite.binding as llvm
    except (ImportError, OSError) as reason:
        raise UnsupportedError("llvmlite cannot be imported") from reason

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()


def _machine() -> Any:
    """A target machine; an engine takes ownership of it."""
    import llvmlite.binding as llvm

    name, features = _processor()
    return llvm.Target.from_default_triple().create_target_machine(cpu=name, features=features, opt=3, jit=True)


def _engine(loop: Any, kind: str, assembly: Callable[[], str]) -> Any:
    """The engine of a loop; its object code is from the disk if it was compiled before, and `assembly` is then not written."""
    import llvmlite
    import llvmlite.binding as llvm

    name = _name_of(loop)
    words = "|".join((disk_cache.source(), name or "", kind, llvmlite.__version__, *_processor()))
    found = disk_cache.read(words, "o") if name else None
    if found is None:
        module = _optimised(assembly(), loop.has_loops)
        memory = int(loop.bytes).to_bytes(WORD, "little")
    else:
        module, memory = llvm.parse_assembly(""), found[:WORD]
        if loop.has_loops:
            loop.bytes = int.from_bytes(memory, "little")
        if libraries.PREFIX.encode() in found:
            libraries.provide()
    engine = llvm.create_mcjit_compiler(module, _machine())
    if name:
        engine.set_object_cache(
            lambda _, code: disk_cache.write(words, "o", memory + code), lambda _: found and found[WORD:]
        )
    engine.finalize_object()
    return engine


def _name_of(loop: "ScalarLoop | ArrayLoop") -> str | None:
    """The digest of everything in a loop: as pickled, but without references, so that equal loops have equal names.

    None where it holds something that cannot be pickled; its code is compiled again in each process.
    """
    stream = BytesIO()
    pickler = pickle.Pickler(stream)
    pickler.fast = True
    try:
        pickler.dump(loop)
    except (pickle.PicklingError, AttributeError, TypeError, ValueError):
        return None
    return hashlib.sha256(stream.getvalue()).hexdigest()


def _optimised(text: str, has_loops: bool) -> Any:
    """A module, ready for the compiler.

    LLVM's passes are for loops over arrays. A line of scalars computes nothing twice, so that they would only take half of the
    time.
    """
    import llvmlite.binding as llvm

    module = llvm.parse_assembly(text)
    module.verify()
    if has_loops and len(text) < LONG:
        options = llvm.create_pipeline_tuning_options(speed_level=1)
        options.slp_vectorization = False
        builder = llvm.create_pass_builder(_machine(), options)
        builder.getModulePassManager().run(module, builder)
    return module
