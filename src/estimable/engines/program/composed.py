"""What JAX does entry by entry, as rows of the table of primitives: for names of scalars, for known values, for lines of LLVM.

`do.each(name, ..)` is a row applied, `do.constant(value)` a known scalar: so each primitive is composed here once.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import jax
import numpy as np

from .primitives import BOOL, FLOAT, INTEGER, NAMES, NARROW, PYTHON, UnsupportedError, folded, row, type_of


class Entries(Protocol):
    """What entries are made of."""

    def each(self, name: str, *operands: Any) -> Any:
        """A row of the table applied to entries."""
        ...

    def constant(self, value: Any) -> Any:
        """An entry with a known value."""
        ...


class Entrywise(NamedTuple):
    """An equation of entries: the parameters of the primitive, and the dtypes that it takes and gives."""

    parameters: dict
    given: tuple[np.dtype, ...]
    result: np.dtype

    @classmethod
    def of(cls, equation: Any) -> "Entrywise":
        """That of an equation of a jaxpr."""
        return cls(equation.params, tuple([v.aval.dtype for v in equation.invars]), equation.outvars[0].aval.dtype)


def is_entrywise(name: str) -> bool:
    """Whether a primitive is one that works entry by entry."""
    return name in COMPOSED or name in NAMES


def composed(do: Entries, name: str, how: Entrywise, *operands: Any) -> Any:
    """A primitive applied to entries. Raises `UnsupportedError` where the table has no rows for it."""
    result = COMPOSED[name](do, how, *operands) if name in COMPOSED else do.each(name, *operands)
    return do.each(NARROW[how.result], result) if how.result in NARROW else result


class Values:
    """Known values. Raises `UnsupportedError` where an operation on them is left to the machine."""

    def each(self, name: str, *values: Any) -> Any:
        """A row of the table, folded."""
        found = folded(row(name, tuple(type_of_value(value) for value in values)), list(values))
        if found is None:
            raise UnsupportedError(f"{name} of {values} is not folded")
        return found

    def constant(self, value: Any) -> Any:
        """The value itself."""
        return value


def type_of_value(value: Any) -> str:
    """The type of a scalar in Python."""
    return BOOL if isinstance(value, bool) else INTEGER if isinstance(value, int) else FLOAT


def _power(do: Entries, how: Entrywise, base: Any) -> Any:
    """By squaring, as JAX does it."""
    exponent, one = how.parameters["y"], PYTHON[type_of(how.result)](1)
    power, left = None, abs(exponent)
    while left:
        if left % 2:
            power = base if power is None else do.each("mul", power, base)
        left //= 2
        base = do.each("mul", base, base) if left else base
    power = do.constant(one) if power is None else power
    return power if exponent >= 0 else do.each("div", do.constant(one), power)


def _clamped(do: Entries, how: Entrywise, least: Any, x: Any, most: Any) -> Any:
    return do.each("min", do.each("max", least, x), most)


def _chosen(do: Entries, how: Entrywise, which: Any, *cases: Any) -> Any:
    """The first case for false or 0, the second for true or 1, .., the last for more."""
    if type_of(how.given[0]) == BOOL:
        return do.each("select", which, cases[1], cases[0]) if len(cases) == 2 else cases[0]
    chosen = cases[-1]
    for i, case in reversed(list(enumerate(cases[:-1]))):
        chosen = do.each("select", do.each("le", which, do.constant(i)), case, chosen)
    return chosen


def _converted(do: Entries, how: Entrywise, x: Any) -> Any:
    """Integers of fewer bits saturate where they come from a float, and wrap where they come from an integer."""
    old, new = type_of(how.given[0]), type_of(how.result)
    if old == new:
        return x
    if old != FLOAT or how.result not in NARROW:
        return do.each(f"to_{new}", x)
    limits = np.iinfo(how.result)
    return _clamped(do, how, do.constant(int(limits.min)), do.each("to_integer", x), do.constant(int(limits.max)))


def _rounded(do: Entries, how: Entrywise, x: Any) -> Any:
    even = how.parameters["rounding_method"] == jax.lax.RoundingMethod.TO_NEAREST_EVEN
    return do.each("round" if even else "round_away", x)


def _raised(do: Entries, how: Entrywise, base: Any, exponent: Any) -> Any:
    return do.each("pow", base, exponent if type_of(how.given[1]) == FLOAT else do.each("to_float", exponent))


def _as(do: Entries, kind: str, dtype: np.dtype, x: Any) -> Any:
    """The integer with the same bits, of the same width, with a sign (kind "i") or without one ("u")."""
    name = NARROW.get(np.dtype(f"{kind}{dtype.itemsize}"))
    return do.each(name, x) if name else x


def _shifted_right(do: Entries, how: Entrywise, x: Any, by: Any) -> Any:
    """The sign is that of the highest bit, also of an unsigned integer."""
    return do.each("shift_right_arithmetic", _as(do, "i", how.result, x), by)


def _shifted_right_logically(do: Entries, how: Entrywise, x: Any, by: Any) -> Any:
    return do.each("shift_right_logical", _as(do, "u", how.result, x), by)


def _counted(do: Entries, how: Entrywise, x: Any) -> Any:
    return do.each("population_count", _as(do, "u", how.result, x))


def _reread(do: Entries, how: Entrywise, x: Any) -> Any:
    old, new = how.given[0], how.result
    if {old, new} != {np.dtype(float), np.dtype(int)}:
        raise UnsupportedError(f"the bits of {old} as {new}")
    return do.each("bits" if type_of(old) == FLOAT else "from_bits", x)


def _logistic(do: Entries, how: Entrywise, x: Any) -> Any:
    one = do.constant(1.0)
    return do.each("div", one, do.each("add", one, do.each("exp", do.each("neg", x))))


COMPOSED: dict[str, Callable[..., Any]] = {
    "square": lambda do, how, x: do.each("mul", x, x),
    "rsqrt": lambda do, how, x: do.each("div", do.constant(1.0), do.each("sqrt", x)),
    "integer_pow": _power, "logistic": _logistic, "clamp": _clamped, "select_n": _chosen, "convert_element_type": _converted,
    "round": _rounded, "pow": _raised, "shift_right_arithmetic": _shifted_right,
    "shift_right_logical": _shifted_right_logically, "population_count": _counted, "bitcast_convert_type": _reread,
}  # fmt: skip
