"""One table of primitives: name, arguments and result of an operation on scalars, in Python, LLVM, JAX and C.

A scalar is a float (float64), an integer (64 bits, which wraps) or a bool. An integer of fewer bits is held in 64, and one of
the rows `int8` to `uint32` follows each operation that may leave its range. XLA is the reference:

- NaN propagates, comparisons with it are false (`ne`: true), and a zero keeps its sign, unless a row says otherwise.
- The order of zeros: max(-0, 0) = 0 and min(0, -0) = -0.
- XLA flushes subnormal floats to zero; machine code keeps them.
- An exact or correctly rounded operation gives XLA's bits. For the others `ulps` is the error of XLA's own result in units
  of the last place: Python, LLVM and C call the C library, which is within a few.

An operation without a row raises an error: another engine runs the step.
"""

import math
import operator
import struct
from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from jax import lax

from ...annotations import Array

FLOAT, INTEGER, BOOL = "float", "integer", "bool"
LEAST, MOST = -(2**63), 2**63 - 1
NARROW = {np.dtype(name): name for name in ("int8", "int16", "int32", "uint8", "uint16", "uint32")}  # of fewer bits
TYPES = {np.dtype(float): FLOAT, np.dtype("int64"): INTEGER, np.dtype(bool): BOOL, **dict.fromkeys(NARROW, INTEGER)}
PYTHON = {FLOAT: float, INTEGER: int, BOOL: bool}
Scalar: TypeAlias = float | int | bool
LETTERS = {"f": FLOAT, "i": INTEGER, "b": BOOL}


class UnsupportedError(Exception):
    """A part of the step has no program; another engine must run it."""


class Primitive(NamedTuple):
    """A row of the table.

    `fold`: the result for known arguments; where it raises, or gives an infinity, a NaN or another type, nothing is folded.
    `llvm`: lines of assembly; the last is the result; {a}, {b}, {c} are the arguments, {0}, {1}, .. the preceding lines,
    {f}, {i}, {p} the types float, integer and bool (one, or a vector of them), {f:0.5} a constant of that type, and {sf}, {si}
    their names in intrinsics. `c`: an expression of C99. `rule`: what is special about NaN, infinities, zeros and limits.
    """

    name: str
    arguments: tuple[str, ...]
    result: str
    fold: Callable[..., Any]
    llvm: tuple[str, ...]
    jax: Callable[..., Any]
    c: str
    rule: str = ""
    ulps: int = 0


def row(name: str, types: tuple[str, ...]) -> Primitive:
    """The row of a primitive for arguments of these types. Raises `UnsupportedError` where there is none."""
    found = PRIMITIVES.get((name, types))
    if found is None:
        raise UnsupportedError(
            f"the primitive {name}{' of ' + ' and '.join(types) if name in NAMES else ''} is not supported"
        )
    return found


def folded(found: Primitive, values: list) -> Any:
    """The result of a primitive for known arguments; None where that is left to the machine."""
    try:
        value = found.fold(*values)
    except (ArithmeticError, ValueError):
        return None
    if not isinstance(value, PYTHON[found.result]) or (found.result == FLOAT and not math.isfinite(value)):
        return None
    return value


def type_of(dtype: np.dtype) -> str:
    """The type of a scalar of an array. Raises `UnsupportedError` for float32, complex numbers and the like."""
    if dtype not in TYPES:
        raise UnsupportedError(f"numbers of the kind {dtype} are not supported")
    return TYPES[dtype]


def wrapped(value: int, bits: int = 64, signed: bool = True) -> int:
    """The integer wrapped to a number of bits."""
    value %= 1 << bits
    return value - (1 << bits) if signed and value >> (bits - 1) else value


def _wrapping(function: Callable[..., Any]) -> Callable[..., int]:
    return lambda *values: wrapped(function(*values))


def _quotient(a: int, b: int) -> int:
    return -1 if b == 0 else wrapped(abs(a) // abs(b) * (1 if (a < 0) == (b < 0) else -1))


def _remainder(a: int, b: int) -> int:
    return a if b == 0 else abs(a) % abs(b) * (-1 if a < 0 else 1)


def _larger(a: float, b: float) -> float:
    if a == b:
        return b if math.copysign(1.0, a) < 0 else a
    return a if a > b or a != a else b


def _sign(a: float) -> float:
    return a if a == 0 or a != a else math.copysign(1.0, a)


def _half_away(a: float) -> float:
    whole = float(np.trunc(a))
    return whole + math.copysign(1.0, a) if abs(a - whole) >= 0.5 else whole


def _saturated(a: float) -> int:
    return 0 if a != a else MOST if a >= 2.0**63 else LEAST if a < -(2.0**63) else int(a)


def _bits(a: float) -> int:
    return struct.unpack("<q", struct.pack("<d", a))[0]


def _from_bits(a: int) -> float:
    return struct.unpack("<d", struct.pack("<q", a))[0]


def _same(a: Any) -> Any:
    return a


def _to(dtype: str) -> Callable[[Any], Any]:
    return lambda a: lax.convert_element_type(a, np.dtype(dtype))


def _to_nearest(method: lax.RoundingMethod) -> Callable[[Any], Any]:
    return lambda a: lax.round(a, method)


def _magnitude(a: Array) -> Any:
    """abs: XLA replaces abs of a product x x by the product, although that may wrap."""
    return lax.max(a, lax.neg(a))


def _narrowed(dtype: str) -> Callable[[Any], Any]:
    return lambda a: lax.convert_element_type(lax.convert_element_type(a, np.dtype(dtype)), np.dtype("int64"))


def _intrinsic(name: str, type_: str = "f", arguments: int = 1) -> str:
    """A call of an LLVM intrinsic with arguments and result of one type."""
    given = ", ".join(f"{{{type_}}} {{{letter}}}" for letter in "abc"[:arguments])
    return f"call {{{type_}}} @llvm.{name}.{{s{type_}}}({given})"


def _library(name: str, jax: Callable, fold: Callable, ulps: int, llvm: str = "") -> tuple:
    """The row of a function of the C library; `llvm`: the intrinsic that calls it."""
    line = _intrinsic(llvm) if llvm else f"call {{f}} @{name}({{f}} {{a}})"
    return jax.__name__, "f:f", fold, line, jax, f"{name}({{a}})", "", ulps


def _comparisons(type_: str, instruction: str, conditions: tuple[str, ...]) -> list[tuple]:
    """The rows eq, ne, lt, le, gt, ge of a type."""
    llvm = {FLOAT: "{f}", INTEGER: "{i}", BOOL: "{p}"}[LETTERS[type_]]
    rows = zip(("eq", "ne", "lt", "le", "gt", "ge"), conditions, ("==", "!=", "<", "<=", ">", ">="), strict=True)
    return [
        (name, f"{type_ * 2}:b", getattr(operator, name), f"{instruction} {condition} {llvm} {{a}}, {{b}}",
         getattr(lax, name), f"({{a}} {sign} {{b}})", "")
        for name, condition, sign in rows
    ]  # fmt: skip


def _selections() -> list[tuple]:
    """The rows `select`: a bool, the value where it is true, and the value where it is false."""
    return [
        ("select", f"b{t}{t}:{t}", lambda p, a, b: a if p else b, f"select {{p}} {{a}}, {{{w}}} {{b}}, {{{w}}} {{c}}",
         lax.select, "({a} ? {b} : {c})", "")
        for t, w in (("f", "f"), ("i", "i"), ("b", "p"))
    ]  # fmt: skip


def _narrow(name: str) -> tuple:
    """The row that wraps an integer to fewer bits."""
    signed, bits = not name.startswith("u"), int(name.lstrip("uint"))
    left = f"shl {{i}} {{a}}, {{i:{64 - bits}}}"
    llvm = f"{left}; {'ashr' if signed else 'lshr'} {{i}} {{0}}, {{i:{64 - bits}}}"
    return (name, "i:i", lambda a: wrapped(a, bits, signed), llvm, _narrowed(name), f"((int64_t)({name}_t){{a}})",
            f"wraps to {bits} bits")  # fmt: skip


_SAFE = "icmp eq {i} {b}, {i:0}; icmp eq {i} {b}, {i:-1}; or {p} {0}, {1}; select {p} {2}, {i} {i:1}, {i} {b}; "
_INSIDE = "icmp ult {i} {b}, {i:64}; select {p} {0}, {i} {b}, {i} {i:0}; "
_SHIFTED = "; select {p} {0}, {i} {2}, {i} {i:0}"
_AWAY, _EVEN = lax.RoundingMethod.AWAY_FROM_ZERO, lax.RoundingMethod.TO_NEAREST_EVEN

_FLOATS = [
    ("add", "ff:f", operator.add, "fadd contract {f} {a}, {b}", lax.add, "({a} + {b})", "x + 0 is x, as in XLA: -0 + 0 is -0"),
    ("sub", "ff:f", operator.sub, "fsub contract {f} {a}, {b}", lax.sub, "({a} - {b})"),
    ("mul", "ff:f", operator.mul, "fmul contract {f} {a}, {b}", lax.mul, "({a} * {b})",
     "0 x is 0 for a zero that is a constant, whatever x is: a structural zero"),
    ("div", "ff:f", operator.truediv, "fdiv contract {f} {a}, {b}", lax.div, "({a} / {b})",
     "0 / x is 0 for a zero that is a constant: a structural zero"),
    ("rem", "ff:f", math.fmod, "frem {f} {a}, {b}", lax.rem, "fmod({a}, {b})", "of the dividend's sign; of x by 0: NaN"),
    ("max", "ff:f", _larger, _intrinsic("maximum", arguments=2), lax.max,
     "({a} != {a} || {a} > {b} || ({a} == {b} && !signbit({a})) ? {a} : {b})"),
    ("min", "ff:f", lambda a, b: -_larger(-a, -b), _intrinsic("minimum", arguments=2), lax.min,
     "({a} != {a} || {a} < {b} || ({a} == {b} && signbit({a})) ? {a} : {b})"),
    ("pow", "ff:f", math.pow, _intrinsic("pow", arguments=2), lax.pow, "pow({a}, {b})",
     "x^0 = 1^x = 1 with NaN too; of a negative base and a fraction: NaN", 2),
    ("atan2", "ff:f", math.atan2, _intrinsic("atan2", arguments=2), lax.atan2, "atan2({a}, {b})", "zeros by their sign", 2),
    ("neg", "f:f", operator.neg, "fneg {f} {a}", lax.neg, "(-{a})"),
    ("abs", "f:f", abs, _intrinsic("fabs"), lax.abs, "fabs({a})"),
    ("sign", "f:f", _sign, "fcmp ueq {f} {a}, {f:0.0}; call {f} @llvm.copysign.{sf}({f} {f:1.0}, {f} {a}); "
     "select {p} {0}, {f} {a}, {f} {1}", lax.sign, "({a} == 0 || {a} != {a} ? {a} : copysign(1.0, {a}))", "of -0: -0"),
    ("sqrt", "f:f", math.sqrt, _intrinsic("sqrt"), lax.sqrt, "sqrt({a})", "of -0: -0; below: NaN"),
    ("floor", "f:f", lambda a: float(np.floor(a)), _intrinsic("floor"), lax.floor, "floor({a})"),
    ("ceil", "f:f", lambda a: float(np.ceil(a)), _intrinsic("ceil"), lax.ceil, "ceil({a})"),
    ("round", "f:f", lambda a: float(np.rint(a)), _intrinsic("roundeven"), _to_nearest(_EVEN), "nearbyint({a})",
     "halves to even"),
    ("round_away", "f:f", _half_away, _intrinsic("round"), _to_nearest(_AWAY), "round({a})", "halves away from zero"),
    ("is_finite", "f:b", math.isfinite, f"{_intrinsic('fabs')}; fcmp olt {{f}} {{0}}, {{f:inf}}", lax.is_finite,
     "(isfinite({a}) != 0)"),
    ("to_integer", "f:i", _saturated, "call {i} @llvm.fptosi.sat.{si}.{sf}({f} {a})", _to("int64"),
     "({a} != {a} ? 0 : {a} >= 0x1p63 ? INT64_MAX : {a} < -0x1p63 ? INT64_MIN : (int64_t){a})",
     "towards zero; of NaN: 0; saturates"),
    ("to_bool", "f:b", bool, "fcmp une {f} {a}, {f:0.0}", _to("bool"), "({a} != 0)", "of NaN: true"),
    ("bits", "f:i", _bits, "bitcast {f} {a} to {i}", lambda a: lax.bitcast_convert_type(a, np.dtype("int64")),
     "((union {{ double f; int64_t i; }}){{ .f = {a} }}).i", "of NaN: those of any NaN"),
    *_comparisons("f", "fcmp", ("oeq", "une", "olt", "ole", "ogt", "oge")),
    _library("exp", lax.exp, math.exp, 2, "exp"), _library("exp2", lax.exp2, math.exp2, 512, "exp2"),
    _library("expm1", lax.expm1, math.expm1, 8), _library("log", lax.log, math.log, 2, "log"),
    _library("log1p", lax.log1p, math.log1p, 256), _library("cbrt", lax.cbrt, math.cbrt, 512),
    _library("sin", lax.sin, math.sin, 2, "sin"), _library("cos", lax.cos, math.cos, 2, "cos"),
    _library("tan", lax.tan, math.tan, 2, "tan"), _library("asin", lax.asin, math.asin, 4, "asin"),
    _library("acos", lax.acos, math.acos, 4, "acos"), _library("atan", lax.atan, math.atan, 2, "atan"),
    _library("sinh", lax.sinh, math.sinh, 512, "sinh"), _library("cosh", lax.cosh, math.cosh, 512, "cosh"),
    _library("tanh", lax.tanh, math.tanh, 16, "tanh"), _library("asinh", lax.asinh, math.asinh, 8),
    _library("acosh", lax.acosh, math.acosh, 8), _library("atanh", lax.atanh, math.atanh, 256),
    _library("erf", lax.erf, math.erf, 4), _library("erfc", lax.erfc, math.erfc, 512),
]  # fmt: skip

_INTEGERS = [
    ("add", "ii:i", _wrapping(operator.add), "add {i} {a}, {b}", lax.add, "((int64_t)((uint64_t){a} + (uint64_t){b}))", "wraps"),
    ("sub", "ii:i", _wrapping(operator.sub), "sub {i} {a}, {b}", lax.sub, "((int64_t)((uint64_t){a} - (uint64_t){b}))", "wraps"),
    ("mul", "ii:i", _wrapping(operator.mul), "mul {i} {a}, {b}", lax.mul, "((int64_t)((uint64_t){a} * (uint64_t){b}))", "wraps"),
    ("div", "ii:i", _quotient, _SAFE + "sdiv {i} {a}, {3}; sub {i} {i:0}, {a}; select {p} {1}, {i} {5}, {i} {4}; "
     "select {p} {0}, {i} {i:-1}, {i} {6}", lax.div,
     "({b} == 0 ? -1 : {b} == -1 ? (int64_t)(0 - (uint64_t){a}) : {a} / {b})", "towards zero; by 0: -1; wraps"),
    ("rem", "ii:i", _remainder, _SAFE + "srem {i} {a}, {3}; select {p} {0}, {i} {a}, {i} {4}", lax.rem,
     "({b} == 0 ? {a} : {b} == -1 ? 0 : {a} % {b})", "of the dividend's sign; by 0: the dividend"),
    ("max", "ii:i", max, _intrinsic("smax", "i", 2), lax.max, "({a} > {b} ? {a} : {b})"),
    ("min", "ii:i", min, _intrinsic("smin", "i", 2), lax.min, "({a} < {b} ? {a} : {b})"),
    ("neg", "i:i", _wrapping(operator.neg), "sub {i} {i:0}, {a}", lax.neg, "((int64_t)(0 - (uint64_t){a}))", "wraps"),
    ("abs", "i:i", _wrapping(abs), "icmp slt {i} {a}, {i:0}; sub {i} {i:0}, {a}; select {p} {0}, {i} {1}, {i} {a}", _magnitude,
     "({a} < 0 ? (int64_t)(0 - (uint64_t){a}) : {a})", "wraps"),
    ("sign", "i:i", lambda a: (a > 0) - (a < 0), f"{_intrinsic('smin', 'i', 2).replace('{b}', '{i:1}')}; "
     "call {i} @llvm.smax.{si}({i} {0}, {i} {i:-1})", lax.sign, "(int64_t)(({a} > 0) - ({a} < 0))"),
    ("and", "ii:i", operator.and_, "and {i} {a}, {b}", lax.bitwise_and, "({a} & {b})"),
    ("or", "ii:i", operator.or_, "or {i} {a}, {b}", lax.bitwise_or, "({a} | {b})"),
    ("xor", "ii:i", operator.xor, "xor {i} {a}, {b}", lax.bitwise_xor, "({a} ^ {b})"),
    ("not", "i:i", operator.invert, "xor {i} {a}, {i:-1}", lax.bitwise_not, "(~{a})"),
    ("shift_left", "ii:i", lambda a, b: wrapped(a << b) if 0 <= b < 64 else 0, f"{_INSIDE}shl {{i}} {{a}}, {{1}}{_SHIFTED}",
     lax.shift_left, "((uint64_t){b} < 64 ? (int64_t)((uint64_t){a} << {b}) : 0)", "by less than 0 or more than 63: 0"),
    ("shift_right_arithmetic", "ii:i", lambda a, b: a >> (b if 0 <= b < 64 else 63),
     "icmp ult {i} {b}, {i:64}; select {p} {0}, {i} {b}, {i} {i:63}; ashr {i} {a}, {1}", lax.shift_right_arithmetic,
     "({a} >> ((uint64_t){b} < 64 ? {b} : 63))", "by less than 0 or more than 63: 0, or -1 of a negative one"),
    ("shift_right_logical", "ii:i", lambda a, b: wrapped(a % 2**64 >> b) if 0 <= b < 64 else 0,
     f"{_INSIDE}lshr {{i}} {{a}}, {{1}}{_SHIFTED}", lax.shift_right_logical,
     "((uint64_t){b} < 64 ? (int64_t)((uint64_t){a} >> {b}) : 0)", "by less than 0 or more than 63: 0"),
    ("population_count", "i:i", lambda a: (a % 2**64).bit_count(), _intrinsic("ctpop", "i"), lax.population_count,
     "((int64_t)__builtin_popcountll((uint64_t){a}))", "in C: of GCC and Clang"),
    ("to_float", "i:f", float, "sitofp {i} {a} to {f}", _to("float64"), "((double){a})", "rounds to even above 2^53"),
    ("to_bool", "i:b", bool, "icmp ne {i} {a}, {i:0}", _to("bool"), "({a} != 0)"),
    ("from_bits", "i:f", _from_bits, "bitcast {i} {a} to {f}", lambda a: lax.bitcast_convert_type(a, np.dtype("float64")),
     "((union {{ double f; int64_t i; }}){{ .i = {a} }}).f"),
    *_comparisons("i", "icmp", ("eq", "ne", "slt", "sle", "sgt", "sge")),
    *(_narrow(name) for name in NARROW.values()),
]  # fmt: skip

_BOOLS = [
    ("and", "bb:b", lambda a, b: a and b, "and {p} {a}, {b}", lax.bitwise_and, "({a} && {b})"),
    ("or", "bb:b", lambda a, b: a or b, "or {p} {a}, {b}", lax.bitwise_or, "({a} || {b})"),
    ("xor", "bb:b", operator.ne, "xor {p} {a}, {b}", lax.bitwise_xor, "({a} != {b})"),
    ("not", "b:b", operator.not_, "xor {p} {a}, {p:true}", lax.bitwise_not, "(!{a})"),
    ("max", "bb:b", lambda a, b: a or b, "or {p} {a}, {b}", lax.max, "({a} || {b})"),
    ("min", "bb:b", lambda a, b: a and b, "and {p} {a}, {b}", lax.min, "({a} && {b})"),
    ("to_float", "b:f", float, "uitofp {p} {a} to {f}", _to("float64"), "({a} ? 1.0 : 0.0)"),
    ("to_integer", "b:i", int, "zext {p} {a} to {i}", _to("int64"), "((int64_t){a})"),
    ("settles", "b:b", _same, "and {p} {a}, {a}", _same, "({a})", "marks the choice of `kernels/small.settled`"),
    *_comparisons("b", "icmp", ("eq", "ne", "ult", "ule", "ugt", "uge")),
    *_selections(),
]  # fmt: skip


def _table() -> dict[tuple[str, tuple[str, ...]], Primitive]:
    rows = {}
    for name, signature, fold, llvm, jax, c, *rest in [*_FLOATS, *_INTEGERS, *_BOOLS]:
        *arguments, _, result = [LETTERS.get(letter, "") for letter in signature]
        found = Primitive(name, tuple(arguments), result, fold, tuple(llvm.split("; ")), jax, c, *rest)
        rows[name, found.arguments] = found
    return rows


PRIMITIVES = _table()
NAMES = {name for name, _ in PRIMITIVES}
