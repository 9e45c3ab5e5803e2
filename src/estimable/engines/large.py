"""Steps of models that are too large for scalars, as machine code of operations on arrays."""

import math
from functools import lru_cache
from typing import Any

import numpy as np

from .batches import DTYPES, on_all_processors, shaped, sizes
from .disk_cache import once
from .llvm.array_loop import ArrayLoop
from .llvm.compilation import Compiled
from .lowering import Traced, trace
from .program.arrays import lower
from .program.primitives import UnsupportedError
from .step import Select, named
from .xla import Run

LINE = 64  # bytes of a cache line


class LargeStep:
    """A compiled step. Each processor runs the runs of a bank one after the other."""

    def __init__(self, program: Traced, keep: str, seek_steady: bool):
        row, states = program.row, program.states
        outputs = named(row.outputs, states)
        totals = outputs.log_likelihood, outputs.outcome
        each, last = ((*totals, *outputs.kept), ()) if keep != "last" else (totals, outputs.kept)
        row = row._replace(outputs=(*outputs.state, *each, *last))
        self.kept, self.keep = program.kept, keep
        self.each, self.last = ([row.operations[name] for name in names] for names in (each, last))
        self.rows = [kind for _, kind in row.types[program.fixed + states :]]
        self.loop = ArrayLoop(row, program.start, program.fixed, states, len(each), seek_steady)
        self.compiled = Compiled(self.loop)

    def run(self, size: int, fixed: list, rows: list) -> Run:
        """Run all, on all processors. `fixed`, `rows`: (array, 0 where its first axis is that of the runs, else None)."""
        read = [
            (np.ascontiguousarray(leaf, DTYPES[kind]), axis) for (leaf, axis), kind in zip(rows, self.rows, strict=True)
        ]
        leaf, axis = read[0]
        T = leaf.shape[0 if axis is None else 1]
        each = [np.empty((size, T, math.prod(array.shape)), DTYPES[array.kind]) for array in self.each]
        last = np.empty((size, sum(math.prod(array.shape) for array in self.last)))

        def run(i: int) -> None:
            given = [np.ravel(_of(i, *leaf)).astype(float) for leaf in fixed]
            row = [_of(i, *leaf) for leaf in read]
            memory = _memory(self.loop.bytes)
            self.compiled(
                T, np.concatenate([*given, np.zeros(1)]), memory, last[i], *row, *(array[i] for array in each)
            )

        on_all_processors(run, range(size))
        log_likelihoods, outcomes = (array[..., 0] for array in each[:2])
        failed_at = np.argmax(outcomes != 0, axis=1)
        kept = np.split(last, sizes(self.kept)[:-1], axis=-1) if self.keep == "last" else each[2:]
        codes = outcomes[np.arange(size), failed_at]
        return Run(shaped(kept, self.kept), log_likelihoods.sum(axis=1), codes, failed_at, None)


def large_step(structure: Any, shapes: tuple, keep: str, select: Select, seek_steady: bool) -> LargeStep:
    """The compiled step (see `written.trace`). Raises `UnsupportedError` where a part of it has no machine code."""
    step = _large_step(structure, shapes, keep, select, seek_steady)
    if isinstance(step, UnsupportedError):
        raise UnsupportedError(*step.args)
    return step


@lru_cache(256)
def _large_step(
    structure: Any, shapes: tuple, keep: str, select: Select, seek_steady: bool
) -> LargeStep | UnsupportedError:
    """The step, or the reason why there is none, cached."""
    program = once(attempt, structure, shapes, keep, select)
    try:
        return program if isinstance(program, UnsupportedError) else LargeStep(program, keep, seek_steady)
    except UnsupportedError as reason:
        return UnsupportedError(*reason.args)  # without the frames that the reason has passed


def attempt(structure: Any, shapes: tuple, keep: str, select: Select) -> Traced | UnsupportedError:
    """`init` and a row as programs of arrays, or the reason why there is none."""
    traced = trace(structure, shapes, keep, select)
    try:
        return traced._replace(start=lower(traced.start), row=lower(traced.row))
    except UnsupportedError as reason:
        return UnsupportedError(*reason.args)  # without the frames that the reason has passed


def _of(run: int, leaf: np.ndarray, axis: int | None) -> np.ndarray:
    """The part of an array that belongs to a run."""
    return leaf if axis is None else leaf[run]


def _memory(size: int) -> np.ndarray:
    """Memory aligned to a cache line."""
    memory = np.empty(size + LINE, np.uint8)
    return memory[-memory.ctypes.data % LINE :]
