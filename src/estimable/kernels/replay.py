"""A traced function on numbers of any precision: its jaxpr, replayed on arrays of Python numbers. Outside jit.

`numbers` is a context of mpmath, `mp` (many digits) or `fp` (floats): it has exp, sin, .. and mpf. What only moves entries about
is replayed on their indices by JAX itself.
"""

import operator
from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

import jax
import numpy as np
from jax.extend.core import Jaxpr, JaxprEqn, Literal, Var

Real = np.ndarray
UNARY = {
    "exp": "exp", "log": "ln", "sin": "sin", "cos": "cos", "tan": "tan", "asin": "asin", "acos": "acos", "atan": "atan",
    "sinh": "sinh", "cosh": "cosh", "tanh": "tanh", "asinh": "asinh", "acosh": "acosh", "atanh": "atanh", "sqrt": "sqrt",
    "expm1": "expm1", "log1p": "log1p", "erf": "erf", "floor": "floor", "ceil": "ceil", "sign": "sign", "cbrt": "cbrt",
}  # fmt: skip
BINARY: dict[str, Callable[[Any, Any], Any]] = {
    "add": operator.add, "add_any": operator.add, "sub": operator.sub, "mul": operator.mul, "div": operator.truediv,
    "lt": operator.lt, "le": operator.le, "gt": operator.gt, "ge": operator.ge, "eq": operator.eq, "ne": operator.ne,
    "and": operator.and_, "or": operator.or_, "pow": operator.pow,
}  # fmt: skip
SAME = ("convert_element_type", "copy", "copy_p", "stop_gradient", "reduce_precision", "optimization_barrier")
MOVES = (
    "reshape", "broadcast_in_dim", "squeeze", "slice", "transpose", "rev", "concatenate", "expand_dims", "gather",
    "dynamic_slice", "split",
)  # fmt: skip


@runtime_checkable
class Precise(Protocol):
    """The members of a context of mpmath that are used by name."""

    mpf: Callable[..., Any]
    sqrt: Callable[[Any], Any]
    exp: Callable[[Any], Any]
    atan2: Callable[[Any, Any], Any]


class NoReplayError(Exception):
    """A primitive that cannot be replayed; its name."""


class Replay:
    """A function of arrays, replayed; `branches` collects the choices that it made, in order."""

    def __init__(self, function: Callable[..., Any], shapes: list[tuple[int, ...]], numbers: Precise):
        self.numbers, self.branches = numbers, []
        self.places: dict[Any, list[Real]] = {}
        with jax.ensure_compile_time_eval():
            self.closed: Any = jax.make_jaxpr(function)(*(jax.ShapeDtypeStruct(shape, np.float64) for shape in shapes))

    def __call__(self, *arguments: Real) -> list[Real]:
        """The results, flattened, as object arrays."""
        self.branches = []
        return self._run(self.closed.jaxpr, self.closed.consts, list(arguments))

    def _run(self, jaxpr: Jaxpr, constants: list[Any], arguments: list[Any]) -> list[Any]:
        known: dict[Any, Any] = {}

        def read(atom: Literal | Var) -> Any:
            return self._number(atom.val) if isinstance(atom, Literal) else known[atom]

        known |= dict(zip(jaxpr.constvars, map(self._number, constants), strict=True))
        known |= dict(zip(jaxpr.invars, arguments, strict=True))
        for equation in jaxpr.eqns:
            found = self._step(equation, [read(atom) for atom in equation.invars])
            for variable, value in zip(equation.outvars, found, strict=True):
                known[variable] = value if isinstance(value, np.ndarray) else np.asarray(value, object)
        return [read(atom) for atom in jaxpr.outvars]

    def _number(self, value: np.ndarray | jax.Array | float) -> Real:
        """An array of numbers of the context; integers and bools stay what they are."""
        array = np.asarray(value)
        if array.dtype.kind != "f":
            return array
        return np.array([self.numbers.mpf(float(x)) for x in array.ravel()], object).reshape(array.shape)

    def _step(self, equation: JaxprEqn, x: list[Any]) -> list[Any]:
        name, given = equation.primitive.name, equation.params
        inner = given.get("jaxpr", given.get("call_jaxpr"))
        if inner is not None and name not in ("scan", "while", "cond"):
            return self._run(getattr(inner, "jaxpr", inner), list(getattr(inner, "consts", [])), x)
        if name in MOVES:
            return self._moved(equation, x)
        if name in BINARY or name in ("max", "min", "atan2"):
            return [self._both(name, *x)]
        if name in SAME:
            return [self._number(x[0].astype(float)) if x[0].dtype != object and _is_float(equation) else x[0]]
        return [self._other(name, x, given)]

    def _moved(self, equation: JaxprEqn, x: list[Any]) -> list[Any]:
        """Entries that only change places: by the primitive on their indices, once for each place in the program."""
        key = (id(equation), *(one.tobytes() for one in x if one.dtype != object))
        if key not in self.places:
            self.places[key] = _places(equation, x)
        data = [one.ravel() for one in x if one.dtype == object]
        if not data:
            return self.places[key]
        flat = np.concatenate(data)
        return [flat[place] for place in self.places[key]]

    def _both(self, name: str, a: Real, b: Real) -> Real:
        if name in ("max", "min"):
            first = np.asarray(a >= b if name == "max" else a <= b, bool)
            self.branches.append(first.tolist())
            return np.where(first, a, b)
        function = self.numbers.atan2 if name == "atan2" else BINARY[name]
        result = np.frompyfunc(function, 2, 1)(a, b)
        return np.asarray(result, bool if name in ("lt", "le", "gt", "ge", "eq", "ne", "and", "or") else object)

    def _other(self, name: str, x: list[Any], given: dict[str, Any]) -> Any:
        if name in UNARY:
            if name in ("floor", "ceil", "sign"):
                self.branches.append(np.asarray(x[0] > 0, bool).tolist())
            return each(getattr(self.numbers, UNARY[name]), x[0])
        if name in ("abs", "select_n"):
            choice = np.asarray(x[0] < 0 if name == "abs" else x[0], bool)
            self.branches.append(choice.tolist())
            return np.where(choice, -x[0], x[0]) if name == "abs" else np.where(choice, x[2], x[1])
        if name not in OTHERS:
            raise NoReplayError(name)
        return OTHERS[name](self.numbers, x, given)


def each(function: Callable[[Any], Any], x: Real) -> Real:
    """A function of one number, entry by entry."""
    return np.asarray(np.frompyfunc(function, 1, 1)(x), object)


OTHERS: dict[str, Callable[[Any, list[Any], dict[str, Any]], Any]] = {
    "neg": lambda numbers, x, given: -x[0],
    "integer_pow": lambda numbers, x, given: x[0] ** given["y"],
    "square": lambda numbers, x, given: x[0] * x[0],
    "rsqrt": lambda numbers, x, given: each(lambda v: 1 / numbers.sqrt(v), x[0]),
    "logistic": lambda numbers, x, given: each(lambda v: 1 / (1 + numbers.exp(-v)), x[0]),
    "not": lambda numbers, x, given: ~x[0],
    "is_finite": lambda numbers, x, given: np.ones(x[0].shape, bool),
    "reduce_sum": lambda numbers, x, given: np.sum(x[0], axis=tuple(given["axes"])),
    "reduce_prod": lambda numbers, x, given: np.prod(x[0], axis=tuple(given["axes"])),
    "dot_general": lambda numbers, x, given: _product(x[0], x[1], given["dimension_numbers"]),
    "iota": lambda numbers, x, given: np.asarray(jax.lax.iota(given["dtype"], given["shape"][0])),
}


def _places(equation: JaxprEqn, x: list[Any]) -> list[Any]:
    """Where the entries of the results come from, among those of the operands that are numbers, side by side."""
    start, operands = 0, []
    for one in x:
        if one.dtype == object:
            operands.append(np.arange(one.size).reshape(one.shape) + start)
            start += one.size
        else:
            operands.append(one)
    result = equation.primitive.bind(*operands, **equation.params)
    return [np.asarray(one) for one in (result if equation.primitive.multiple_results else [result])]


def _is_float(equation: JaxprEqn) -> bool:
    aval: Any = equation.outvars[0].aval
    return aval.dtype.kind == "f"


def _product(a: Real, b: Real, dimensions: tuple[Any, Any]) -> Real:
    """`dot_general` of object arrays."""
    (left, right), (batch_a, batch_b) = dimensions
    if not batch_a:
        return np.asarray(np.tensordot(a, b, axes=(list(left), list(right))), object)
    a, b = np.moveaxis(a, batch_a, range(len(batch_a))), np.moveaxis(b, batch_b, range(len(batch_b)))
    k = len(batch_a)
    axes = ([i - k for i in left], [i - k for i in right])
    shape = a.shape[:k]
    found = [np.tensordot(a[i], b[i], axes=axes) for i in np.ndindex(shape)]
    return np.asarray(found, object).reshape(*shape, *np.shape(found[0]))
