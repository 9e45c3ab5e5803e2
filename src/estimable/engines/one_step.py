"""One step at a time as machine code, for loops in Python: memory and its addresses are reused in every call."""

import ctypes
from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from itertools import pairwise
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from ..annotations import Array, Tree
from .batches import words
from .disk_cache import once
from .llvm.array_loop import ArrayLoop
from .llvm.compilation import OneRow
from .llvm.scalar_loop import RowArray, ScalarLoop
from .program.arrays import lower
from .program.primitives import UnsupportedError
from .program.straight_line import Program, lower_jaxpr


class Place:
    """A state in memory: `flat`, with the `form` of its tree; and the steps that start here, by name."""

    def __init__(self, state: Tree):
        self.form = form_of(state)
        self.flat = np.zeros(_size(self.form))
        self.after: dict[str, Step] = {}

    @property
    def state(self) -> Any:
        """The current state, as arrays."""
        return reader(self.form)(self.flat.tobytes())


class Step:
    """A step from one place to another.

    Write `inputs` (flat arrays) and call `run()`: it reads the state `here`, writes the state `there` and the `report` (flat),
    and returns the code of the function. `fixed` may be written too. Raises `ValueError` where both places are the same.
    """

    def __init__(self, code: "Code", fixed: np.ndarray, here: Place, there: Place):
        if here is there:
            raise ValueError("a step reads one state while it writes the next: the two must be in different places")
        self.there, self.fields = there, code.fields
        bounds = np.cumsum([0, *code.inputs])
        memory, self.report = np.zeros(bounds[-1]), np.zeros(code.report)
        self.inputs = [memory[a:b] for a, b in pairwise(bounds)]
        arrays = fixed, here.flat, memory, there.flat, self.report
        places = np.array([array.ctypes.data for array in arrays])
        self._kept = arrays, places, code
        self.run = partial(code.compiled.address, ctypes.c_void_p(places.ctypes.data))


class Code:
    """The machine code of a step, the form of the next state, and the reader of each field of the report."""

    def __init__(self, step: "Lowered"):
        self.next, self.inputs, self.report = step.next, step.inputs, _size(step.report) + 1
        self.fields = {name: reader(form, at) for name, form, at in _placed(vars(step.report))}
        self.compiled = OneRow(step.loop, self.report - 1)


def _of_scalars(program: Program, fixed: Tree, state: Tree, following: Tree) -> ScalarLoop:
    """The step as a straight line of scalars."""
    counts = np.cumsum([len(jax.tree_util.tree_leaves(part)) for part in (fixed, state)])
    read = [_names(part) for part in _split(program.inputs, *counts)]
    written = [_names(part) for part in _split(program.outputs, len(jax.tree_util.tree_leaves(following)))]
    row, each = map(RowArray, read[1:]), map(RowArray, written)
    return ScalarLoop(program, read[0], (), tuple(row), (), tuple(each), ())


def _of_arrays(function: Callable, *parts: Tree) -> ArrayLoop:
    """The step as operations on arrays; the arrays of each part are contiguous."""

    def run(*memories: Array):
        following, *report = function(*(_unpacked(part, m) for part, m in zip(parts[:2], memories, strict=False)),
                                    *_unpacked(parts[2], memories[2]))  # fmt: skip
        return _packed(following), _packed(report)

    return ArrayLoop(lower(jax.make_jaxpr(run)(*(np.zeros(_size(part)) for part in parts))), None, 1, 0, 2)


def _packed(tree: Tree) -> Any:
    """All of a tree as words, inside JAX."""
    return jnp.concatenate([_word(jnp.ravel(leaf)) for leaf in jax.tree_util.tree_leaves(tree)])


def _word(leaf: Array) -> Any:
    integers = jnp.issubdtype(leaf.dtype, jnp.integer)
    return lax.bitcast_convert_type(leaf.astype(int), jnp.dtype(float)) if integers else leaf.astype(float)


def _unpacked(form: Tree, memory: Array) -> Any:
    """A tree of this form from its words, inside JAX."""
    leaves, structure = jax.tree_util.tree_flatten(form)
    parts = _split(memory, *np.cumsum([_size(leaf) for leaf in leaves])[:-1].tolist()) if leaves else []
    shaped = [_entry(part.reshape(leaf.shape), leaf.dtype) for part, leaf in zip(parts, leaves, strict=True)]
    return jax.tree_util.tree_unflatten(structure, shaped)


def _entry(word: Array, dtype: np.dtype) -> Any:
    held = jnp.issubdtype(dtype, jnp.integer)
    return (lax.bitcast_convert_type(word, jnp.dtype(int)) if held else word).astype(dtype)


class Lowered(NamedTuple):
    """A step as a program: the forms of the next state and of the report, and the sizes of the inputs."""

    next: Any
    report: Any
    inputs: list[int]
    loop: ScalarLoop | ArrayLoop


def code_of(function: Callable, fixed: Tree, state: Tree, *inputs: Tree) -> Code:
    """The code of `function(fixed, state, *inputs)`, which returns the next state, a report and a code.

    Raises `UnsupportedError` where the function has no machine code.
    """
    leaves, structure = jax.tree_util.tree_flatten((fixed, state, *inputs))
    code = _code(function, structure, tuple((leaf.shape, leaf.dtype.str) for leaf in map(form_of, leaves)))
    if isinstance(code, UnsupportedError):
        raise UnsupportedError(*code.args)
    return code


@lru_cache(256)
def _code(*arguments: Any) -> Code | UnsupportedError:
    """The code of a step, or the reason why there is none, cached."""
    step = once(attempt, *arguments)
    return step if isinstance(step, UnsupportedError) else Code(step)


def attempt(function: Callable, structure: Any, shapes: tuple) -> Lowered | UnsupportedError:
    """The program of a step, of scalars or else of arrays, or the reason why there is none."""
    fixed, state, *inputs = jax.tree_util.tree_unflatten(structure, [np.zeros(*shape) for shape in shapes])
    traced, (after, report, _) = jax.make_jaxpr(function, return_shape=True)(fixed, state, *inputs)
    forms = form_of(after), form_of(report), [_size(part) for part in inputs]
    try:
        return Lowered(*forms, _of_scalars(lower_jaxpr(traced), fixed, state, after))
    except UnsupportedError:
        pass
    try:
        return Lowered(*forms, _of_arrays(function, form_of(fixed), form_of(state), form_of(inputs)))
    except UnsupportedError as reason:
        return UnsupportedError(*reason.args)  # without the frames that the reason has passed


def flat(tree: Tree) -> np.ndarray:
    """All of a tree, as words."""
    leaves = words([(np.ravel(np.asarray(leaf)), None) for leaf in jax.tree_util.tree_leaves(tree)])
    return np.concatenate([leaf for leaf, _ in leaves], dtype=float) if leaves else np.empty(0)


def form_of(tree: Tree) -> Any:
    """A tree with shapes and types instead of its arrays."""
    return jax.tree_util.tree_map(
        lambda leaf: jax.ShapeDtypeStruct(np.shape(leaf), getattr(leaf, "dtype", np.asarray(leaf).dtype)), tree
    )


def reader(form: Tree, at: int = 0) -> Callable[[bytes], Any]:
    """A function from memory to arrays of this form; the first begins at word `at`."""
    leaves, structure = jax.tree_util.tree_flatten(form)
    starts = np.cumsum([at, *map(_size, leaves)]).tolist()
    each = [_array_reader(leaf, start) for leaf, start in zip(leaves, starts, strict=False)]
    if isinstance(form, jax.ShapeDtypeStruct):
        return each[0]
    return lambda memory: jax.tree_util.tree_unflatten(structure, [read(memory) for read in each])


def _array_reader(form: jax.ShapeDtypeStruct, at: int) -> Callable[[bytes], np.ndarray]:
    shape, at = form.shape, at * np.dtype(float).itemsize
    if form.dtype == float:
        return lambda memory: np.ndarray(shape, float, memory, at)
    held = int if np.dtype(form.dtype).kind in "iu" else float
    return lambda memory: np.ndarray(shape, held, memory, at).astype(form.dtype)


def _placed(fields: dict[str, Any]) -> list[tuple[str, Any, int]]:
    """The fields, and the number at which each begins."""
    starts = np.cumsum([0, *map(_size, fields.values())]).tolist()
    return [(name, form, at) for (name, form), at in zip(fields.items(), starts, strict=False)]


def _size(form: Tree) -> int:
    """The number of entries of a tree."""
    return sum(int(np.prod(np.shape(leaf))) for leaf in jax.tree_util.tree_leaves(form))


def _names(arrays: Sequence[np.ndarray]) -> tuple[int, ...]:
    """The scalars of these arrays."""
    return tuple(int(name) for array in arrays for name in array.ravel())


def _split(items: Any, *bounds: int) -> list[Any]:
    """The items before, between and after the bounds."""
    return [items[a:b] for a, b in pairwise((0, *bounds, len(items)))]
