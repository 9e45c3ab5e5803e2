"""Elementwise operations of JAX as rows of the table of primitives: for names of scalars, known values, and lines of LLVM.

`do.each(name, ..)` applies a row, `do.constant(value)` is a known scalar: so each primitive is composed here once.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, TypeVar

import jax
import numpy as np

from .jaxprs import array_of
from .primitives import BOOL, FLOAT, INTEGER, NAMES, NARROW, PYTHON, Scalar, UnsupportedError, folded, row, type_of

if TYPE_CHECKING:  # importing it takes a tenth of a second, for Pallas
    from jax.extend.core import JaxprEqn

Entry = TypeVar("Entry")


class Entries(Protocol[Entry]):
    """The operations on entries."""

    def each(self, name: str, *operands: Entry) -> Entry:
        """A row of the table applied to entries."""
        ...

    def constant(self, value: Scalar) -> Entry:
        """An entry with a known value."""
        ...


class Entrywise(NamedTuple):
    """An elementwise equation: the parameters of the primitive, and the dtypes of its arguments and result."""

    parameters: dict
    given: tuple[np.dtype, ...]
    result: np.dtype

    @classmethod
    def of(cls, equation: JaxprEqn) -> Entrywise:
        """The record of an equation of a jaxpr."""
        return cls(
            equation.params, tuple([array_of(v).dtype for v in equation.invars]), array_of(equation.outvars[0]).dtype
        )


def is_entrywise(name: str) -> bool:
    """Whether a primitive is elementwise."""
    return name in COMPOSED or name in NAMES


def composed(do: Entries[Entry], name: str, how: Entrywise, *operands: Entry) -> Entry:
    """A primitive applied to entries. Raises `UnsupportedError` where the table has no row for it."""
    result = COMPOSED[name](do, how, *operands) if name in COMPOSED else do.each(name, *operands)
    return do.each(NARROW[how.result], result) if how.result in NARROW else result


class Values:
    """Operations on known values. Raises `UnsupportedError` where an operation is left to the machine."""

    def each(self, name: str, *values: Scalar) -> Scalar:
        """A row of the table, folded."""
        found = folded(row(name, tuple(type_of_value(value) for value in values)), list(values))
        if found is None:
            raise UnsupportedError(f"{name} of the constants {values} cannot be evaluated in advance")
        return found

    def constant(self, value: Scalar) -> Scalar:
        """The value itself."""
        return value


def type_of_value(value: Scalar) -> str:
    """The type of a scalar in Python."""
    return BOOL if isinstance(value, bool) else INTEGER if isinstance(value, int) else FLOAT


def _power(do: Entries[Entry], how: Entrywise, base: Entry) -> Entry:
    """Power by squaring, as in JAX."""
    exponent, one = how.parameters["y"], PYTHON[type_of(how.result)](1)
    power, left = None, abs(exponent)
    while left:
        if left % 2:
            power = base if power is None else do.each("mul", power, base)
        left //= 2
        base = do.each("mul", base, base) if left else base
    power = do.constant(one) if power is None else power
    return power if exponent >= 0 else do.each("div", do.constant(one), power)


def _clamped(do: Entries[Entry], how: Entrywise, least: Entry, x: Entry, most: Entry) -> Entry:
    return do.each("min", do.each("max", least, x), most)


def _chosen(do: Entries[Entry], how: Entrywise, which: Entry, *cases: Entry) -> Entry:
    """The first case for false or 0, the second for true or 1, .., the last for more."""
    if type_of(how.given[0]) == BOOL:
        return do.each("select", which, cases[1], cases[0]) if len(cases) == 2 else cases[0]
    chosen = cases[-1]
    for i, case in reversed(list(enumerate(cases[:-1]))):
        chosen = do.each("select", do.each("le", which, do.constant(i)), case, chosen)
    return chosen


def _converted(do: Entries[Entry], how: Entrywise, x: Entry) -> Entry:
    """Conversion: narrow integers saturate from a float, and wrap from an integer."""
    old, new = type_of(how.given[0]), type_of(how.result)
    if old == new:
        return x
    if old != FLOAT or how.result not in NARROW:
        return do.each(f"to_{new}", x)
    limits = np.iinfo(how.result)
    return _clamped(do, how, do.constant(int(limits.min)), do.each("to_integer", x), do.constant(int(limits.max)))


def _rounded(do: Entries[Entry], how: Entrywise, x: Entry) -> Entry:
    even = how.parameters["rounding_method"] == jax.lax.RoundingMethod.TO_NEAREST_EVEN
    return do.each("round" if even else "round_away", x)


def _raised(do: Entries[Entry], how: Entrywise, base: Entry, exponent: Entry) -> Entry:
    return do.each("pow", base, exponent if type_of(how.given[1]) == FLOAT else do.each("to_float", exponent))


def _as(do: Entries[Entry], kind: str, dtype: np.dtype, x: Entry) -> Entry:
    """The integer with the same bits and width, signed (kind "i") or unsigned ("u")."""
    name = NARROW.get(np.dtype(f"{kind}{dtype.itemsize}"))
    return do.each(name, x) if name else x


def _shifted_right(do: Entries[Entry], how: Entrywise, x: Entry, by: Entry) -> Entry:
    """Arithmetic shift: the highest bit is the sign, also of an unsigned integer."""
    return do.each("shift_right_arithmetic", _as(do, "i", how.result, x), by)


def _shifted_right_logically(do: Entries[Entry], how: Entrywise, x: Entry, by: Entry) -> Entry:
    return do.each("shift_right_logical", _as(do, "u", how.result, x), by)


def _counted(do: Entries[Entry], how: Entrywise, x: Entry) -> Entry:
    return do.each("population_count", _as(do, "u", how.result, x))


def _reread(do: Entries[Entry], how: Entrywise, x: Entry) -> Entry:
    old, new = how.given[0], how.result
    if {old, new} != {np.dtype(float), np.dtype(int)}:
        raise UnsupportedError(f"the bits of {old} as {new} are not supported")
    return do.each("bits" if type_of(old) == FLOAT else "from_bits", x)


def _logistic(do: Entries[Entry], how: Entrywise, x: Entry) -> Entry:
    one = do.constant(1.0)
    return do.each("div", one, do.each("add", one, do.each("exp", do.each("neg", x))))


COMPOSED: dict[str, Callable[..., Any]] = {
    "square": lambda do, how, x: do.each("mul", x, x),
    "rsqrt": lambda do, how, x: do.each("div", do.constant(1.0), do.each("sqrt", x)),
    "integer_pow": _power, "logistic": _logistic, "clamp": _clamped, "select_n": _chosen, "convert_element_type": _converted,
    "round": _rounded, "pow": _raised, "shift_right_arithmetic": _shifted_right,
    "shift_right_logical": _shifted_right_logically, "population_count": _counted, "bitcast_convert_type": _reread,
}  # fmt: skip
