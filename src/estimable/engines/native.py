"""Steps as machine code: for models that do not vary in time and are small enough to be written out, on a CPU."""

import os
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import Any

import jax
import numpy as np

from .llvm import Compiled, Loop
from .straight_line import Program, UnsupportedError, lower
from .xla import Run

LANES = 8  # runs side by side: two registers of AVX2, one of AVX-512


def scan(algorithm: Any, prior: Any, samples: Any, intervals: Any, *, keep: str, select: Any) -> Run:
    """What `xla.scan` does, to rounding. Raises `UnsupportedError` where the step cannot be written out."""
    one = [jax.tree_util.tree_map(lambda leaf: np.asarray(leaf)[None], part) for part in (samples, intervals)]
    run = scan_bank(algorithm, prior, *one, axes=(None, 0, None), keep=keep, select=select)
    return jax.tree_util.tree_map(lambda leaf: leaf[0], run)


def scan_bank(algorithm: Any, prior: Any, samples: Any, intervals: Any, *, axes: tuple, keep: str, select: Any) -> Run:
    """Many runs at once: of (algorithm, samples and intervals, prior) those with axis 0 have a leading batch axis."""
    a, r, p = axes
    parts = [(algorithm, a), (prior, p), (samples, r), (intervals, r)]
    size = next(np.shape(leaf)[0] for part, axis in parts if axis == 0 for leaf in jax.tree_util.tree_leaves(part))
    example = [_first(algorithm, a), _first(prior, p), *(_first(_first(part, r), 0) for part in (samples, intervals))]
    leaves, structure = jax.tree_util.tree_flatten(tuple(example))
    shapes = tuple((np.shape(leaf), np.asarray(leaf).dtype.str) for leaf in leaves)
    step = _step(structure, shapes, keep, select, LANES if size > 1 else 1)
    if isinstance(step, UnsupportedError):
        raise step
    fixed = [(np.asarray(leaf), axis) for part, axis in parts[:2] for leaf in jax.tree_util.tree_leaves(part)]
    rows = [(np.asarray(leaf), r) for part in (samples, intervals) for leaf in jax.tree_util.tree_leaves(part)]
    return step.run(size, fixed, rows)


def _first(part: Any, axis: int | None) -> Any:
    return part if axis is None else jax.tree_util.tree_map(lambda leaf: np.asarray(leaf)[0], part)


class _Step:
    """A compiled step: where its inputs are read from, and what its outputs are."""

    def __init__(self, structure: Any, shapes: tuple, keep: str, select: Any, lanes: int):
        examples = [np.zeros(shape, dtype) for shape, dtype in shapes]
        algorithm, prior, sample, interval = jax.tree_util.tree_unflatten(structure, examples)
        refuse_varying(algorithm)
        self.keep, self.lanes, told = keep, lanes, {}

        def init(algorithm, prior):
            return jax.tree_util.tree_leaves(algorithm.init(prior))

        def step(algorithm, prior, state, sample, interval):
            state, info = algorithm.correct(state, sample)
            kept = select(info, keep)
            told["kept"] = jax.eval_shape(lambda: kept)
            log_likelihood = 0.0 if info.log_likelihood is None else info.log_likelihood
            state = algorithm.predict(state, interval)
            return jax.tree_util.tree_leaves(state), jax.tree_util.tree_leaves(kept), [log_likelihood, info.outcome]

        state = jax.eval_shape(lambda algorithm, prior: algorithm.init(prior), algorithm, prior)
        begin = lower(init, algorithm, prior)
        self.start = _Start(begin)
        parts = (algorithm, prior, state, sample, interval)
        counts = [len(jax.tree_util.tree_leaves(part)) for part in parts]
        fixed, states = counts[0] + counts[1], counts[2]
        known = _constants(begin, fixed)
        program = lower(step, *parts, known=known)
        while len(kept := _kept(known, program, fixed, states)) < len(known):
            known = kept
            program = lower(step, *parts, known=known)
        self.kept = told["kept"]
        self._lay_out(program, fixed, states)

    def _lay_out(self, program: Any, fixed: int, states: int) -> None:
        """Say which scalars are read from where and written to where, and compile."""
        flat_states = [int(n) for array in program.inputs[fixed : fixed + states] for n in array.ravel()]
        nexts = [int(n) for array in program.outputs[:states] for n in array.ravel()]
        kept, told = ([int(n) for array in arrays for n in array.ravel()]
                      for arrays in (program.outputs[states:-2], program.outputs[-2:]))  # fmt: skip
        self.fixed, fixed_names = _read(program.inputs[:fixed])
        self.rows, row_names = _read(program.inputs[fixed + states :])
        is_read = [n >= 0 and program.operations[n].name != "constant" for n in flat_states]
        self.alive = np.array(is_read, bool)  # entries of the state that an output needs
        carried = [(n, after) for n, after, alive in zip(flat_states, nexts, is_read, strict=True) if alive]
        each, last = (told, kept) if self.keep == "last" else (kept + told, [])
        self.each, self.last = len(each), len(last)
        carry, next_carry = zip(*carried, strict=True) if carried else ((), ())
        self.compiled = Compiled(
            Loop(program, fixed_names, carry, row_names, next_carry, tuple(each), tuple(last)), self.lanes
        )

    def run(self, size: int, fixed: list, rows: list) -> Run:
        """Run all, `lanes` at a time side by side, the groups on all processors."""
        shared = all(axis is None for _, axis in rows)
        T = rows[0][0].shape[0 if shared else 1]
        starts = self.start.run(size, fixed)[:, self.alive]
        constants = _columns(fixed, self.fixed, size)
        data = _row_columns(rows, self.rows, T)
        each, last = np.empty((size, T, self.each)), np.empty((size, self.last))

        def alone(run: int) -> None:
            self.compiled(T, constants[run], starts[run].copy(), data[0 if shared else run], each[run], last[run])

        def side_by_side(first: int) -> None:
            runs = np.minimum(np.arange(first, first + self.lanes), size - 1)  # the last group repeats the last run
            row = (
                np.broadcast_to(data[0][..., None], (*data[0].shape, self.lanes))
                if shared
                else data[runs].transpose(1, 2, 0)
            )
            wrote, end = np.empty((T, self.each, self.lanes)), np.empty((self.last, self.lanes))
            self.compiled(T, constants[runs].T.copy(), starts[runs].T.copy(), np.ascontiguousarray(row), wrote, end)
            real = min(self.lanes, size - first)
            each[first : first + real], last[first : first + real] = wrote.transpose(2, 0, 1)[:real], end.T[:real]

        _on_all_processors(alone if self.lanes == 1 else side_by_side, range(0, size, self.lanes))
        outcomes = each[..., -1].astype(int)
        failed_at = np.argmax(outcomes != 0, axis=1)
        kept = self._shaped(last if self.keep == "last" else each)
        return Run(kept, each[..., -2].sum(axis=1), outcomes[np.arange(size), failed_at], failed_at, None)

    def _shaped(self, flat: np.ndarray) -> Any:
        """Columns as the leaves of an info."""
        leaves, at = [], 0
        for leaf in jax.tree_util.tree_leaves(self.kept):
            size = int(np.prod(leaf.shape))
            leaves.append(
                flat[..., at : at + size].reshape((*flat.shape[:-1], *leaf.shape)).astype(leaf.dtype, copy=False)
            )
            at += size
        return jax.tree_util.tree_unflatten(jax.tree_util.tree_structure(self.kept), leaves)


@lru_cache(256)
def _step(*arguments: Any) -> _Step | UnsupportedError:
    """The compiled step, or why there is none: neither is worked out twice."""
    try:
        return _Step(*arguments)
    except UnsupportedError as reason:
        return reason


def _constants(begin: Program, fixed: int) -> dict[tuple[int, int], Any]:
    """Entries of the state that begin as a constant, as the zeros of a triangular factor."""
    return {
        (fixed + array, entry): begin.operations[name].value
        for array, names in enumerate(begin.outputs)
        for entry, name in enumerate(names.ravel())
        if begin.operations[name].name == "constant"
    }


def _kept(known: dict, program: Program, fixed: int, states: int) -> dict[tuple[int, int], Any]:
    """Those of the known entries that a step leaves as they were: by induction they always are."""
    nexts = [[program.operations[name] for name in names.ravel()] for names in program.outputs[:states]]
    return {
        (array, entry): value
        for (array, entry), value in known.items()
        if (after := nexts[array - fixed][entry]).name == "constant" and repr(after.value) == repr(value)
    }


class _Start:
    """`init` as machine code, one run a row."""

    def __init__(self, program: Any):
        self.places, names = _read(program.inputs)
        outputs = tuple(int(n) for array in program.outputs for n in array.ravel())
        self.size = len(outputs)
        self.compiled = Compiled(Loop(program, (), (), names, (), outputs, ()))

    def run(self, size: int, fixed: list) -> np.ndarray:
        """The first state of each run, flat: (size, entries)."""
        each, nothing = np.empty((size, self.size)), np.zeros(1)
        self.compiled(size, nothing, nothing, _columns(fixed, self.places, size), each, nothing)
        return each


def _columns(leaves: list, places: list, size: int) -> np.ndarray:
    """The entries that are read of leaves with or without a batch axis: (size, entries)."""
    out = np.empty((size, len(places)))
    for column, (i, j) in enumerate(places):
        leaf, axis = leaves[i]
        out[:, column] = leaf.ravel()[j] if axis is None else leaf.reshape(size, -1)[:, j]
    return out


def _row_columns(leaves: list, places: list, T: int) -> np.ndarray:
    """The entries of the rows that are read: (runs, T, entries), with one run where all share the record."""
    runs = 1 if all(axis is None for _, axis in leaves) else len(leaves[0][0])
    out = np.empty((runs, T, len(places)))
    for column, (i, j) in enumerate(places):
        out[..., column] = leaves[i][0].reshape(runs, T, -1)[..., j]
    return out


def _on_all_processors(work: Any, items: range) -> None:
    """Each item once, in threads: machine code and copies release Python's lock."""
    if len(items) == 1:
        work(items[0])
        return
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(work, items))  # raises what a thread raised


def refuse_varying(algorithm: Any) -> None:
    """A model that varies in time is looked up by row, which a straight line cannot."""
    now = jax.eval_shape(lambda a: a.at(0), algorithm)
    if jax.tree_util.tree_structure(now) != jax.tree_util.tree_structure(algorithm):
        raise UnsupportedError("a model that varies in time")


def _read(arrays: tuple[np.ndarray, ...]) -> tuple[list[tuple[int, int]], tuple[int, ...]]:
    """(array, entry) and name of each input scalar that the program reads."""
    found = [(i, j, int(n)) for i, array in enumerate(arrays) for j, n in enumerate(array.ravel()) if n >= 0]
    return [(i, j) for i, j, _ in found], tuple(n for _, _, n in found)
