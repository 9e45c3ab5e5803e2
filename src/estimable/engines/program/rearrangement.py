"""Operations that only move entries, on arrays of scalar names: they cost nothing, and JAX itself determines the places."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np

from .jaxprs import array_of
from .primitives import UnsupportedError
from .reductions import ScalarNames

if TYPE_CHECKING:  # importing it takes a tenth of a second, for Pallas
    from jax.extend.core import JaxprEqn, Primitive


def _spread(array: np.ndarray, *, shape: tuple[int, ...], broadcast_dimensions: tuple[int, ...], **_) -> np.ndarray:
    ones = [array.shape[broadcast_dimensions.index(i)] if i in broadcast_dimensions else 1 for i in range(len(shape))]
    return np.broadcast_to(array.reshape(ones), shape)


def _sliced(
    array: np.ndarray,
    *,
    start_indices: tuple[int, ...],
    limit_indices: tuple[int, ...],
    strides: tuple[int, ...] | None,
    **_,
) -> np.ndarray:
    steps = strides or (1,) * array.ndim
    return array[tuple(map(slice, start_indices, limit_indices, steps))]


BY_NUMPY: dict[str, Callable] = {  # the same as in JAX, without compilation
    "broadcast_in_dim": _spread,
    "slice": _sliced,
    "concatenate": lambda *arrays, dimension: np.concatenate(arrays, dimension),
    "squeeze": lambda array, dimensions: np.squeeze(array, dimensions),
    "reshape": lambda array, new_sizes, **_: array.reshape(new_sizes),
    "transpose": lambda array, permutation: array.transpose(permutation),
}
MOVES = {*BY_NUMPY, "expand_dims", "rev", "pad", "split", "stack"}
INDEXED = {"gather": 1, "dynamic_slice": 1, "scatter": 1, "dynamic_update_slice": 2}  # arrays before the indices


def moved(primitive: Primitive, arrays: list[np.ndarray], parameters: dict) -> list[np.ndarray]:
    """The results of one of `MOVES`."""
    if primitive.name in BY_NUMPY:
        return [BY_NUMPY[primitive.name](*arrays, **parameters)]
    with jax.ensure_compile_time_eval():
        results = primitive.bind(*(jnp.asarray(array) for array in arrays), **parameters)
    return [np.asarray(array) for array in (results if isinstance(results, list | tuple) else [results])]


def indexed(line: ScalarNames, equation: JaxprEqn, arrays: list[np.ndarray]) -> np.ndarray:
    """The result of one of `INDEXED`, whose indices must be constants."""
    name, parameters = equation.primitive.name, equation.params
    if name == "gather":
        if (found := _gathered(line, equation, *arrays)) is not None:
            return found
        parameters = parameters | {"fill_value": -1}
    operands = []
    for i, array in enumerate(arrays):
        if i < INDEXED[name] or (name == "scatter" and i == 2):
            operands.append(jnp.asarray(array))
            continue
        values = [line.values[entry] for entry in array.ravel()]
        if any(v is None for v in values):
            raise UnsupportedError(f"{name} at a computed index is not supported")
        operands.append(jnp.asarray(np.array(values, int).reshape(array.shape), array_of(equation.invars[i]).dtype))
    with jax.ensure_compile_time_eval():
        result = np.asarray(equation.primitive.bind(*operands, **parameters))
    if (result < 0).any():
        raise UnsupportedError(f"{name} at an index outside the array is not supported")
    return result


def _gathered(line: ScalarNames, equation: JaxprEqn, array: np.ndarray, indices: np.ndarray) -> np.ndarray | None:
    """A gather at known indices inside the array, as rows of a matrix, without JAX; None for anything else."""
    numbers, sizes = equation.params["dimension_numbers"], equation.params["slice_sizes"]
    leading, values = indices.shape[:-1], [line.values[entry] for entry in indices.ravel()]
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
