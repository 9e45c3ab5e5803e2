"""From the jaxpr of a step to a straight line of scalar operations.

Arrays become arrays of scalar names, so that whatever only moves entries about (slices, transposes, concatenations) costs
nothing and is evaluated on the names by JAX itself; this file names the arithmetic primitives only. Equal operations on
equal scalars are one (a symmetric matrix is computed once), constants are folded, and what no output needs is dropped.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

MOST = 10_000  # operations: above it compilation takes seconds, and arrays are as good


class UnsupportedError(Exception):
    """The step holds something that has no straight line; another engine must run it."""


class Operation(NamedTuple):
    """One scalar: the operation's name, the scalars it takes, and the value of a constant or the place of an input."""

    name: str
    arguments: tuple[int, ...] = ()
    value: Any = None


class Program(NamedTuple):
    """Scalars in order; `inputs` of each flat input array, `outputs` of each flat output array (index arrays)."""

    operations: tuple[Operation, ...]
    inputs: tuple[np.ndarray, ...]
    outputs: tuple[np.ndarray, ...]

    def is_truth(self, name: int) -> bool:
        """Whether a scalar is a truth and not a number."""
        op = self.operations[name]
        if op.name == "select":
            return self.is_truth(op.arguments[1])
        return op.name in TRUTHS or op.name == "truth_input" or (op.name == "constant" and isinstance(op.value, bool))


def _divide(a: float, b: float) -> float:
    return a / b if b else math.nan if a == 0 or math.isnan(a) else math.copysign(math.inf, a) * math.copysign(1, b)


TRANSCENDENTAL = ("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh")
SCALAR: dict[str, Callable] = {
    "add": lambda a, b: a + b, "sub": lambda a, b: a - b, "mul": lambda a, b: a * b, "div": _divide,
    "neg": lambda a: -a, "abs": abs, "sqrt": lambda a: math.sqrt(a) if a >= 0 else math.nan,
    "log": lambda a: math.log(a) if a > 0 else -math.inf if a == 0 else math.nan,
    "exp": lambda a: math.exp(min(a, 709.78)) if a < 709.78 else math.inf,
    "exp2": lambda a: 2.0**a, "pow": lambda a, b: a**b, "round": lambda a: float(np.round(a)), "floor": math.floor,
    "max": lambda a, b: a if a > b or a != a else b, "min": lambda a, b: a if a < b or a != a else b,
    "eq": lambda a, b: a == b, "ne": lambda a, b: a != b, "lt": lambda a, b: a < b, "le": lambda a, b: a <= b,
    "gt": lambda a, b: a > b, "ge": lambda a, b: a >= b,
    "and": lambda a, b: a and b, "or": lambda a, b: a or b, "xor": lambda a, b: a != b, "not": lambda a: not a,
    "select": lambda p, a, b: a if p else b, "is_finite": math.isfinite,
    **{name: getattr(math, name) for name in TRANSCENDENTAL},
    "number": float, "settles": lambda a: a, "truth": lambda a: a != 0, "truncate": lambda a: float(math.trunc(a)),
}  # fmt: skip
TRUTHS = {"eq", "ne", "lt", "le", "gt", "ge", "and", "or", "xor", "not", "is_finite", "truth", "settles"}
COMMUTE = {"add", "mul", "eq", "ne", "and", "or", "xor"}
HOISTED = {"div", "sqrt", "log"}  # slow, and without effect on what is not chosen
NAMED = {"add_any": "add"}
MOVES = {"expand_dims", "rev", "copy", "pad", "split", "copy_p", "stack"}  # besides those in BY_NUMPY
CALLS = {
    "jit",
    "pjit",
    "closed_call",
    "core_call",
    "custom_jvp_call",
    "custom_vjp_call",
    "checkpoint",
    "remat",
    "remat2",
    "custom_vmap_call",
}
FOLDS = {"reduce_sum": "add", "reduce_prod": "mul", "reduce_max": "max", "reduce_min": "min", "reduce_and": "and",
         "reduce_or": "or"}  # fmt: skip


def lower(function: Callable, *arguments: Any, known: dict[tuple[int, int], Any] | None = None) -> Program:
    """The straight line of `function` at arguments of these shapes: see `lower_jaxpr`."""
    return lower_jaxpr(jax.make_jaxpr(function)(*arguments), known)


def lower_jaxpr(closed: Any, known: dict[tuple[int, int], Any] | None = None, most: int = MOST) -> Program:
    """The straight line of what has been traced. Raises `UnsupportedError`.

    `known`: the values of input entries (array, entry) that are always the same, as the zeros of a triangular matrix.
    `most`: the operations that it may have.
    """
    line = _Line(known or {}, most)
    names = [line.inputs(i, v.aval) for i, v in enumerate(closed.jaxpr.invars)]
    outputs = line.run(closed.jaxpr, closed.consts, names)
    return line.program(names, outputs)


class _Line:
    """The operations so far, each one once."""

    def __init__(self, known: dict[tuple[int, int], Any], most: int):
        self.known, self.most = known, most
        self.operations: list[Operation] = []
        self.found: dict[tuple, int] = {}

    def add(self, operation: Operation) -> int:
        """The name of an operation, new or met before."""
        value = operation.value
        key = (operation.name, operation.arguments, repr(value), type(value))
        if key not in self.found:
            if len(self.operations) >= self.most:
                raise UnsupportedError(f"more than {self.most:,} operations")
            self.found[key] = len(self.operations)
            self.operations.append(operation)
        return self.found[key]

    def inputs(self, place: int, aval: Any) -> np.ndarray:
        """Names for the entries of an input array."""
        kind = "truth_input" if aval.dtype == bool else "input"
        places = [(place, i) for i in range(math.prod(aval.shape))]
        entries = [
            Operation("constant", (), self.known[p]) if p in self.known else Operation(kind, (), p) for p in places
        ]
        return np.array([self.add(entry) for entry in entries], int).reshape(aval.shape)

    def constants(self, values: Any) -> np.ndarray:
        """Names for the entries of a known array."""
        array = np.asarray(values)
        cast = bool if array.dtype == bool else float
        return np.array([self.add(Operation("constant", (), cast(v))) for v in array.ravel()], int).reshape(array.shape)

    def value(self, name: int) -> Any:
        """The value of a constant; None for what is not one."""
        operation = self.operations[name]
        return operation.value if operation.name == "constant" else None

    def scalar(self, name: str, *arguments: int) -> int:
        """One operation, folded or simplified where its arguments allow."""
        values = [self.value(a) for a in arguments]
        if all(v is not None for v in values):
            try:
                return self.add(Operation("constant", (), SCALAR[name](*values)))
            except (ArithmeticError, ValueError):
                pass
        if name in HOISTED and (chosen := self.operations[arguments[-1]]).name == "select":
            condition, first, second = chosen.arguments
            if self.value(second) is not None:  # chosen after, not before: the choice is made while the division runs
                branches = (self.scalar(name, *arguments[:-1], branch) for branch in (first, second))
                return self.scalar("select", condition, *branches)
        simpler = simplify(name, arguments, values)
        if simpler is not None:
            return simpler if isinstance(simpler, int) else self.add(Operation("constant", (), simpler[0]))
        return self.add(Operation(name, tuple(sorted(arguments)) if name in COMMUTE else arguments))

    def each(self, name: str, *arrays: np.ndarray) -> np.ndarray:
        """The operation entry by entry, over arrays of one shape or scalars."""
        arrays = tuple(np.broadcast_arrays(*arrays))
        flat = [self.scalar(name, *map(int, entries)) for entries in zip(*(a.ravel() for a in arrays), strict=True)]
        return np.array(flat, int).reshape(arrays[0].shape)

    def fold(self, name: str, array: np.ndarray, axes: tuple[int, ...]) -> np.ndarray:
        """A reduction, as a balanced tree: short chains run side by side."""
        kept = [axis for axis in range(array.ndim) if axis not in axes]
        rows = np.moveaxis(array, axes, range(len(kept), array.ndim))
        rows = rows.reshape(*rows.shape[: len(kept)], math.prod(rows.shape[len(kept) :]))
        while rows.shape[-1] > 1:
            even = rows.shape[-1] // 2 * 2
            paired = self.each(name, rows[..., :even:2], rows[..., 1:even:2])
            rows = np.concatenate([paired, rows[..., even:]], axis=-1)
        if rows.shape[-1] == 0:
            empty = {"add": 0.0, "mul": 1.0, "and": True, "or": False, "max": -math.inf, "min": math.inf}
            return np.full(rows.shape[:-1], self.constants(empty[name]).item())
        return rows[..., 0]

    def run(self, jaxpr: Any, consts: Any, arguments: list[np.ndarray]) -> list[np.ndarray]:
        """Names of the outputs of a jaxpr."""
        known = dict(zip(jaxpr.invars, arguments, strict=True))
        known |= {var: self.constants(value) for var, value in zip(jaxpr.constvars, consts, strict=True)}

        def read(atom):
            return self.constants(atom.val) if hasattr(atom, "val") else known[atom]

        for equation in jaxpr.eqns:
            results = _equation(self, equation, [read(atom) for atom in equation.invars])
            known |= dict(zip(equation.outvars, results, strict=True))
        return [read(atom) for atom in jaxpr.outvars]

    def program(self, inputs: list[np.ndarray], outputs: list[np.ndarray]) -> Program:
        """What the outputs need, renumbered."""
        needed, stack = set(), [int(name) for array in outputs for name in array.ravel()]
        while stack:
            name = stack.pop()
            if name not in needed:
                needed.add(name)
                stack.extend(self.operations[name].arguments)
        order = sorted(needed)
        new = {name: i for i, name in enumerate(order)}
        kept = tuple(
            Operation(op.name, tuple(new[a] for a in op.arguments), op.value)
            for op in (self.operations[n] for n in order)
        )

        def renamed(array):
            return np.array([new.get(int(name), -1) for name in array.ravel()], int).reshape(array.shape)

        return Program(kept, tuple(map(renamed, inputs)), tuple(map(renamed, outputs)))


NEUTRAL = {"add": 0.0, "mul": 1.0, "and": True, "or": False}
ABSORBING = {"mul": 0.0, "and": False, "or": True}  # 0 x is 0: a structural zero, whatever x has become
NEUTRAL_RIGHT = {"sub": 0.0, "div": 1.0}


def simplify(name: str, arguments: tuple[int, ...], values: list) -> int | tuple | None:
    """A name that stands for the operation, or (constant,), or None."""
    if name in NEUTRAL:
        for known, other in ((values[0], arguments[1]), (values[1], arguments[0])):
            if known is not None and known == NEUTRAL[name]:
                return other
            if known is not None and known == ABSORBING.get(name):
                return (known,)
    if name == "div" and values[0] == 0:
        return (0.0,)
    if name in NEUTRAL_RIGHT and values[1] == NEUTRAL_RIGHT[name]:
        return arguments[0]
    if name == "select" and (values[0] is not None or arguments[1] == arguments[2]):
        return arguments[2] if values[0] is False else arguments[1]
    return None


def refuse_other_rounding(name: str, parameters: dict) -> None:
    """Machine code rounds halves to even numbers."""
    if name == "round" and parameters["rounding_method"] != jax.lax.RoundingMethod.TO_NEAREST_EVEN:
        raise UnsupportedError("halves rounded away from zero")


def called(parameters: dict) -> tuple[Any, Any]:
    """The jaxpr that is called, and its constants."""
    inner = next(parameters[name] for name in ("jaxpr", "call_jaxpr", "fun_jaxpr", "call") if name in parameters)
    return (inner.jaxpr, inner.consts) if hasattr(inner, "consts") else (inner, ())


def _equation(line: _Line, equation: Any, arrays: list[np.ndarray]) -> list[np.ndarray]:
    """Names of the results of one equation."""
    name: str = equation.primitive.name
    name, parameters = NAMED.get(name, name), equation.params
    refuse_other_rounding(name, parameters)
    if name in CALLS and parameters.get("name") == "settles":
        return [line.each("settles", *arrays)]
    if name in CALLS:
        return line.run(*called(parameters), arrays)
    if name in MOVES or name in BY_NUMPY:
        return _moved(equation.primitive, arrays, parameters)
    if name in FOLDS:
        return [line.fold(FOLDS[name], arrays[0], tuple(parameters["axes"]))]
    if name in SCALAR and name not in ("select", "number", "truth", "truncate", "settles"):
        return [line.each(name, *arrays)]
    if name in SPECIAL:
        return [SPECIAL[name](line, equation, arrays)]
    raise UnsupportedError(f"the primitive {name}")


def _spread(array: np.ndarray, *, shape, broadcast_dimensions, **_) -> np.ndarray:
    ones = [array.shape[broadcast_dimensions.index(i)] if i in broadcast_dimensions else 1 for i in range(len(shape))]
    return np.broadcast_to(array.reshape(ones), shape)


def _sliced(array: np.ndarray, *, start_indices, limit_indices, strides, **_) -> np.ndarray:
    steps = strides or (1,) * array.ndim
    return array[tuple(map(slice, start_indices, limit_indices, steps))]


BY_NUMPY: dict[str, Callable] = {  # the same as JAX's own, without compiling anything
    "broadcast_in_dim": _spread,
    "slice": _sliced,
    "concatenate": lambda *arrays, dimension: np.concatenate(arrays, dimension),
    "squeeze": lambda array, dimensions: np.squeeze(array, dimensions),
    "reshape": lambda array, new_sizes, **_: array.reshape(new_sizes),
    "transpose": lambda array, permutation: array.transpose(permutation),
}


def _moved(primitive: Any, arrays: list[np.ndarray], parameters: dict) -> list[np.ndarray]:
    """What only moves entries about, evaluated on their names."""
    if primitive.name in BY_NUMPY:
        return [BY_NUMPY[primitive.name](*arrays, **parameters)]
    with jax.ensure_compile_time_eval():
        moved = primitive.bind(*(jnp.asarray(array) for array in arrays), **parameters)
    return [np.asarray(array) for array in (moved if isinstance(moved, list | tuple) else [moved])]


def _indexed(line: _Line, equation: Any, arrays: list[np.ndarray]) -> np.ndarray:
    """Gathers, scatters and dynamic slices whose indices are constants."""
    name, count = equation.primitive.name, {"gather": 1, "dynamic_slice": 1, "scatter": 1, "dynamic_update_slice": 2}
    movable = count[equation.primitive.name]
    if name == "gather" and (found := _gathered(line, equation, *arrays)) is not None:
        return found
    operands = []
    for i, array in enumerate(arrays):
        if i < movable or (name == "scatter" and i == 2):
            operands.append(jnp.asarray(array))
            continue
        values = [line.value(int(entry)) for entry in array.ravel()]
        if any(v is None for v in values):
            raise UnsupportedError(f"{name} at an index that is computed")
        operands.append(jnp.asarray(np.array(values, int).reshape(array.shape), equation.invars[i].aval.dtype))
    with jax.ensure_compile_time_eval():
        return np.asarray(equation.primitive.bind(*operands, **equation.params))


def _gathered(line: _Line, equation: Any, array: np.ndarray, indices: np.ndarray) -> np.ndarray | None:
    """What is gathered at known indices that are inside, as rows of a matrix, without JAX; None for anything else."""
    numbers, sizes = equation.params["dimension_numbers"], equation.params["slice_sizes"]
    leading, values = indices.shape[:-1], [line.value(int(entry)) for entry in indices.ravel()]
    inner = tuple(size for axis, size in enumerate(sizes) if axis not in numbers.collapsed_slice_dims)
    last = numbers.offset_dims == tuple(range(len(leading), len(leading) + len(inner)))
    if not last or numbers.operand_batching_dims or any(value is None for value in values):
        return None
    begin = np.zeros((math.prod(leading), array.ndim), int)
    begin[:, list(numbers.start_index_map)] = np.reshape(values, (len(begin), indices.shape[-1]))
    if (begin < 0).any() or (begin + sizes > array.shape).any():
        return None
    parts = [array[tuple(map(slice, start, start + sizes))].reshape(inner) for start in begin]
    return np.array(parts, int).reshape(*leading, *inner)


def _select(line: _Line, equation: Any, arrays: list[np.ndarray]) -> np.ndarray:
    if len(arrays) != 3:
        raise UnsupportedError("a selection among more than two")
    return line.each("select", arrays[0], arrays[2], arrays[1])


def _convert(line: _Line, equation: Any, arrays: list[np.ndarray]) -> np.ndarray:
    old, new = equation.invars[0].aval.dtype.kind, np.dtype(equation.params["new_dtype"]).kind
    if new == "b":
        return arrays[0] if old == "b" else line.each("truth", arrays[0])
    if old == "b":
        return line.each("number", arrays[0])
    if new in "iu" and old == "f":
        return line.each("truncate", arrays[0])
    return arrays[0]


def _power(line: _Line, equation: Any, arrays: list[np.ndarray]) -> np.ndarray:
    exponent = equation.params["y"]
    result = line.constants(np.ones(arrays[0].shape))
    for _ in range(abs(exponent)):
        result = line.each("mul", result, arrays[0])
    return result if exponent >= 0 else line.each("div", line.constants(np.ones(arrays[0].shape)), result)


def _argmax(line: _Line, equation: Any, arrays: list[np.ndarray]) -> np.ndarray:
    (axis,) = equation.params["axes"]
    rows = np.moveaxis(arrays[0], axis, -1)
    best, where = rows[..., 0], line.constants(np.zeros(rows.shape[:-1]))
    for i in range(1, rows.shape[-1]):
        larger = line.each("gt", rows[..., i], best)
        best = line.each("select", larger, rows[..., i], best)
        where = line.each("select", larger, line.constants(np.full(where.shape, float(i))), where)
    return where


def _dot(line: _Line, equation: Any, arrays: list[np.ndarray]) -> np.ndarray:
    contract, batch = equation.params["dimension_numbers"]
    leading, free, sides = [arrays[0].shape[axis] for axis in batch[0]], [], []
    for array, summed, shared in zip(arrays, contract, batch, strict=True):
        kept = [axis for axis in range(array.ndim) if axis not in (*summed, *shared)]
        free.append([array.shape[axis] for axis in kept])
        moved = array.transpose(*shared, *kept, *summed)
        sides.append(moved.reshape(math.prod(leading), math.prod(free[-1]), math.prod(array.shape[a] for a in summed)))
    products = line.each("mul", sides[0][:, :, None, :], sides[1][:, None, :, :])
    return line.fold("add", products, (3,)).reshape(*leading, *free[0], *free[1])


SPECIAL: dict[str, Callable] = {
    "select_n": _select, "convert_element_type": _convert, "integer_pow": _power, "argmax": _argmax, "dot_general": _dot,
    "square": lambda line, _, arrays: line.each("mul", arrays[0], arrays[0]),
    "rsqrt": lambda line, _, a: line.each("div", line.constants(np.ones(a[0].shape)), line.each("sqrt", a[0])),
    "log2": lambda line, _, a: line.each("mul", line.each("log", a[0]), line.constants(np.full(a[0].shape, 1 / math.log(2)))),
    "sign": lambda line, _, a: line.each(
        "sub",
        line.each("number", line.each("gt", a[0], line.constants(np.zeros(a[0].shape)))),
        line.each("number", line.each("lt", a[0], line.constants(np.zeros(a[0].shape)))),
    ),
    "iota": lambda line, equation, _: line.constants(np.indices(equation.params["shape"])[equation.params["dimension"]]),
    "stop_gradient": lambda line, _, arrays: arrays[0],
    "gather": _indexed, "dynamic_slice": _indexed, "scatter": _indexed, "dynamic_update_slice": _indexed,
}  # fmt: skip
