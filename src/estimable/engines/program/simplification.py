"""Operations on partly known scalars that need not be computed."""

import math
from typing import Any

NEUTRAL: dict[str, tuple] = {"add": (0.0, 0), "mul": (1.0, 1), "and": (True, -1), "or": (False, 0), "xor": (False, 0)}
ABSORBING: dict[str, tuple] = {"mul": (0.0, 0), "and": (False, 0), "or": (True, -1)}
NEUTRAL_RIGHT: dict[str, tuple] = {"sub": (0.0, 0), "div": (1.0, 1)}
SIMPLER = {*NEUTRAL, *ABSORBING, *NEUTRAL_RIGHT}
PROPAGATING = {"add", "sub", "mul", "div"}  # NaN where one of two floats is NaN


def simplify(name: str, arguments: tuple[int, ...], values: list) -> int | tuple | None:
    """The scalar equal to an operation, or (constant,), or None. `values`: the constants among the arguments, else None.

    A product with a constant zero, and a quotient of one, is zero for any other factor: the zero is structural. The exception is
    a factor that is itself a constant NaN or infinity.
    """
    if name == "select":
        return _selected(arguments, values)
    if name not in SIMPLER or values[0] is values[1] is None:
        return None
    if not all(map(_is_finite, values)):
        return (math.nan,) if name in PROPAGATING and any(value != value for value in values) else None
    for known, other in ((values[0], arguments[1]), (values[1], arguments[0])):
        if known is not None and _is(known, NEUTRAL.get(name)):
            return other
        if known is not None and _is(known, ABSORBING.get(name)):
            return (known,)
    if name == "div" and _is(values[0], (0.0,)) and values[1] != 0:
        return (values[0],)
    return arguments[0] if _is(values[1], NEUTRAL_RIGHT.get(name)) else None


def _is(value: Any, constants: tuple | None) -> bool:
    """Whether a constant is one of these, of the same type."""
    return constants is not None and any(value == c and type(value) is type(c) for c in constants)


def _is_finite(value: Any) -> bool:
    return not isinstance(value, float) or math.isfinite(value)


def _selected(arguments: tuple[int, ...], values: list) -> int | None:
    if values[0] is None and arguments[1] != arguments[2]:
        return None
    return arguments[2] if values[0] is False else arguments[1]
