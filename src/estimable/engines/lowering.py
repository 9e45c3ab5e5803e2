"""A step of an algorithm lowered to a straight line of scalars, once for each algorithm, its shapes and selected outputs."""

from collections import Counter
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import numpy as np

from ..annotations import Tree
from .disk_cache import once
from .program.constant_state import constant_entries
from .program.primitives import UnsupportedError
from .program.straight_line import Program, lower_jaxpr
from .step import Row, Select, Stepping, named, step

LONG = 20_000  # outputs in all, seen or not
OPEN = 200_000  # operations of a step before the constants of its state are known


class Carried(NamedTuple):
    """An entry of the flat state: its place, its scalars `now` and `after` the row, and the scalar of the start."""

    place: int
    now: int
    after: int
    start: int


@dataclass(frozen=True, eq=False)
class Written:
    """`start`: from (algorithm, prior) to the first state. `row`: from those, a state, a sample and an interval to the next
    state, the selected outputs, the log-likelihood and the outcome.

    The first `fixed` arrays of `row` are those of algorithm and prior, then come `states` arrays of the state.
    `kept`: the shapes of the selected outputs.
    """

    start: Program
    row: Program
    fixed: int
    states: int
    kept: Any

    @property
    def outputs(self) -> Row:
        """The scalars of the outputs of `row`, by name."""
        return named(self.row.outputs, self.states)

    @property
    def carried(self) -> list[Carried]:
        """The entries of the state that a row reads."""
        now, after, start = (
            [int(name) for array in arrays for name in array.ravel()]
            for arrays in (
                self.row.inputs[self.fixed :][: self.states],
                self.outputs.state,
                self.start.outputs,
            )
        )
        entries = [Carried(*entry) for entry in zip(range(len(now)), now, after, start, strict=True)]
        return [entry for entry in entries if entry.now >= 0 and self.row.operations[entry.now].name != "constant"]


def write(
    algorithm: Stepping,
    prior: Tree,
    samples: Tree,
    intervals: Tree,
    *,
    axes: tuple,
    keep: str,
    select: Select,
    zeros: tuple[tuple[int, int], ...] | None = None,
) -> Written:
    """The step of a bank (see `xla.scan_bank`). Raises `UnsupportedError` where it cannot be lowered.

    `zeros`: (array, entry) of numbers of the algorithm that are constants, as they are zero in every run. None: all of them,
    where the work is long enough for another compilation.
    """
    structure, shapes = example(algorithm, prior, samples, intervals, axes)
    if zeros is None:
        zeros = _zeros(algorithm, axes[0]) if jax.tree_util.tree_leaves(samples)[0].size >= LONG else ()
    written = write_shapes(structure, shapes, keep, select, zeros)
    if isinstance(written, UnsupportedError):
        raise UnsupportedError(*written.args)
    return written


def example(algorithm: Stepping, prior: Tree, samples: Tree, intervals: Tree, axes: tuple) -> tuple[Any, tuple]:
    """The structure, and the shape and type of each array, of (algorithm, prior, sample, interval) in one row of one run."""
    a, r, p = axes
    leaves, structure = jax.tree_util.tree_flatten((algorithm, prior, samples, intervals))
    fixed, along = [(axis is not None) for axis in (a, p)], 1 + (r is not None)
    leading = np.repeat((*fixed, along, along), [part.num_leaves for part in structure.children()]).tolist()
    arrays = [np.asarray(leaf) for leaf in leaves]  # each with so many axes of runs and rows before its own
    return structure, tuple((x.shape[first:], x.dtype.str) for x, first in zip(arrays, leading, strict=True))


def batch(algorithm: Stepping, prior: Tree, samples: Tree, intervals: Tree, axes: tuple) -> tuple[int, list, list]:
    """The number of runs, and (leaf, axis of the batch or None) of the fixed arrays of a run and of its rows."""
    a, r, p = axes
    fixed = [
        (np.asarray(x), axis) for part, axis in ((algorithm, a), (prior, p)) for x in jax.tree_util.tree_leaves(part)
    ]
    rows = [(np.asarray(x), r) for x in jax.tree_util.tree_leaves((samples, intervals))]
    return next(len(leaf) for leaf, axis in fixed + rows if axis == 0), fixed, rows


def entries_read(arrays: tuple[np.ndarray, ...]) -> tuple[list[tuple[int, int]], tuple[int, ...]]:
    """(array, entry) and name of each input scalar that a program reads."""
    found = [(i, j, int(n)) for i, array in enumerate(arrays) for j, n in enumerate(array.ravel()) if n >= 0]
    return [(i, j) for i, j, _ in found], tuple(n for _, _, n in found)


def _zeros(algorithm: Stepping, axis: int | None) -> tuple[tuple[int, int], ...]:
    """(array, entry) of the numbers that are zero in every run."""
    leaves = [np.asarray(leaf) for leaf in jax.tree_util.tree_leaves(algorithm)]
    runs = [1 if axis is None else len(leaf) for leaf in leaves]
    zero = [~leaf.reshape(count, -1).any(axis=0) for leaf, count in zip(leaves, runs, strict=True)]
    return tuple(
        (i, int(j)) for i, entries in enumerate(zero) if leaves[i].dtype == float for j in np.flatnonzero(entries)
    )


def zero_arrays(algorithm: Stepping, axis: int | None) -> tuple[tuple[int, int], ...]:
    """(array, entry) of the arrays that are zero as a whole, in every run."""
    sizes = [np.size(leaf) // (1 if axis is None else len(leaf)) for leaf in jax.tree_util.tree_leaves(algorithm)]
    zeros = _zeros(algorithm, axis)
    count = Counter(i for i, _ in zeros)
    return tuple((i, j) for i, j in zeros if count[i] == sizes[i])


@lru_cache(256)
def write_shapes(
    structure: Any, shapes: tuple, keep: str, select: Select, zeros: tuple = ()
) -> Written | UnsupportedError:
    """The step, or the reason why there is none, cached."""
    return once(attempt, structure, shapes, keep, select, zeros)


def attempt(structure: Any, shapes: tuple, keep: str, select: Select, zeros: tuple) -> Written | UnsupportedError:
    """The step, or the reason why there is none."""
    try:
        return _write(structure, shapes, keep, select, zeros)
    except UnsupportedError as reason:
        return UnsupportedError(*reason.args)  # without the frames that the reason has passed


class Traced(NamedTuple):
    """The jaxprs of `init` and of a row, as `Written` describes them; `shapes` of the arrays of the state."""

    start: Any
    row: Any
    fixed: int
    states: int
    kept: Any


def trace(structure: Any, shapes: tuple, keep: str, select: Select) -> Traced:
    """The traces of `init` and of a row."""
    examples = [np.zeros(shape, dtype) for shape, dtype in shapes]
    algorithm, prior, sample, interval = jax.tree_util.tree_unflatten(structure, examples)

    def init(algorithm: Stepping, prior: Tree):
        return algorithm.init(prior)

    def go(algorithm: Stepping, prior: Tree, state: Tree, sample: Tree, interval: Tree):
        return step(algorithm, 0, state, sample, interval, keep, select)

    start, state = jax.make_jaxpr(init, return_shape=True)(algorithm, prior)
    row, left = jax.make_jaxpr(go, return_shape=True)(algorithm, prior, state, sample, interval)
    fixed, states = (len(jax.tree_util.tree_leaves(part)) for part in ((algorithm, prior), state))
    return Traced(start, row, fixed, states, left.kept)


def _write(structure: Any, shapes: tuple, keep: str, select: Select, zeros: tuple) -> Written:
    traced = trace(structure, shapes, keep, select)
    fixed, states, start = traced.fixed, traced.states, lower_jaxpr(traced.start)
    always = dict.fromkeys(zeros, 0.0)
    known = _constants(start, fixed)
    # the shortest form first: if that is too long, stop here
    row = lower_jaxpr(traced.row, always | known)
    if len(_still_known(known, row, fixed, states)) < len(known):
        known = constant_entries(known, lower_jaxpr(traced.row, always, OPEN), fixed)
        row = lower_jaxpr(traced.row, always | known)
    while len(kept := _still_known(known, row, fixed, states)) < len(known):
        known = kept
        row = lower_jaxpr(traced.row, always | known)
    return Written(start, row, fixed, states, traced.kept)


def _constants(start: Program, fixed: int) -> dict[tuple[int, int], Any]:
    """Entries of the state that begin as constants, such as the zeros of a triangular factor."""
    return {
        (fixed + array, entry): start.operations[name].value
        for array, names in enumerate(start.outputs)
        for entry, name in enumerate(names.ravel())
        if start.operations[name].name == "constant"
    }


def _still_known(known: dict, row: Program, fixed: int, states: int) -> dict[tuple[int, int], Any]:
    """The known entries that a step leaves unchanged: by induction they are constant."""
    nexts = [[row.operations[name] for name in names.ravel()] for names in row.outputs[:states]]
    return {
        (array, entry): value
        for (array, entry), value in known.items()
        if (after := nexts[array - fixed][entry]).name == "constant" and repr(after.value) == repr(value)
    }
