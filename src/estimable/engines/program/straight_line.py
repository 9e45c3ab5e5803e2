"""From the jaxpr of a step to a straight line of scalar operations.

Arrays become arrays of scalar names, so that moving entries costs nothing. Equal operations on equal scalars are merged (a
symmetric matrix is computed once), constants are folded, and unused operations are dropped.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import numpy as np
from jax.core import ShapedArray

from ...annotations import Array
from .composed import Entrywise, composed, is_entrywise, type_of_value
from .jaxprs import CALLS, SAME, Atom, array_of, called, is_literal, name_of
from .primitives import BOOL, FLOAT, NARROW, PYTHON, Scalar, UnsupportedError, folded, row, type_of
from .rearrangement import INDEXED, MOVES, indexed, moved
from .reductions import REDUCTIONS
from .simplification import simplify

if TYPE_CHECKING:  # importing it takes a tenth of a second, for Pallas
    from jax.extend.core import ClosedJaxpr, Jaxpr, JaxprEqn

MOST = 16_000  # operations: above this, compilation takes seconds, and arrays are as fast
COMMUTE = {"add", "mul", "eq", "ne", "and", "or", "xor"}
HOISTED = {"div", "sqrt", "log"}  # slow, and without side effects


class ScalarOperation(NamedTuple):
    """One scalar: the name of the operation, its arguments, the value of a constant or the place of an input, and its type."""

    name: str
    arguments: tuple[int, ...] = ()
    value: Any = None
    type: str = FLOAT


class Program(NamedTuple):
    """Scalars in order; `inputs` of each flat input array, `outputs` of each flat output array (index arrays)."""

    operations: tuple[ScalarOperation, ...]
    inputs: tuple[np.ndarray, ...]
    outputs: tuple[np.ndarray, ...]

    def is_bool(self, name: int) -> bool:
        """Whether a scalar is a bool."""
        return self.operations[name].type == BOOL


def lower(function: Callable, *arguments: Any, known: dict[tuple[int, int], Any] | None = None) -> Program:
    """The straight line of `function` at arguments of these shapes: see `lower_jaxpr`."""
    return lower_jaxpr(jax.make_jaxpr(function)(*arguments), known)


def lower_jaxpr(closed: ClosedJaxpr, known: dict[tuple[int, int], Any] | None = None, most: int = MOST) -> Program:
    """The straight line of a trace. Raises `UnsupportedError`.

    `known`: the values of constant input entries (array, entry), such as the zeros of a triangular matrix.
    `most`: the largest number of operations.
    """
    line = _ScalarLine(known or {}, most)
    names = [line.inputs(i, array_of(v)) for i, v in enumerate(closed.jaxpr.invars)]
    outputs = line.run(closed.jaxpr, closed.consts, names)
    return line.program(names, outputs)


class _ScalarLine:
    """The operations so far, each one once."""

    def __init__(self, known: dict[tuple[int, int], Any], most: int):
        self.known, self.most = known, most
        self.operations: list[ScalarOperation] = []
        self.types: list[str] = []
        self.values: list[Any] = []  # of constants, else None
        self.found: dict[tuple, int] = {}

    def add(self, operation: ScalarOperation) -> int:
        """The name of an operation, new or existing."""
        value = operation.value
        key = (operation.name, operation.arguments, repr(value), type(value))
        if key not in self.found:
            if len(self.operations) >= self.most:
                raise UnsupportedError(f"the step has more than {self.most:,} operations")
            self.found[key] = len(self.operations)
            self.operations.append(operation)
            self.types.append(operation.type)
            self.values.append(value if operation.name == "constant" else None)
        return self.found[key]

    def inputs(self, place: int, aval: ShapedArray) -> np.ndarray:
        """Names for the entries of an input array."""
        kind = type_of(aval.dtype)
        places = [(place, i) for i in range(math.prod(aval.shape))]
        names = [
            self.known_scalar(self.known[p]) if p in self.known else self.add(ScalarOperation("input", (), p, kind))
            for p in places
        ]
        return np.array(names, int).reshape(aval.shape)

    def constants(self, values: Array | float, dtype: np.dtype | None = None) -> np.ndarray:
        """Names for the entries of a known array."""
        array = np.asarray(values, dtype)
        cast = PYTHON[type_of(array.dtype)]
        return np.array([self.known_scalar(cast(v)) for v in array.ravel()], int).reshape(array.shape)

    def constant(self, value: Scalar) -> np.ndarray:
        """The name of a known scalar, as a zero-dimensional array."""
        return np.array(self.known_scalar(value))

    def known_scalar(self, value: Scalar) -> int:
        """The name of a known scalar."""
        return self.add(ScalarOperation("constant", (), value, type_of_value(value)))

    def scalar(self, name: str, *arguments: int) -> int:
        """One operation, folded or simplified where its arguments allow."""
        found = row(name, tuple([self.types[a] for a in arguments]))
        values = [self.values[a] for a in arguments]
        if None not in values and (known := folded(found, values)) is not None:
            return self.known_scalar(known)
        if name in HOISTED and (chosen := self.operations[arguments[-1]]).name == "select":
            condition, first, second = chosen.arguments
            if self.values[second] is not None:  # chosen afterwards: the choice is made while the division runs
                branches = (self.scalar(name, *arguments[:-1], branch) for branch in (first, second))
                return self.scalar("select", condition, *branches)
        simpler = simplify(name, arguments, values)
        if simpler is not None:
            return simpler if isinstance(simpler, int) else self.known_scalar(simpler[0])
        ordered = tuple(sorted(arguments)) if name in COMMUTE else arguments
        return self.add(ScalarOperation(name, ordered, None, found.result))

    def each(self, name: str, *arrays: np.ndarray) -> np.ndarray:
        """The operation entry by entry, over arrays of one shape or scalars."""
        shape = arrays[0].shape
        if any(array.shape != shape for array in arrays):
            arrays = tuple(np.broadcast_arrays(*arrays))
            shape = arrays[0].shape
        flat = [self.scalar(name, *entries) for entries in zip(*[a.ravel().tolist() for a in arrays], strict=True)]
        return np.array(flat, int).reshape(shape)

    def run(self, jaxpr: Jaxpr, consts: Sequence[Array], arguments: list[np.ndarray]) -> list[np.ndarray]:
        """Names of the outputs of a jaxpr."""
        names: dict[Atom, np.ndarray] = dict(zip(jaxpr.invars, arguments, strict=True))
        names |= {var: self.constants(value) for var, value in zip(jaxpr.constvars, consts, strict=True)}

        def read(atom: Atom):
            return self.constants(atom.val, array_of(atom).dtype) if is_literal(atom) else names[atom]

        for equation in jaxpr.eqns:
            results = self.equation(equation, [read(atom) for atom in equation.invars])
            names |= dict(zip(equation.outvars, results, strict=True))
        return [read(atom) for atom in jaxpr.outvars]

    def equation(self, equation: JaxprEqn, arrays: list[np.ndarray]) -> list[np.ndarray]:
        """Names of the results of one equation."""
        name, parameters = name_of(equation), equation.params
        if name in CALLS:
            jaxpr, consts = called(parameters)
            settles = parameters.get("name") == "settles" and not jaxpr.eqns
            return [self.each("settles", *arrays)] if settles else self.run(jaxpr, consts, arrays)
        if name in SAME:
            return arrays
        if name in MOVES:
            return moved(equation.primitive, arrays, parameters)
        return [self.result(name, equation, arrays)]

    def result(self, name: str, equation: JaxprEqn, arrays: list[np.ndarray]) -> np.ndarray:
        """Names of the result of an equation with a single result."""
        aval = array_of(equation.outvars[0])
        kind, dtype = type_of(aval.dtype), aval.dtype
        if name in INDEXED:
            result = indexed(self, equation, arrays)
        elif name == "iota":
            result = self.constants(np.indices(aval.shape)[equation.params["dimension"]], dtype)
        elif name in REDUCTIONS:
            result = REDUCTIONS[name](self, equation, *arrays)
            result = self.each(NARROW[dtype], result) if dtype in NARROW else result
        elif is_entrywise(name):
            result = composed(self, name, Entrywise.of(equation), *arrays)
            result = result if result.shape == aval.shape else np.broadcast_to(result, aval.shape)
        else:
            raise UnsupportedError(f"the primitive {name} is not supported")
        if result.size and self.operations[result.flat[0]].type != kind:
            raise UnsupportedError(
                f"the primitive {name} of {' and '.join(map(str, Entrywise.of(equation).given))} to {dtype} is not supported"
            )
        return result

    def program(self, inputs: list[np.ndarray], outputs: list[np.ndarray]) -> Program:
        """The operations that the outputs need, renumbered."""
        needed, stack = set(), [int(name) for array in outputs for name in array.ravel()]
        while stack:
            name = stack.pop()
            if name not in needed:
                needed.add(name)
                stack.extend(self.operations[name].arguments)
        order = sorted(needed)
        new = {name: i for i, name in enumerate(order)}
        operations = (self.operations[name] for name in order)
        left = tuple([ScalarOperation(n, tuple([new[a] for a in given]), v, t) for n, given, v, t in operations])

        def renamed(array: np.ndarray):
            return np.array([new.get(int(name), -1) for name in array.ravel()], int).reshape(array.shape)

        return Program(left, tuple(map(renamed, inputs)), tuple(map(renamed, outputs)))
