"""Two alternating steps as machine code: one runs forwards over a block of rows, one backwards over it for the next block.

The output of the forward step for a row is a row of the backward step. The output of the backward step for it enters the
forward step at the same place in the next block. So a loop, whose rows come one at a time, can look back over a block.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np

from ..annotations import Tree
from .batches import on_all_processors, shaped, sizes, words
from .llvm.scalar_loop import RowArray
from .lowering import batch, entries_read, write
from .native import LANES, NativeStep, columns, compiled_step, side_by_side
from .program.straight_line import Program
from .xla import Run


class Way(NamedTuple):
    """One of the two steps, and the argument of its `init`."""

    algorithm: Any
    prior: Any


def scan_bank(
    forward: Way,
    backward: Way,
    rows: Tree,
    intervals: Tree,
    *,
    begin: Tree,
    length: int,
    select: Callable[[Any, str], tuple[Tree, tuple[Tree, Tree]]],
) -> Run:
    """Run a bank whose rows have a leading axis of runs, in blocks of `length`.

    `rows` has a field `begin`: the numbers of the argument in the first block, (length, ..), and the outputs of the backward
    step in later ones. `select(info, keep)` returns (the selected outputs, (sample, interval) of the backward step). Raises
    `UnsupportedError` where a step cannot be lowered.
    """
    axes = (None, 0, None)
    written = write(forward.algorithm, forward.prior, rows, intervals, axes=axes, keep="all", select=select)
    kept, passed = written.kept
    example = jax.tree_util.tree_map(lambda leaf: np.zeros((1, 1, *leaf.shape), leaf.dtype), passed)
    back = write(backward.algorithm, backward.prior, example[0], example[1], axes=axes, keep="all", select=_as_it_is)
    ahead, behind = (compiled_step(one, "all", LANES, kind=_Together) for one in (written, back))
    size, *parts = batch(forward.algorithm, forward.prior, rows, intervals, axes)
    fixed, leaves = map(words, parts)
    memory = _Memory(ahead, behind, rows, leaves, _width(kept), begin)
    T = leaves[0][0].shape[1]
    own = words(batch(backward.algorithm, backward.prior, example[0], example[1], axes)[1])
    constants, carry = side_by_side(columns(fixed, ahead.fixed, size), LANES), ahead.begin(size, fixed)
    still, start = side_by_side(columns(own, behind.fixed, 1), LANES)[0], behind.begin(1, own)[0]
    each = np.empty((size, T, _width(kept)))

    def run(group: int) -> None:
        first = group * LANES
        real = min(LANES, size - first)
        runs = np.minimum(np.arange(first, first + LANES), size - 1)
        wrote = memory.run(runs, T, length, (constants[group], carry[group]), (still, start))
        each[first : first + real] = wrote[:, : each.shape[2]].transpose(2, 0, 1)[:real]

    on_all_processors(run, range(len(carry)))
    _, code, failed_at = ahead.end(carry, size)
    return Run(shaped(np.split(each, sizes(kept)[:-1], axis=-1), kept), None, code, failed_at, None)


def _as_it_is(info: Any, keep: str) -> Any:
    return info.kept


def _width(shapes: Tree) -> int:
    return sum(int(np.prod(leaf.shape)) for leaf in jax.tree_util.tree_leaves(shapes))


def _offsets(shapes: list) -> np.ndarray:
    """The start of each array among flat columns."""
    return np.cumsum([0, *(int(np.prod(shape)) for shape in shapes)])


class _Together(NativeStep):
    """A step with interleaved runs, `LANES` words per scalar: one array is read and one is written."""

    apart = False

    def _layout(self, program: Program, inputs: tuple) -> tuple[tuple[RowArray, ...], tuple[RowArray, ...]]:
        self.columns, names = entries_read(inputs)
        self.at = np.cumsum([0, *(len(array.names) for array in self.each)])  # columns of each array side by side
        return (RowArray(names),), (RowArray(tuple(name for array in self.each for name in array.names)),)


class _Memory:
    """The columns that the two steps exchange."""

    def __init__(self, ahead: _Together, behind: _Together, rows: Tree, leaves: list, kept: int, begin: Tree):
        self.ahead, self.behind = ahead, behind
        self.leaves = [leaf.reshape(*leaf.shape[:2], -1) for leaf, _ in leaves]
        passed = _offsets([leaf.shape for leaf in jax.tree_util.tree_leaves(ahead.kept[1])])
        self.passed = [kept + passed[i] + j for i, j in behind.columns]  # columns of `ahead` that `behind` reads
        begun = [leaf for leaf, _ in words([(np.asarray(leaf), None) for leaf in jax.tree_util.tree_leaves(begin)])]
        first = [path[0].name for path, _ in jax.tree_util.tree_flatten_with_path(rows)[0]].index("begin")
        starts = _offsets([leaf.shape[1:] for leaf in begun])
        inside = [(column, i - first, j) for column, (i, j) in enumerate(ahead.columns) if 0 <= i - first < len(begun)]
        self.into = [column for column, _, _ in inside]  # columns of `ahead` that `behind` supplies
        self.out_of = [starts[i] + j for _, i, j in inside]
        self.begin = np.stack([begun[i].reshape(len(begun[i]), -1)[:, j] for _, i, j in inside], axis=1)

    def run(self, runs: np.ndarray, T: int, length: int, forward: tuple, backward: tuple) -> np.ndarray:
        """The outputs of the forward step for a group of runs, (T, columns, lanes)."""
        row, nothing = self._rows(runs, T), np.zeros(1)
        wrote = np.empty((T, self.ahead.at[-1], LANES))
        written = np.empty((length, self.behind.at[-1], LANES))
        row[:length, self.into] = self.begin[:T, :, None]
        for start in range(0, T, length):
            stop = min(start + length, T)
            self.ahead.compiled(stop - start, *forward, nothing, row[start:stop], wrote[start:stop])
            if stop == T:
                break
            turned = np.ascontiguousarray(wrote[start:stop][::-1, self.passed])
            still, begin = backward
            self.behind.compiled(length, still, begin.copy(), nothing, turned, written)
            row[stop : stop + length, self.into] = written[::-1, self.out_of][: T - stop]
        return wrote

    def _rows(self, runs: np.ndarray, T: int) -> np.ndarray:
        row = np.empty((T, len(self.ahead.columns), LANES))
        for column, (i, j) in enumerate(self.ahead.columns):
            if column not in self.into:
                row[:, column] = self.leaves[i][runs, :, j].T
        return row
