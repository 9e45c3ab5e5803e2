"""From the jaxpr of a step to a list of operations on arrays, for models too large for a straight line of scalars.

Calls are inlined, equal operations merged, unused operations dropped, and arithmetic on known scalars, such as indices, is
done here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jax.core import ShapedArray

from ...annotations import Array
from .composed import Entrywise, Values, composed, is_entrywise
from .jaxprs import CALLS, SAME, Atom, array_of, called, is_literal, name_of
from .primitives import BOOL, FLOAT, INTEGER, NARROW, UnsupportedError, type_of
from .rearrangement import BY_NUMPY
from .reductions import FOLDS, RUNNING

if TYPE_CHECKING:  # importing it takes a tenth of a second, for Pallas
    from jax.extend.core import ClosedJaxpr, Jaxpr, JaxprEqn

KINDS = {FLOAT: "double", INTEGER: "i64", BOOL: "i1"}
TYPES = {kind: type_ for type_, kind in KINDS.items()}
DTYPES = {"double": float, "i64": int, "i1": bool}
FEW = 64  # entries of index arrays that are computed here
REPEATED = ("num_consts", "num_carry", "length", "reverse")  # how a scan repeats its program
SEVERAL = {"scan", "cond", "split"}  # a list of results, even for one
WRAPPED = {*FOLDS, *RUNNING, "iota"}  # non-elementwise operations whose result may leave the range of a narrow integer


class ArrayOperation(NamedTuple):
    """One array: the primitive, its arguments, its shape and kind, and the value of a constant or the parameters.

    The parameters of an elementwise operation are an `Entrywise`. A primitive with several results has none itself (its shape
    is ()): each is a "result" of it, and `value` is its index.
    """

    name: str
    arguments: tuple[int, ...]
    shape: tuple[int, ...]
    kind: str
    value: Any = None


class Repeated(NamedTuple):
    """The body of a scan: a program from (constants, carry, one row of each array) to (carry, a row of each result)."""

    program: Arrays
    constants: int
    carried: int
    length: int
    backwards: bool


class Branches(NamedTuple):
    """The branches of a choice: the first for 0, the second for 1, .."""

    programs: tuple[Arrays, ...]


class Arrays(NamedTuple):
    """Operations in order; the indices of inputs (-1: not needed) and outputs; shape and kind of each input."""

    operations: tuple[ArrayOperation, ...]
    inputs: tuple[int, ...]
    outputs: tuple[int, ...]
    types: tuple[tuple[tuple[int, ...], str], ...]

    def is_bool(self, name: int) -> bool:
        """Whether an array holds bools."""
        return self.operations[name].kind == "i1"


def lower(closed: ClosedJaxpr) -> Arrays:
    """The operations of a trace. Raises `UnsupportedError` for an array of an unknown kind."""
    return _lowered(closed.jaxpr, closed.consts)


def _lowered(jaxpr: Jaxpr, consts: Sequence[Array]) -> Arrays:
    line = _ArrayLine()
    inputs = [line.add(ArrayOperation("input", (), *_type(array_of(v)), value=i)) for i, v in enumerate(jaxpr.invars)]
    return line.program(inputs, line.run(jaxpr, consts, inputs))


class _ArrayLine:
    """The operations so far, each one once."""

    def __init__(self):
        self.operations: list[ArrayOperation] = []
        self.found: dict[tuple, int] = {}
        self.inside: dict[tuple, Repeated | Branches] = {}

    def add(self, operation: ArrayOperation) -> int:
        """The name of an operation, new or existing."""
        key = (*operation[:4], _key(operation.value))
        if key not in self.found:
            self.found[key] = len(self.operations)
            self.operations.append(operation)
        return self.found[key]

    def constant(self, value: Array | float, dtype: np.dtype | None = None) -> int:
        """The name of a known array."""
        array = np.asarray(value, dtype)
        kind = KINDS[type_of(array.dtype)]
        return self.add(ArrayOperation("constant", (), array.shape, kind, array.astype(DTYPES[kind])))

    def run(self, jaxpr: Jaxpr, consts: Sequence[Array], arguments: list[int]) -> list[int]:
        """Names of the outputs of a jaxpr."""
        known: dict[Atom, int] = dict(zip(jaxpr.invars, arguments, strict=True))
        known |= {var: self.constant(value) for var, value in zip(jaxpr.constvars, consts, strict=True)}

        def read(atom: Atom):
            return self.constant(atom.val, array_of(atom).dtype) if is_literal(atom) else known[atom]

        for equation in jaxpr.eqns:
            known |= dict(
                zip(equation.outvars, self.equation(equation, [read(a) for a in equation.invars]), strict=True)
            )
        return [read(atom) for atom in jaxpr.outvars]

    def equation(self, equation: JaxprEqn, arguments: list[int]) -> list[int]:
        """Names of the results of one equation."""
        name, parameters = name_of(equation), equation.params
        if name in CALLS:
            return self.run(*called(parameters), arguments)
        types = [_type(array_of(var)) for var in equation.outvars]
        if self.changes_nothing(name, parameters, arguments):
            return arguments
        if len(types) == 1 and name not in SEVERAL:
            return [self.one(name, equation, arguments, types[0])]
        whole = self.add(ArrayOperation(name, tuple(arguments), (), "", self.inner(name, parameters)))
        return [self.add(ArrayOperation("result", (whole,), *kind, value=i)) for i, kind in enumerate(types)]

    def one(self, name: str, equation: JaxprEqn, arguments: list[int], result: tuple) -> int:
        """The name of the only result of an equation."""
        how = Entrywise.of(equation)
        if (
            name == "convert_element_type"
            and how.result not in NARROW
            and result[1] == self.operations[arguments[0]].kind
        ):
            return arguments[0]
        parameters = how if is_entrywise(name) else equation.params
        found = self.folded(ArrayOperation(name, tuple(arguments), *result, value=parameters))
        if name in WRAPPED and how.result in NARROW:
            return self.folded(ArrayOperation(NARROW[how.result], (found,), *result, value=how))
        return found

    def changes_nothing(self, name: str, parameters: dict, arguments: list[int]) -> bool:
        """Whether an equation returns its argument unchanged, such as the transpose of a product a a'."""
        if name != "transpose":
            return name in SAME
        product = self.operations[arguments[0]]
        if product.name != "dot_general" or len(product.shape) != 2:
            return False
        a, other = product.arguments
        turned = self.operations[other]
        along = product.value["dimension_numbers"] == (((1,), (0,)), ((), ()))
        return along and turned.name == "transpose" and turned.arguments == (a,) and parameters["permutation"] == (1, 0)

    def inner(self, name: str, parameters: dict) -> Any:
        """The parameters, with the inner programs lowered, each once."""
        if name not in ("scan", "cond"):
            return parameters
        inside = (parameters["jaxpr"],) if name == "scan" else parameters["branches"]
        key = (name, *(id(closed.jaxpr) for closed in inside), *(parameters.get(name) for name in REPEATED))
        if key not in self.inside:
            programs = tuple(_lowered(closed.jaxpr, closed.consts) for closed in inside)
            self.inside[key] = Branches(programs) if name == "cond" else Repeated(
                programs[0], parameters["num_consts"], parameters["num_carry"], parameters["length"], parameters["reverse"]
            )  # fmt: skip
        return self.inside[key]

    def folded(self, operation: ArrayOperation) -> int:
        """An operation on known scalars, or on a few known indices, is known."""
        known = [self.operations[a] for a in operation.arguments]
        values = [
            a.value
            for a in known
            if a.name == "constant" and (a.shape == () or (a.kind != "double" and a.value.size <= FEW))
        ]
        if len(values) < len(known) or (operation.shape and operation.kind == "double"):
            return self.add(operation)
        value = _known(operation, values) if known or operation.name == "iota" else None
        return self.add(operation) if value is None else self.constant(value)

    def program(self, inputs: list[int], outputs: list[int]) -> Arrays:
        """The operations that the outputs need, renumbered."""
        needed, stack = set(), list(outputs)
        while stack:
            name = stack.pop()
            if name not in needed:
                needed.add(name)
                stack.extend(self.operations[name].arguments)
        new = {name: i for i, name in enumerate(sorted(needed))}
        left = (self.operations[name] for name in sorted(needed))
        return Arrays(
            tuple(op._replace(arguments=tuple(new[a] for a in op.arguments)) for op in left),
            tuple(new.get(name, -1) for name in inputs),
            tuple(new[name] for name in outputs),
            tuple(self.operations[name][2:4] for name in inputs),
        )


def _known(operation: ArrayOperation, values: list[np.ndarray]) -> np.ndarray | None:
    """The result of an operation on known arrays; None where it cannot be computed here, or is left to the machine."""
    name, shape, how = operation.name, operation.shape, operation.value
    if math.prod(shape) > FEW:
        return None
    if name in BY_NUMPY:
        return BY_NUMPY[name](*values, **how)
    if name == "iota":
        return np.indices(shape)[how["dimension"]]
    if not is_entrywise(name):
        return None
    entries = zip(*(np.broadcast_to(value, shape).ravel().tolist() for value in values), strict=True)
    try:
        known = [composed(Values(), name, how, *entry) for entry in entries]
    except UnsupportedError:
        return None
    return np.array(known, DTYPES[operation.kind]).reshape(shape)


def _type(aval: ShapedArray) -> tuple[tuple[int, ...], str]:
    return tuple(aval.shape), KINDS[type_of(aval.dtype)]


def _key(value: Any) -> Any:
    """What distinguishes one value from another: the entries of a constant, the text of parameters."""
    if isinstance(value, np.ndarray):
        return value.tobytes()
    if isinstance(value, Entrywise):
        return (*_key(value.parameters), *map(str, value.given), str(value.result))
    if isinstance(value, dict):
        return tuple((name, str(entry)) for name, entry in sorted(value.items()) if name != "sharding")
    return id(value) if isinstance(value, Repeated | Branches) else value
