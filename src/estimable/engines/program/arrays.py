"""From the jaxpr of a step to a list of operations on arrays: for models that are too large to be written out as scalars.

What is called is written in place, equal operations are one, what no output needs is dropped, and arithmetic on known
scalars, as that of indices, is done here.
"""

import math
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from .straight_line import BY_NUMPY, CALLS, NAMED, SCALAR, UnsupportedError, called, refuse_other_rounding

KINDS = {"f": "double", "i": "i64", "b": "i1"}  # an int32 is held as an i64, and does not wrap
DTYPES = {"double": float, "i64": int, "i1": bool}
FEW = 64  # entries of arrays of indices that are worked out here
REPEATED = ("num_consts", "num_carry", "length", "reverse")  # how a scan repeats its program
BITWISE = {"and", "or", "xor", "not"}
SEVERAL = {"scan", "cond", "split"}  # results, even if it is but one
SAME = {"copy", "copy_p", "stop_gradient", "optimization_barrier"}


class Operation(NamedTuple):
    """One array: the primitive, the arrays it takes, its shape and kind, and the value of a constant or the parameters.

    A primitive of several results gives none itself (its shape is ()): each is a "result" of it, `value` says which.
    """

    name: str
    arguments: tuple[int, ...]
    shape: tuple[int, ...]
    kind: str
    value: Any = None


class Repeated(NamedTuple):
    """What a scan repeats: a program of (constants, carry, one row of each array) to (carry, what is told of the row)."""

    program: "Arrays"
    constants: int
    carried: int
    length: int
    backwards: bool


class Branches(NamedTuple):
    """What a choice chooses from: the first for 0, the second for 1, .."""

    programs: tuple["Arrays", ...]


class Arrays(NamedTuple):
    """Operations in order; which of them the inputs are (-1: not needed) and which the outputs; shape and kind of each input."""

    operations: tuple[Operation, ...]
    inputs: tuple[int, ...]
    outputs: tuple[int, ...]
    types: tuple[tuple[tuple[int, ...], str], ...]

    def is_truth(self, name: int) -> bool:
        """Whether an array holds truths and not numbers."""
        return self.operations[name].kind == "i1"


def lower(closed: Any) -> Arrays:
    """The operations of what has been traced. Raises `UnsupportedError` where an array is of a kind unknown here."""
    return _lowered(closed.jaxpr, closed.consts)


def _lowered(jaxpr: Any, consts: Any) -> Arrays:
    line = _Line()
    inputs = [line.add(Operation("input", (), *_type(v.aval), value=i)) for i, v in enumerate(jaxpr.invars)]
    return line.program(inputs, line.run(jaxpr, consts, inputs))


class _Line:
    """The operations so far, each one once."""

    def __init__(self):
        self.operations: list[Operation] = []
        self.found: dict[tuple, int] = {}
        self.inside: dict[tuple, Repeated | Branches] = {}

    def add(self, operation: Operation) -> int:
        """The name of an operation, new or met before."""
        key = (*operation[:4], _key(operation.value))
        if key not in self.found:
            self.found[key] = len(self.operations)
            self.operations.append(operation)
        return self.found[key]

    def constant(self, value: Any) -> int:
        """The name of a known array."""
        array = np.asarray(value)
        kind = _kind(array.dtype)
        return self.add(Operation("constant", (), array.shape, kind, array.astype(DTYPES[kind])))

    def run(self, jaxpr: Any, consts: Any, arguments: list[int]) -> list[int]:
        """Names of the outputs of a jaxpr."""
        known = dict(zip(jaxpr.invars, arguments, strict=True))
        known |= {var: self.constant(value) for var, value in zip(jaxpr.constvars, consts, strict=True)}

        def read(atom):
            return self.constant(atom.val) if hasattr(atom, "val") else known[atom]

        for equation in jaxpr.eqns:
            known |= dict(
                zip(equation.outvars, self.equation(equation, [read(a) for a in equation.invars]), strict=True)
            )
        return [read(atom) for atom in jaxpr.outvars]

    def equation(self, equation: Any, arguments: list[int]) -> list[int]:
        """Names of the results of one equation."""
        name: str = equation.primitive.name
        name, parameters = NAMED.get(name, name), equation.params
        if name in CALLS:
            return self.run(*called(parameters), arguments)
        if equation.effects or not equation.outvars:
            raise UnsupportedError(f"the primitive {name} does something beside its results")
        refuse_other_rounding(name, parameters)
        types = [_type(var.aval) for var in equation.outvars]
        if self.changes_nothing(name, parameters, arguments, types[0]):
            return arguments
        if len(types) == 1 and name not in SEVERAL:
            return [self.folded(Operation(name, tuple(arguments), *types[0], value=parameters))]
        whole = self.add(Operation(name, tuple(arguments), (), "", self.inner(name, parameters)))
        return [self.add(Operation("result", (whole,), *kind, value=i)) for i, kind in enumerate(types)]

    def changes_nothing(self, name: str, parameters: dict, arguments: list[int], result: tuple) -> bool:
        """Whether an equation gives its argument back: as the transpose of a product a a' does."""
        if name == "convert_element_type":
            return result[1] == self.operations[arguments[0]].kind
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
        """The parameters, with the programs inside as such: each is worked out once."""
        if name not in ("scan", "cond"):
            return parameters
        inside = (parameters["jaxpr"],) if name == "scan" else parameters["branches"]
        key = (name, *(id(closed.jaxpr) for closed in inside), *(parameters.get(told) for told in REPEATED))
        if key not in self.inside:
            programs = tuple(_lowered(closed.jaxpr, closed.consts) for closed in inside)
            self.inside[key] = Branches(programs) if name == "cond" else Repeated(
                programs[0], parameters["num_consts"], parameters["num_carry"], parameters["length"], parameters["reverse"]
            )  # fmt: skip
        return self.inside[key]

    def folded(self, operation: Operation) -> int:
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
        """What the outputs need, renumbered."""
        needed, stack = set(), list(outputs)
        while stack:
            name = stack.pop()
            if name not in needed:
                needed.add(name)
                stack.extend(self.operations[name].arguments)
        new = {name: i for i, name in enumerate(sorted(needed))}
        kept = (self.operations[name] for name in sorted(needed))
        return Arrays(
            tuple(op._replace(arguments=tuple(new[a] for a in op.arguments)) for op in kept),
            tuple(new.get(name, -1) for name in inputs),
            tuple(new[name] for name in outputs),
            tuple(self.operations[name][2:4] for name in inputs),
        )


def _known(operation: Operation, values: list[np.ndarray]) -> np.ndarray | None:
    """What an operation gives for known arrays; None where it is not known how, or where Python has no answer."""
    name, shape, cast = operation.name, operation.shape, DTYPES[operation.kind]
    if math.prod(shape) > FEW or (name in BITWISE and operation.kind != "i1"):
        return None
    if name in BY_NUMPY:
        return BY_NUMPY[name](*values, **operation.value)
    if name == "iota":
        return np.indices(shape)[operation.value["dimension"]]
    if name == "select_n" and len(values) == 3:
        return np.where(values[0], values[2], values[1])
    if name == "convert_element_type":
        return values[0].astype(cast)
    if name not in SCALAR or name == "select":
        return None
    with suppress(ArithmeticError, ValueError, TypeError):
        entries = zip(*(value.ravel().tolist() for value in np.broadcast_arrays(*values)), strict=True)
        return np.array([SCALAR[name](*entry) for entry in entries], cast).reshape(shape)
    return None


def _type(aval: Any) -> tuple[tuple[int, ...], str]:
    return tuple(aval.shape), _kind(aval.dtype)


def _kind(dtype: Any) -> str:
    """How an entry is held."""
    if getattr(dtype, "kind", None) not in KINDS or (dtype.kind == "f" and dtype.itemsize != 8):
        raise UnsupportedError(f"numbers of the kind {dtype}")
    return KINDS[dtype.kind]


def _key(value: Any) -> Any:
    """What tells one value from another: constants by their entries, parameters by their text."""
    if isinstance(value, np.ndarray):
        return value.tobytes()
    if isinstance(value, dict):
        return tuple((name, str(entry)) for name, entry in sorted(value.items()) if name != "sharding")
    return id(value) if isinstance(value, Repeated | Branches) else value
