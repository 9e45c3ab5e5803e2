"""Large products and factorisations in machine code: calls of SciPy's BLAS and LAPACK."""

import ctypes
from functools import cache

from .blocks import Blocks, Memory, Value, number

PREFIX = "estimable_"  # of their names in machine code
ROUTINES = {"dgemm": "cython_blas", "dsyrk": "cython_blas", "dgeqrf": "cython_lapack", "dpotrf": "cython_lapack"}


@cache
def provide() -> None:
    """Register the addresses of the routines with LLVM."""
    from importlib import import_module

    import llvmlite.binding as llvm

    pointer = ctypes.pythonapi.PyCapsule_GetPointer
    pointer.restype, pointer.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    name = ctypes.pythonapi.PyCapsule_GetName
    name.restype, name.argtypes = ctypes.c_char_p, [ctypes.py_object]
    for routine, module in ROUTINES.items():
        capsule = import_module(f"scipy.linalg.{module}").__pyx_capi__[routine]
        llvm.add_symbol(f"{PREFIX}{routine}", pointer(capsule, name(capsule)))


def _call(blocks: Blocks, routine: str, arguments: list[str]) -> None:
    """Call a routine; its arguments are passed by address, as in Fortran."""
    provide()
    blocks.scalars.declared.add(f"declare void @{PREFIX}{routine}({', '.join(['ptr'] * len(arguments))})")
    blocks.lines.append(f"call void @{PREFIX}{routine}({', '.join(f'ptr {a}' for a in arguments)})")


def _given(blocks: Blocks, kind: str, value: str | float) -> str:
    """The address of a known argument."""
    if isinstance(value, str):
        return blocks.argument(f"i8 {ord(value)}")
    return blocks.argument(f"{kind} {value if kind == 'i32' else number(kind, value)}")


def _matrix(blocks: Blocks, value: Value) -> tuple[Value, bool, int]:
    """A matrix for a library: in memory, whether its columns are contiguous, and the distance between them (or rows)."""
    for _ in range(2):
        if value.memory is not None:
            rows, columns = value.memory.strides
            if columns == 1 and rows >= value.shape[1]:
                return value, False, rows
            if rows == 1 and columns >= value.shape[0]:
                return value, True, columns
        value = blocks.kept(value)
    raise AssertionError("unreachable")


def large_product(blocks: Blocks, a: Value, b: Value) -> Value:
    """a b' for b with the summed axis last."""
    (m, k), n = a.shape, b.shape[0]
    a, turned_a, step_a = _matrix(blocks, a)
    b, turned_b, step_b = _matrix(blocks, b)
    memory = blocks.region((m, n), "double")
    whole = [_given(blocks, "i32", x) for x in (n, m, k, step_b, step_a, n)]
    one, zero = _given(blocks, "double", 1.0), _given(blocks, "double", 0.0)
    begin = [blocks.place(v.lies, "double", ["0", "0"]) for v in (a, b)]
    # Fortran reads row after row as the transpose: (a b')' = b a'
    ways = _given(blocks, "i8", "N" if turned_b else "T"), _given(blocks, "i8", "T" if turned_a else "N")
    _call(
        blocks,
        "dgemm",
        [*ways, *whole[:3], one, begin[1], whole[3], begin[0], whole[4], zero, memory.pointer, whole[5]],
    )
    return blocks.lying(memory, (m, n), "double")


def large_gram(blocks: Blocks, a: Value) -> Value:
    """a a': one triangle is computed and mirrored."""
    n, k = a.shape
    a, turned, step = _matrix(blocks, a)
    memory = blocks.region((n, n), "double")
    one, zero = _given(blocks, "double", 1.0), _given(blocks, "double", 0.0)
    whole = [_given(blocks, "i32", x) for x in (n, k, step, n)]
    ways = (
        _given(blocks, "i8", "U"),
        _given(blocks, "i8", "N" if turned else "T"),
    )  # Fortran's upper triangle is the lower one of rows
    begin = blocks.place(a.lies, "double", ["0", "0"])
    _call(blocks, "dsyrk", [*ways, *whole[:2], one, begin, whole[2], zero, memory.pointer, whole[3]])

    def at(index: list[str]) -> str:
        below = blocks.assign(f"icmp uge i64 {index[0]}, {index[1]}")
        one, two = (blocks.load(memory, "double", place) for place in (index, index[::-1]))
        return blocks.assign(f"select i1 {below}, double {one}, double {two}")

    return blocks.kept(Value((n, n), "double", at))


def cholesky(blocks: Blocks, P: Value) -> Value:
    """The lower triangular L with L L' = P, and the upper part of P; NaN where P is not positive definite."""
    n = P.shape[0]
    memory, info = blocks.region((n, n), "double"), blocks.region((1,), "i64")
    blocks.fill(memory, P)
    blocks.store(info, "i64", ["0"], "0")
    size = _given(blocks, "i32", n)
    _call(blocks, "dpotrf", [_given(blocks, "i8", "U"), size, memory.pointer, size, info.pointer])
    failed, label = blocks.assign(f"icmp ne i64 {blocks.load(info, 'i64', ['0'])}, 0"), blocks.label()
    blocks.lines.append(f"br i1 {failed}, label %{label}.yes, label %{label}.end")
    blocks.begin(f"{label}.yes")
    nan = number("double", float("nan"))
    blocks.every((n, n), lambda index: blocks.store(memory, "double", index, nan))
    blocks.lines.append(f"br label %{label}.end")
    blocks.begin(f"{label}.end")
    return blocks.lying(memory, (n, n), "double")


def triangle(blocks: Blocks, a: Value) -> Value:
    """The upper triangular R of a = Q R, with at least as many rows as columns."""
    k, n = a.shape
    turned = blocks.region((n, k), "double")
    blocks.fill(turned, Value((n, k), "double", lambda index: a.at([index[1], index[0]]), _turned(a.memory)))
    taus, work = blocks.region((n,), "double"), blocks.region((64 * n,), "double")
    info = blocks.region((1,), "double")
    whole = [_given(blocks, "i32", x) for x in (k, n, k, 64 * n)]
    _call(
        blocks,
        "dgeqrf",
        [whole[0], whole[1], turned.pointer, whole[2], taus.pointer, work.pointer, whole[3], info.pointer],
    )

    def at(index: list[str]):
        inside = blocks.assign(f"icmp ule i64 {index[0]}, {index[1]}")
        entry = blocks.load(turned, "double", [index[1], index[0]])
        return blocks.assign(f"select i1 {inside}, double {entry}, double {number('double', 0)}")

    return Value((n, n), "double", at)


def _turned(memory: Memory | None) -> Memory | None:
    return None if memory is None else memory._replace(strides=memory.strides[::-1])
