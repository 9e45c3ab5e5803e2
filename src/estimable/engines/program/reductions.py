"""Reductions (sums, matrix products, index of the largest entry), on arrays of scalar names."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from .jaxprs import array_of
from .primitives import BOOL, FLOAT, Scalar, type_of

if TYPE_CHECKING:  # importing it takes a tenth of a second, for Pallas
    from jax.extend.core import JaxprEqn


class ScalarNames(Protocol):
    """Scalars in order, the source of arrays of names."""

    values: list[Any]

    def each(self, name: str, *arrays: np.ndarray) -> np.ndarray:
        """A row of the table applied entry by entry."""
        ...

    def constant(self, value: Scalar) -> np.ndarray:
        """The name of a known scalar."""
        ...


FOLDS = {"reduce_sum": "add", "reduce_prod": "mul", "reduce_max": "max", "reduce_min": "min", "reduce_and": "and",
         "reduce_or": "or", "reduce_xor": "xor"}  # fmt: skip
RUNNING = {"cumsum": "add", "cumprod": "mul", "cummax": "max", "cummin": "min"}


def empty(name: str, dtype: np.dtype) -> Any:
    """The result of a row of the table for no entries."""
    kind = type_of(dtype)
    if name in ("max", "min"):
        least = name == "max"
        if kind == FLOAT:
            return -math.inf if least else math.inf
        if kind == BOOL:
            return not least
        limits = np.iinfo(dtype)
        return int(limits.min if least else limits.max)
    value = {"add": 0, "mul": 1, "and": -1, "or": 0, "xor": 0}[name]
    return float(value) if kind == FLOAT else bool(value) if kind == BOOL else value


def folded_along(line: ScalarNames, name: str, array: np.ndarray, axes: tuple[int, ...], dtype: np.dtype) -> np.ndarray:
    """A reduction, as a balanced tree: short chains run side by side."""
    left = [axis for axis in range(array.ndim) if axis not in axes]
    rows = np.moveaxis(array, axes, range(len(left), array.ndim))
    rows = rows.reshape(*rows.shape[: len(left)], math.prod(rows.shape[len(left) :]))
    while rows.shape[-1] > 1:
        even = rows.shape[-1] // 2 * 2
        paired = line.each(name, rows[..., :even:2], rows[..., 1:even:2])
        rows = np.concatenate([paired, rows[..., even:]], axis=-1)
    if rows.shape[-1] == 0:
        return np.full(rows.shape[:-1], line.constant(empty(name, dtype)).item())
    return rows[..., 0]


def _reduction(line: ScalarNames, equation: JaxprEqn, array: np.ndarray) -> np.ndarray:
    axes, dtype = tuple(equation.params["axes"]), array_of(equation.outvars[0]).dtype
    return folded_along(line, FOLDS[equation.primitive.name], array, axes, dtype)


def _running(line: ScalarNames, equation: JaxprEqn, array: np.ndarray) -> np.ndarray:
    """Sums (products, ..) of all entries up to each, along an axis."""
    name, axis, backwards = RUNNING[equation.primitive.name], equation.params["axis"], equation.params["reverse"]
    rows = np.moveaxis(array, axis, 0)[:: -1 if backwards else 1]
    totals = list(rows[:1])
    for entry in rows[1:]:
        totals.append(line.each(name, totals[-1], entry))
    return np.moveaxis(np.array(totals, int).reshape(rows.shape)[:: -1 if backwards else 1], 0, axis)


def _extreme(line: ScalarNames, equation: JaxprEqn, array: np.ndarray) -> np.ndarray:
    """The index of the largest (least) entry along an axis: the first of several; the first NaN takes precedence."""
    (axis,) = equation.params["axes"]
    rows, beyond = np.moveaxis(array, axis, -1), "gt" if equation.primitive.name == "argmax" else "lt"
    best, where = rows[..., 0], np.broadcast_to(line.constant(0), rows.shape[:-1])
    for i in range(1, rows.shape[-1]):
        here = rows[..., i]
        further = line.each(beyond, here, best)
        if array_of(equation.invars[0]).dtype == float:
            undefined = line.each("and", line.each("ne", here, here), line.each("eq", best, best))
            further = line.each("or", further, undefined)
        best = line.each("select", further, here, best)
        where = line.each("select", further, line.constant(i), where)
    return where


def _product(line: ScalarNames, equation: JaxprEqn, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    contract, batch = equation.params["dimension_numbers"]
    leading, free, sides = [a.shape[axis] for axis in batch[0]], [], []
    for array, summed, shared in zip((a, b), contract, batch, strict=True):
        left = [axis for axis in range(array.ndim) if axis not in (*summed, *shared)]
        free.append([array.shape[axis] for axis in left])
        moved = array.transpose(*shared, *left, *summed)
        sides.append(moved.reshape(math.prod(leading), math.prod(free[-1]), math.prod(array.shape[i] for i in summed)))
    products = line.each("mul", sides[0][:, :, None, :], sides[1][:, None, :, :])
    total = folded_along(line, "add", products, (3,), array_of(equation.outvars[0]).dtype)
    return total.reshape(*leading, *free[0], *free[1])


REDUCTIONS: dict[str, Callable[..., np.ndarray]] = {
    **dict.fromkeys(FOLDS, _reduction), **dict.fromkeys(RUNNING, _running), "argmax": _extreme, "argmin": _extreme,
    "dot_general": _product,
}  # fmt: skip
