"""Steps as machine code on a CPU: small models as a straight line of scalars, larger ones as operations on arrays."""

import os
from functools import lru_cache
from typing import Any

import jax
import numpy as np

from ..annotations import Tree
from .batches import DTYPES, on_all_processors, shaped, sizes, words
from .llvm.compilation import Compiled
from .llvm.scalar_loop import RowArray, ScalarLoop
from .lowering import Written, batch, entries_read, example, write, zero_arrays
from .program.primitives import BOOL, UnsupportedError
from .program.straight_line import Program
from .program.totals import COUNTS, totalled
from .step import Samples, Select, Stepping, Use
from .time_varying import laid_out
from .xla import Run

LANES = 8  # runs side by side: two registers of AVX2, one of AVX-512
FEW = 64  # rows, too few for a steady state to pay
BLOCK = 2**23  # numbers of the outputs of a bank in memory at a time, where they are used in blocks: 64 MB
COPIED = 2_000  # rows that are copied at a time
SHARES = 4  # of the runs per processor, so that none waits long for the others
OFTEN = 0.1  # of the rows: a covariance has no time to settle between changes


def scan(algorithm: Stepping, prior: Tree, samples: Samples, intervals: Tree, *, keep: str, select: Select) -> Run:
    """Equals `xla.scan` to rounding. Raises `UnsupportedError` where the step cannot be lowered."""
    one = [jax.tree_util.tree_map(lambda leaf: np.asarray(leaf)[None], part) for part in (samples, intervals)]
    run = scan_bank(algorithm, prior, *one, axes=(None, 0, None), keep=keep, select=select)
    return jax.tree_util.tree_map(lambda leaf: leaf[0], run)


def scan_bank(
    algorithm: Stepping, prior: Tree, samples: Samples, intervals: Tree, *, axes: tuple, keep: str, select: Select
) -> Run:
    """Many runs at once: those of (algorithm, samples and intervals, prior) with axis 0 have a leading batch axis."""
    algorithm, samples, intervals, axes = laid_out(algorithm, samples, intervals, axes)
    size, fixed, rows = batch(algorithm, prior, samples, intervals, axes)
    try:
        written = write(algorithm, prior, samples, intervals, axes=axes, keep=keep, select=select)
    except UnsupportedError:
        return _of_arrays(example(algorithm, prior, samples, intervals, axes), keep, select, size, fixed, rows)
    step = compiled_step(written, keep, LANES if size > 1 else 1, _seldom_changes(rows))
    return step.run(size, words(fixed), words(rows))


def _of_arrays(shapes: tuple[Any, tuple], keep: str, select: Select, size: int, fixed: list, rows: list) -> Run:
    """The run of a step with operations on arrays, which most models do not need."""
    from .large import large_step

    return large_step(*shapes, keep, select, _seldom_changes(rows)).run(size, words(fixed), rows)


def scan_in_blocks(
    algorithm: Stepping,
    prior: Tree,
    samples: Samples,
    intervals: Tree,
    *,
    axes: tuple,
    keep: str,
    select: Select,
    use: Use,
) -> Run:
    """`scan_bank` for a few runs of many rows: `use(outputs, first row)` takes the outputs of each block of rows.

    One program serves every number of runs and rows: numbers are constants in it only where whole arrays of them are zero.
    """
    algorithm, samples, intervals, axes = laid_out(algorithm, samples, intervals, axes)
    size, fixed, rows = batch(algorithm, prior, samples, intervals, axes)
    zeros = zero_arrays(algorithm, axes[0])
    try:
        written = write(algorithm, prior, samples, intervals, axes=axes, keep=keep, select=select, zeros=zeros)
    except UnsupportedError:
        run = _of_arrays(example(algorithm, prior, samples, intervals, axes), keep, select, size, fixed, rows)
        use(run.info, 0)
        return run._replace(info=None)
    step = compiled_step(written, keep, LANES, _seldom_changes(rows))
    at_once = max(1, BLOCK // (size * int(sizes(step.kept)[-1])))
    return step.run_in_blocks(size, words(fixed), words(rows), at_once, use)


class NativeStep:
    """A compiled step: the sources of its scalars, and the places they are written to.

    Runs read and write the arrays in place, one by one or `lanes` words side by side.
    """

    apart = True  # runs side by side have separate arrays

    def __init__(self, written: Written, keep: str, lanes: int, seek_steady: bool):
        self.start, self.keep, self.lanes, self.kept = _Start(written.start), keep, lanes, written.kept
        outputs = written.outputs
        program, *totals = totalled(written.row, int(outputs.log_likelihood), int(outputs.outcome))
        kept = _flat(outputs.kept)
        kinds = [_kind(leaf.dtype) for leaf in jax.tree_util.tree_leaves(written.kept)]
        self.each = [RowArray(*array) for array in zip(kept, kinds, strict=True)] if keep != "last" else []
        last = tuple(name for names in kept for name in names) if keep == "last" else ()
        self.last, self.alive = len(last), [entry.place for entry in written.carried]
        self.fixed, fixed_names = entries_read(program.inputs[: written.fixed])
        now, after = (tuple(getattr(entry, name) for entry in written.carried) for name in ("now", "after"))
        row, each = self._layout(program, program.inputs[written.fixed + written.states :])
        now, after = (*now, *totals[0]), (*after, *totals[1])
        apart = self.apart and lanes > 1
        loop = ScalarLoop(program, fixed_names, now, row, after, each, last, seek_steady, apart, COUNTS)
        self.compiled = Compiled(loop, lanes)

    def _layout(self, program: Program, inputs: tuple) -> tuple[tuple[RowArray, ...], tuple[RowArray, ...]]:
        """The arrays read and written for a row, with their layout in memory."""
        self.rows = sorted({i for i, _ in entries_read(inputs)[0]})
        read = [_flat(inputs)[i] for i in self.rows]
        types = [program.operations[max(names)].type for names in read]
        row = (RowArray(names, "i8" if type_ == BOOL else "double") for names, type_ in zip(read, types, strict=True))
        return tuple(row), tuple(self.each)

    def run(self, size: int, fixed: list, rows: list) -> Run:
        """Run all, `lanes` at a time side by side, on all processors."""
        blocks: list[Any] = []
        run = self.run_in_blocks(size, fixed, rows, _rows_of(rows), lambda kept, first: blocks.append(kept))
        return run._replace(info=blocks[0])

    def run_in_blocks(self, size: int, fixed: list, rows: list, at_once: int, use: Use) -> Run:
        """Run all; `use(outputs, first row)` takes the outputs of each block of rows. They are not in the result."""
        leaves, T = [leaf[None] if axis is None else leaf for leaf, axis in rows], _rows_of(rows)
        constants, carry = side_by_side(columns(fixed, self.fixed, size), self.lanes), self.begin(size, fixed)
        last = np.empty((len(carry), self.last, self.lanes))
        for first in range(0, T, at_once):
            count = min(at_once, T - first)
            each = [np.empty((size, count, len(array.names)), DTYPES[array.kind]) for array in self.each]
            read = [leaves[i][:, first : first + count] for i in self.rows]
            self._run(count, size, [constants, carry, last], read, each)
            kept = each if self.keep != "last" else np.split(one_by_one(last, size), sizes(self.kept)[:-1], axis=-1)
            use(shaped(kept, self.kept), first)
        return Run(None, *self.end(carry, size), None)

    def begin(self, size: int, fixed: list) -> np.ndarray:
        """The carry into the first row of each run, in groups side by side: the state and the totals."""
        carry = np.zeros((size, len(self.alive) + COUNTS))
        carry[:, : len(self.alive)] = self.start.run(size, fixed)[:, self.alive]
        return side_by_side(carry, self.lanes)

    def end(self, carry: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The log-likelihood of each run, the code of its first failure, and the row of it (0 where there is none)."""
        total, _, *counts = one_by_one(carry[:, len(self.alive) :], size).T
        code, before = (np.ascontiguousarray(words).view(int) for words in counts)
        return total.copy(), code, np.where(code != 0, before, 0)

    def _run(self, T: int, size: int, groups: list[np.ndarray], read: list, each: list[np.ndarray]) -> None:
        """Run all; the rows that are read have an axis of runs, of length one where all share them."""
        if self.lanes == 1:
            self._run_one(T, [array[0] for array in groups], [leaf[0] for leaf in read], [array[0] for array in each])
            return
        rows = [*map(_contiguous, read), *each]
        steps = np.array([array.strides[0] if len(array) > 1 else 0 for array in rows])
        places = [array.ctypes.data for array in (steps, *groups, *rows)]
        count = len(groups[0])
        at_once = -(-count // (SHARES * (os.cpu_count() or 1)))
        on_all_processors(
            lambda begin: self.compiled.address(T, begin, min(begin + at_once, count), size - 1, *places),
            range(0, count, at_once),
        )

    def _run_one(self, T: int, groups: list[np.ndarray], read: list[np.ndarray], each: list[np.ndarray]) -> None:
        """Run one; rows that must be copied are copied in parts, into memory that is used again."""
        in_place = all(leaf.flags.c_contiguous and leaf.dtype in (bool, float) for leaf in read)
        at_once = T if in_place else COPIED
        for first in range(0, T, at_once):
            part = slice(first, first + at_once)
            rows = [*(_contiguous(leaf[part]) for leaf in read), *(array[part] for array in each)]
            self.compiled(min(at_once, T - first), *groups, *rows)


@lru_cache(256)
def compiled_step(
    written: Written, keep: str, lanes: int, seek_steady: bool = False, kind: type[NativeStep] = NativeStep
) -> Any:
    """The compiled step, cached."""
    return kind(written, keep, lanes, seek_steady)


def _seldom_changes(rows: list) -> bool:
    """Whether the rows are many and their bools (what was seen) seldom change: a steady state is then worth looking for."""
    if _rows_of(rows) < FEW:
        return False
    bools = [leaf if axis == 0 else leaf[None] for leaf, axis in rows if leaf.dtype == bool and not leaf.all()]
    changes = [(t[:, 1:] != t[:, :-1]).any(axis=0) for t in bools]
    columns = [
        np.ascontiguousarray(c.reshape(len(c), -1).T) for c in changes
    ]  # along short rows NumPy takes 15 x as long
    return all(column.any(axis=0).mean() < OFTEN for column in columns)


class _Start:
    """`init` as machine code, one run a row."""

    def __init__(self, program: Program):
        self.places, names = entries_read(program.inputs)
        outputs = tuple(int(n) for array in program.outputs for n in array.ravel())
        self.size = len(outputs)
        self.compiled = Compiled(ScalarLoop(program, (), (), (RowArray(names),), (), (RowArray(outputs),), ()))

    def run(self, size: int, fixed: list) -> np.ndarray:
        """The first state of each run, flat: (size, entries)."""
        each, nothing = np.empty((size, self.size)), np.zeros(1)
        self.compiled(size, nothing, nothing, nothing, columns(fixed, self.places, size), each)
        return each


def _rows_of(rows: list) -> int:
    """The number of rows."""
    leaf, axis = rows[0]
    return leaf.shape[0 if axis is None else 1]


def _kind(dtype: np.dtype) -> str:
    """The type of an array in memory."""
    return {"f": "double", "b": "i8"}.get(np.dtype(dtype).kind, "i64")


def _flat(arrays: tuple[np.ndarray, ...]) -> list[tuple[int, ...]]:
    """The scalars of each array."""
    return [tuple(int(name) for name in array.ravel()) for array in arrays]


def _contiguous(leaf: np.ndarray) -> np.ndarray:
    """Words and bools, row after row."""
    return np.ascontiguousarray(leaf, bool if leaf.dtype == bool else float)


def columns(leaves: list, places: list, size: int) -> np.ndarray:
    """The entries read from leaves with or without a batch axis: (size, entries)."""
    out = np.empty((size, len(places)))
    for column, (i, j) in enumerate(places):
        leaf, axis = leaves[i]
        out[:, column] = leaf.ravel()[j] if axis is None else leaf.reshape(size, -1)[:, j]
    return out


def side_by_side(runs: np.ndarray, lanes: int) -> np.ndarray:
    """(runs, entries) as (groups, entries, lanes); the last group repeats the last run."""
    count = -(-len(runs) // lanes)
    padded = runs if len(runs) == count * lanes else runs[np.minimum(np.arange(count * lanes), len(runs) - 1)]
    return np.ascontiguousarray(padded.reshape(count, lanes, runs.shape[1]).swapaxes(1, 2))


def one_by_one(groups: np.ndarray, size: int) -> np.ndarray:
    """(groups, entries, lanes) as (runs, entries)."""
    count, entries, lanes = groups.shape
    return groups.swapaxes(1, 2).reshape(count * lanes, entries)[:size]
