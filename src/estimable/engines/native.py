"""Steps as machine code on a CPU: small models as a straight line of scalars, larger ones as operations on arrays."""

import math
import os
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import jax
import numpy as np

from .batches import DTYPES, on_all_processors, shaped, sizes, words
from .large import large_step
from .llvm.compilation import Compiled
from .llvm.scalar_loop import Array, ScalarLoop
from .lowering import Written, batch, entries_read, example, write
from .program.primitives import BOOL, FLOAT, INTEGER, UnsupportedError
from .time_varying import laid_out
from .xla import Run

LANES = 8  # runs side by side: two registers of AVX2, one of AVX-512
FEW = 64  # rows, in which nothing settles for long
CACHE = 2**19  # bytes that a processor has near
OFTEN = 0.1  # of the rows: a covariance has no time to settle between changes


def scan(algorithm: Any, prior: Any, samples: Any, intervals: Any, *, keep: str, select: Any) -> Run:
    """What `xla.scan` does, to rounding. Raises `UnsupportedError` where the step cannot be lowered."""
    one = [jax.tree_util.tree_map(lambda leaf: np.asarray(leaf)[None], part) for part in (samples, intervals)]
    run = scan_bank(algorithm, prior, *one, axes=(None, 0, None), keep=keep, select=select)
    return jax.tree_util.tree_map(lambda leaf: leaf[0], run)


def scan_bank(algorithm: Any, prior: Any, samples: Any, intervals: Any, *, axes: tuple, keep: str, select: Any) -> Run:
    """Many runs at once: of (algorithm, samples and intervals, prior) those with axis 0 have a leading batch axis."""
    algorithm, samples, intervals, axes = laid_out(algorithm, samples, intervals, axes)
    size, fixed, rows = batch(algorithm, prior, samples, intervals, axes)
    try:
        written = write(algorithm, prior, samples, intervals, axes=axes, keep=keep, select=select)
    except UnsupportedError:
        shapes = example(algorithm, prior, samples, intervals, axes)
        return large_step(*shapes, keep, select, _seldom_changes(rows)).run(size, words(fixed), rows)
    step = compiled_step(written, keep, LANES if size > 1 else 1, _seldom_changes(rows))
    return step.run(size, words(fixed), words(rows))


class NativeStep:
    """A compiled step: which scalars are read from where, and where they are written.

    One run reads and writes the arrays where they lie; runs side by side are laid out first, `lanes` words to a scalar.
    """

    def __init__(self, written: Written, keep: str, lanes: int, seek_steady: bool):
        self.start, self.keep, self.lanes, self.kept = _Start(written.start), keep, lanes, written.kept
        program = written.row
        outputs = written.outputs
        kept, said = _flat(outputs.kept), _flat((outputs.log_likelihood, outputs.outcome))
        if [program.operations[name].type for (name,) in said] != [FLOAT, INTEGER]:
            raise UnsupportedError("a log-likelihood that is no float, or an outcome that is no integer")
        self.shapes = jax.tree_util.tree_leaves(written.kept)
        each = [Array(*a) for a in zip(kept, (_kind(leaf.dtype) for leaf in self.shapes), strict=True)]
        each, told = each if keep != "last" else [], [Array(said[0]), Array(said[1], "i64")]
        self.each = [*each, *(array for array in told if array not in each)]
        self.told = [self.each.index(array) for array in told]
        self.at = np.cumsum([0, *(len(array.names) for array in self.each)])  # columns of each array side by side
        last = tuple(name for names in kept for name in names) if keep == "last" else ()
        self.last, self.alive = len(last), [entry.place for entry in written.carried]
        self.fixed, fixed_names = entries_read(program.inputs[: written.fixed])
        now, after = (tuple(getattr(entry, name) for entry in written.carried) for name in ("now", "after"))
        row, each = self._layout(program, program.inputs[written.fixed + written.states :])
        self.compiled = Compiled(ScalarLoop(program, fixed_names, now, row, after, each, last, seek_steady), lanes)

    def _layout(self, program: Any, inputs: tuple) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
        """The arrays of a row as they are, or those of several runs: one that is read and one that is written."""
        self.columns, names = entries_read(inputs)
        if self.lanes > 1:
            return (Array(names),), (Array(tuple(name for array in self.each for name in array.names)),)
        self.rows = sorted({i for i, _ in self.columns})
        read = [_flat(inputs)[i] for i in self.rows]
        types = [program.operations[max(names)].type for names in read]
        row = (Array(names, "i8" if type_ == BOOL else "double") for names, type_ in zip(read, types, strict=True))
        return tuple(row), tuple(self.each)

    def run(self, size: int, fixed: list, rows: list) -> Run:
        """Run all, `lanes` at a time side by side, the groups on all processors."""
        leaves = [leaf[None] if axis is None else leaf for leaf, axis in rows]
        T = leaves[0].shape[1]
        starts, constants = self.start.run(size, fixed)[:, self.alive], columns(fixed, self.fixed, size)
        each = [np.empty((size, T, len(array.names)), DTYPES[array.kind]) for array in self.each]
        last = np.empty((size, self.last))
        go = self._alone if self.lanes == 1 else self._side_by_side
        together = self.lanes * self._groups(T, size) if self.lanes > 1 else 1
        memory = each if self.lanes == 1 else [array.view(float) if array.dtype == int else array for array in each]
        on_all_processors(go(T, leaves, constants, starts, memory, last), range(0, size, together))
        log_likelihoods, outcomes = (each[i][..., 0] for i in self.told)
        failed_at = np.argmax(outcomes != 0, axis=1)
        kept = each[: len(self.shapes)] if self.keep != "last" else np.split(last, sizes(self.kept)[:-1], axis=-1)
        return Run(
            shaped(kept, self.kept), log_likelihoods.sum(axis=1), outcomes[np.arange(size), failed_at], failed_at, None
        )

    def _alone(self, T: int, leaves: list, constants, starts, each: list, last) -> Callable[[int], None]:
        """A function that runs one run."""
        read = [_contiguous(leaves[i]) for i in self.rows]

        def run(i: int) -> None:
            row = [leaf[i if len(leaf) > 1 else 0] for leaf in read]
            self.compiled(T, constants[i], starts[i].copy(), last[i], *row, *(array[i] for array in each))

        return run

    def _side_by_side(self, T: int, leaves: list, constants, starts, each: list, last) -> Callable[[int], None]:
        """A function that runs several groups of `lanes` runs from one run on, laid out together."""
        flat = [leaf.reshape(*leaf.shape[:2], math.prod(leaf.shape[2:])) for leaf in leaves]
        count = self._groups(T, len(starts))

        def run(first: int) -> None:
            runs, real = self.group(first, len(starts), count)
            row, wrote, end = (
                np.empty((count, *shape, self.lanes))
                for shape in ((T, len(self.columns)), (T, self.at[-1]), (self.last,))
            )
            for column, (i, j) in enumerate(self.columns):
                row[:, :, column] = self._apart(flat[i][runs, :, j]) if len(flat[i]) > 1 else flat[i][0, :, j, None]
            fixed, carry = (np.ascontiguousarray(self._apart(array[runs])) for array in (constants, starts))
            places = [(array.ctypes.data, array.strides[0]) for array in (fixed, carry, end, row, wrote)]
            for group in range(count):
                self.compiled.address(T, *(place + group * step for place, step in places))
            last[first : first + real] = self._together(end)[:real]
            for array, a, b in zip(each, self.at[:-1], self.at[1:], strict=True):
                for column in range(a, b):  # one at a time: NumPy then copies along the rows
                    array[first : first + real, :, column - a] = self._together(wrote[:, :, column])[:real]

        return run

    def _apart(self, runs: np.ndarray) -> np.ndarray:
        """(runs, entries) as (groups, entries, lanes)."""
        return runs.reshape(len(runs) // self.lanes, self.lanes, runs.shape[1]).swapaxes(1, 2)

    def _together(self, groups: np.ndarray) -> np.ndarray:
        """(groups, entries, lanes) as (runs, entries)."""
        return groups.swapaxes(1, 2).reshape(len(groups) * self.lanes, groups.shape[1])

    def _groups(self, T: int, size: int) -> int:
        """How many groups are laid out together: what stays in a processor's cache, and work for all processors."""
        bytes_each = 8 * self.lanes * T * (len(self.columns) + self.at[-1])
        return max(1, min(CACHE // bytes_each, -(-size // (self.lanes * (os.cpu_count() or 1)))))

    def group(self, first: int, size: int, count: int = 1) -> tuple[Any, int]:
        """The runs of `count` groups from `first` on, and how many are real: the last group repeats the last run."""
        lanes = count * self.lanes
        real = min(lanes, size - first)
        runs = np.minimum(np.arange(first, first + lanes), size - 1)
        return (slice(first, first + real) if real == lanes else runs), real


@lru_cache(256)
def compiled_step(written: Written, keep: str, lanes: int, seek_steady: bool = False) -> NativeStep:
    """The compiled step: nothing is compiled twice."""
    return NativeStep(written, keep, lanes, seek_steady)


def _seldom_changes(rows: list) -> bool:
    """Whether the rows are many and their bools (what was seen) seldom change: a steady state is then worth looking for."""
    leaf, axis = rows[0]
    if leaf.shape[0 if axis is None else 1] < FEW:
        return False
    bools = [leaf if axis == 0 else leaf[None] for leaf, axis in rows if leaf.dtype == bool]
    changes = [(t[:, 1:] != t[:, :-1]).any(axis=0) for t in bools]
    columns = [
        np.ascontiguousarray(c.reshape(len(c), -1).T) for c in changes
    ]  # along short rows NumPy takes 15 x as long
    return all(column.any(axis=0).mean() < OFTEN for column in columns)


class _Start:
    """`init` as machine code, one run a row."""

    def __init__(self, program: Any):
        self.places, names = entries_read(program.inputs)
        outputs = tuple(int(n) for array in program.outputs for n in array.ravel())
        self.size = len(outputs)
        self.compiled = Compiled(ScalarLoop(program, (), (), (Array(names),), (), (Array(outputs),), ()))

    def run(self, size: int, fixed: list) -> np.ndarray:
        """The first state of each run, flat: (size, entries)."""
        each, nothing = np.empty((size, self.size)), np.zeros(1)
        self.compiled(size, nothing, nothing, nothing, columns(fixed, self.places, size), each)
        return each


def _kind(dtype: Any) -> str:
    """How an array lies in memory."""
    return {"f": "double", "b": "i8"}.get(np.dtype(dtype).kind, "i64")


def _flat(arrays: tuple[np.ndarray, ...]) -> list[tuple[int, ...]]:
    """The scalars of each array."""
    return [tuple(int(name) for name in array.ravel()) for array in arrays]


def _contiguous(leaf: np.ndarray) -> np.ndarray:
    """Words and bools, row after row."""
    return np.ascontiguousarray(leaf, bool if leaf.dtype == bool else float)


def columns(leaves: list, places: list, size: int) -> np.ndarray:
    """The entries that are read of leaves with or without a batch axis: (size, entries)."""
    out = np.empty((size, len(places)))
    for column, (i, j) in enumerate(places):
        leaf, axis = leaves[i]
        out[:, column] = leaf.ravel()[j] if axis is None else leaf.reshape(size, -1)[:, j]
    return out
