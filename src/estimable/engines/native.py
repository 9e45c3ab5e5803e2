"""Steps as machine code: for models that do not vary in time and are small enough to be written out, on a CPU."""

import math
import os
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import Any

import jax
import numpy as np

from .llvm import Compiled, Loop
from .written import Written, batch, entries_read, write
from .xla import Run

LANES = 8  # runs side by side: two registers of AVX2, one of AVX-512


def scan(algorithm: Any, prior: Any, samples: Any, intervals: Any, *, keep: str, select: Any) -> Run:
    """What `xla.scan` does, to rounding. Raises `UnsupportedError` where the step cannot be written out."""
    one = [jax.tree_util.tree_map(lambda leaf: np.asarray(leaf)[None], part) for part in (samples, intervals)]
    run = scan_bank(algorithm, prior, *one, axes=(None, 0, None), keep=keep, select=select)
    return jax.tree_util.tree_map(lambda leaf: leaf[0], run)


def scan_bank(algorithm: Any, prior: Any, samples: Any, intervals: Any, *, axes: tuple, keep: str, select: Any) -> Run:
    """Many runs at once: of (algorithm, samples and intervals, prior) those with axis 0 have a leading batch axis."""
    written = write(algorithm, prior, samples, intervals, axes=axes, keep=keep, select=select)
    size, fixed, rows = batch(algorithm, prior, samples, intervals, axes)
    return compiled_step(written, keep, LANES if size > 1 else 1).run(size, fixed, rows)


class Step:
    """A compiled step: where its inputs are read from, and what its outputs are."""

    def __init__(self, written: Written, keep: str, lanes: int):
        """Say which scalars are read from where and written to where, and compile."""
        self.start, self.keep, self.lanes, self.kept = _Start(written.start), keep, lanes, written.kept
        program, before = written.row, written.fixed + written.states
        kept, told = ([int(n) for array in arrays for n in array.ravel()]
                      for arrays in (program.outputs[written.states : -2], program.outputs[-2:]))  # fmt: skip
        self.fixed, fixed_names = entries_read(program.inputs[: written.fixed])
        self.rows, row_names = entries_read(program.inputs[before:])
        carried = written.carried
        self.alive = [entry.place for entry in carried]
        each, last = (told, kept) if keep == "last" else (kept + told, [])
        self.each, self.last = len(each), len(last)
        carry, next_carry = tuple(entry.now for entry in carried), tuple(entry.after for entry in carried)
        loop = Loop(program, fixed_names, carry, row_names, next_carry, tuple(each), tuple(last))
        self.compiled = Compiled(loop, lanes)

    def run(self, size: int, fixed: list, rows: list) -> Run:
        """Run all, `lanes` at a time side by side, the groups on all processors."""
        shared = all(axis is None for _, axis in rows)
        T = rows[0][0].shape[0 if shared else 1]
        starts = self.start.run(size, fixed)[:, self.alive]
        constants = columns(fixed, self.fixed, size)
        leaves = [
            leaf.reshape(1 if shared else size, T, math.prod(leaf.shape[1 if shared else 2 :])) for leaf, _ in rows
        ]
        each, last = np.empty((size, T, self.each)), np.empty((size, self.last))

        def alone(run: int) -> None:
            row = np.empty((T, len(self.rows)))
            for column, (i, j) in enumerate(self.rows):
                row[:, column] = leaves[i][0 if shared else run, :, j]
            self.compiled(T, constants[run], starts[run].copy(), row, each[run], last[run])

        def side_by_side(first: int) -> None:
            runs, real = self.group(first, size)
            row = np.empty((T, len(self.rows), self.lanes))
            for column, (i, j) in enumerate(self.rows):
                row[:, column] = leaves[i][0, :, j, None] if shared else leaves[i][runs, :, j].T
            wrote, end = np.empty((T, self.each, self.lanes)), np.empty((self.last, self.lanes))
            self.compiled(T, constants[runs].T.copy(), starts[runs].T.copy(), row, wrote, end)
            each[first : first + real], last[first : first + real] = wrote.transpose(2, 0, 1)[:real], end.T[:real]

        on_all_processors(alone if self.lanes == 1 else side_by_side, range(0, size, self.lanes))
        outcomes = each[..., -1].astype(int)
        failed_at = np.argmax(outcomes != 0, axis=1)
        kept = shaped(last if self.keep == "last" else each, self.kept)
        return Run(kept, each[..., -2].sum(axis=1), outcomes[np.arange(size), failed_at], failed_at, None)

    def group(self, first: int, size: int) -> tuple[Any, int]:
        """The runs that go side by side from `first` on, and how many are real: the last group repeats the last run."""
        real = min(self.lanes, size - first)
        runs = np.minimum(np.arange(first, first + self.lanes), size - 1)
        return (slice(first, first + real) if real == self.lanes else runs), real


def shaped(flat: np.ndarray, shapes: Any) -> Any:
    """Columns as the leaves of what has these shapes."""
    leaves, at = [], 0
    for leaf in jax.tree_util.tree_leaves(shapes):
        size = int(np.prod(leaf.shape))
        leaves.append(flat[..., at : at + size].reshape((*flat.shape[:-1], *leaf.shape)).astype(leaf.dtype, copy=False))
        at += size
    return jax.tree_util.tree_unflatten(jax.tree_util.tree_structure(shapes), leaves)


@lru_cache(256)
def compiled_step(written: Written, keep: str, lanes: int) -> Step:
    """The compiled step: nothing is compiled twice."""
    return Step(written, keep, lanes)


class _Start:
    """`init` as machine code, one run a row."""

    def __init__(self, program: Any):
        self.places, names = entries_read(program.inputs)
        outputs = tuple(int(n) for array in program.outputs for n in array.ravel())
        self.size = len(outputs)
        self.compiled = Compiled(Loop(program, (), (), names, (), outputs, ()))

    def run(self, size: int, fixed: list) -> np.ndarray:
        """The first state of each run, flat: (size, entries)."""
        each, nothing = np.empty((size, self.size)), np.zeros(1)
        self.compiled(size, nothing, nothing, columns(fixed, self.places, size), each, nothing)
        return each


def columns(leaves: list, places: list, size: int) -> np.ndarray:
    """The entries that are read of leaves with or without a batch axis: (size, entries)."""
    out = np.empty((size, len(places)))
    for column, (i, j) in enumerate(places):
        leaf, axis = leaves[i]
        out[:, column] = leaf.ravel()[j] if axis is None else leaf.reshape(size, -1)[:, j]
    return out


def on_all_processors(work: Any, items: range) -> None:
    """Each item once, in threads: machine code and copies release Python's lock."""
    if len(items) == 1:
        work(items[0])
        return
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(work, items))  # raises what a thread raised
