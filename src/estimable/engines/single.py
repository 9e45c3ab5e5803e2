"""One step at a time as machine code, for loops in Python: memory and its addresses stay from call to call."""

import ctypes
from collections.abc import Callable
from functools import lru_cache, partial
from itertools import pairwise
from typing import Any

import jax
import numpy as np

from .llvm import Compiled
from .loops import Array, Loop
from .straight_line import UnsupportedError, lower


class Step:
    """`function(fixed, state, *inputs)`, which gives a state and what is told of it, at fixed places in memory.

    Write `inputs` (arrays), call, and read `next` (the flat state that comes out) and `told` (flat); `take` reads the state
    of another step. Raises `UnsupportedError` where the function has no straight line.
    """

    def __init__(self, function: Callable, fixed: Any, state: Any, *inputs: Any):
        leaves, structure = jax.tree_util.tree_flatten((fixed, state, inputs))
        shapes = tuple((np.shape(leaf), np.asarray(leaf).dtype.str) for leaf in leaves)
        code = _code(function, structure, shapes)
        if isinstance(code, UnsupportedError):
            raise code
        flat, numbers = _flat(state), [_flat(array) for array in inputs]
        self.memory = np.concatenate([flat, *numbers])
        self.state, self._state_of = self.memory[: len(flat)], code.state
        bounds = np.cumsum([len(flat), *map(len, numbers)])
        self.inputs = [self.memory[a:b] for a, b in pairwise(bounds)]
        out = np.empty(code.size)
        self.next, self.told = out[: code.states], out[code.states :]
        self.tell = code.tell
        self._kept = _flat(fixed), np.zeros(1), out, code
        places = (self._kept[0], self._kept[1], self._kept[1], self.memory, out)
        self.run = partial(code.compiled.address, 1, *(ctypes.c_void_p(array.ctypes.data) for array in places))
        self.after: dict[str, Step] = {}

    def next_state(self) -> Any:
        """The state that came out, as the arrays it is."""
        return self._state_of(self.next.copy())


class _Code:
    """The machine code of a step, and how its flat outputs are read."""

    def __init__(self, function: Callable, structure: Any, shapes: tuple):
        fixed, state, inputs = jax.tree_util.tree_unflatten(structure, [np.zeros(*shape) for shape in shapes])
        state_out, told = jax.eval_shape(function, fixed, state, *inputs)
        program = lower(lambda *arguments: jax.tree_util.tree_leaves(function(*arguments)), fixed, state, *inputs)
        count = len(jax.tree_util.tree_leaves(fixed))
        names = [tuple(int(name) for array in arrays for name in array.ravel())
                 for arrays in (program.inputs[:count], program.inputs[count:], program.outputs)]  # fmt: skip
        self.compiled = Compiled(Loop(program, names[0], (), (Array(names[1]),), (), (Array(names[2]),), ()))
        self.size, self.states = (
            len(names[2]),
            sum(int(np.prod(leaf.shape)) for leaf in jax.tree_util.tree_leaves(state_out)),
        )
        self.state, self.tell = _reader(state_out), _reader(told)


@lru_cache(256)
def _code(*arguments: Any) -> _Code | UnsupportedError:
    """The code of a step, or why there is none: neither is worked out twice."""
    try:
        return _Code(*arguments)
    except UnsupportedError as reason:
        return reason


def _flat(tree: Any) -> np.ndarray:
    leaves = [np.ravel(np.asarray(leaf, float)) for leaf in jax.tree_util.tree_leaves(tree)]
    return np.concatenate(leaves) if leaves else np.empty(0)


def _reader(shapes: Any) -> Callable[[np.ndarray], Any]:
    """A function from a flat array to these shapes."""
    leaves, structure = jax.tree_util.tree_flatten(shapes)
    bounds = np.cumsum([0, *(int(np.prod(leaf.shape)) for leaf in leaves)])

    def read(flat: np.ndarray) -> Any:
        parts = [
            flat[a:b].reshape(leaf.shape).astype(leaf.dtype, copy=False)
            for a, b, leaf in zip(bounds[:-1], bounds[1:], leaves, strict=True)
        ]
        return jax.tree_util.tree_unflatten(structure, parts)

    return read
