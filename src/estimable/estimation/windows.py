"""Moving windows over a whole record: by a scan where possible; else every window is a separate run, in one bank."""

from typing import Any, NamedTuple

import jax
import numpy as np

from ..annotations import Tree
from ..engines import choice, xla
from ..engines.step import Select, Stepping
from ..filters.bounded import Bounded
from ..filters.moving_window import MovingWindow
from ..filters.smoothed import Smoothed
from ..frozen import frozen, replace
from ..models.prior import Prior
from ..protocols import Algorithm, Wrapper
from ..results import Info, Interval, Sample
from . import window_scan
from .binding import select as keep_of
from .stateless import Stateless

NUMBERS = 2_000_000  # of rows laid out at a time: windows overlap, so a record is copied `length` times


@frozen
class Replayed(Stateless, Wrapper[tuple[()]]):
    """The substitute for a window that has been run: each sample carries its report, in `extra`."""

    algorithm: Any

    def correct(self, state: tuple[()], sample: Sample) -> tuple[tuple[()], Info]:
        """The report of the window."""
        return state, sample.extra


def scan(
    engine: str,
    algorithm: Stepping,
    prior: Prior | None,
    samples: Sample,
    intervals: Interval,
    *,
    keep: str,
    select: Select,
) -> tuple[str, xla.Run]:
    """`choice.scan`, with the windows of a `MovingWindow` side by side where possible."""
    if window_of(algorithm) is None:
        return choice.scan(engine, algorithm, prior, samples, intervals, keep=keep, select=select)
    rows = [jax.tree_util.tree_map(lambda leaf: np.asarray(leaf)[None], part) for part in (samples, intervals)]
    engine, run = scan_bank(engine, algorithm, prior, *rows, axes=(None, 0, None), keep=keep, select=select)
    return engine, jax.tree_util.tree_map(lambda leaf: leaf[0], run)


def scan_bank(
    engine: str,
    algorithm: Stepping,
    prior: Prior | None,
    samples: Sample,
    intervals: Interval,
    *,
    axes: tuple,
    keep: str,
    select: Select,
) -> tuple[str, xla.Run]:
    """`choice.scan_bank`, with the windows of a `MovingWindow` side by side where possible."""
    window, (a, r, p) = window_of(algorithm), axes
    if window is None or r is None:
        return choice.scan_bank(engine, algorithm, prior, samples, intervals, axes=axes, keep=keep, select=select)
    kept = _all if keep in ("all", "last") else _means
    engine, infos = _run_windows(engine, window, a, (prior, p), (samples, intervals), kept)
    if algorithm is window:
        return engine, _as_run(infos, keep, select)
    rows = replace(samples, extra=infos)
    _, run = choice.scan_bank(
        engine, _replaying(algorithm, window), prior, rows, intervals, axes=axes, keep=keep, select=select
    )
    return engine, run


def _as_run(infos: Info, keep: str, select: Select) -> xla.Run:
    """The run of an engine with these reports row by row."""
    infos = jax.tree_util.tree_map(np.asarray, infos)
    failed_at = np.argmax(infos.outcome != 0, axis=1)
    code = infos.outcome[np.arange(len(failed_at)), failed_at]
    kept = select(infos, keep)
    if keep == "last":
        kept = jax.tree_util.tree_map(lambda leaf: leaf[:, -1], kept)
    return xla.Run(kept, infos.log_likelihood.sum(axis=1), code, failed_at, None)


def window_of(algorithm: Stepping) -> MovingWindow | None:
    """The window that can be replayed: only bounds and averages wrap it, and its model is constant."""
    while isinstance(algorithm, Bounded | Smoothed):
        algorithm = algorithm.algorithm
    if not isinstance(algorithm, MovingWindow):
        return None
    now = jax.eval_shape(lambda inner: inner.at(0), algorithm.algorithm)
    constant = jax.tree_util.tree_structure(now) == jax.tree_util.tree_structure(algorithm.algorithm)
    return algorithm if constant else None


def _replaying(algorithm: Stepping, window: MovingWindow) -> Any:
    """The algorithm with its window replaced."""
    if isinstance(algorithm, Bounded | Smoothed):
        return replace(algorithm, algorithm=_replaying(algorithm.algorithm, window))
    return Replayed(window.algorithm)


def _all(info: Info, keep: str) -> Info:
    return info


def _means(info: Info, keep: str) -> Info:
    return keep_of(info, "means")


def _run_windows(engine: str, window: MovingWindow, a: int | None, prior: tuple, rows: tuple, kept: Select):
    """The engine that ran, and the reports of the windows at every row of every run."""
    length, runs = window.length, len(rows[0].seen)
    own, first = window.priors(prior[0])
    own_axis = prior[1] if window.state_prior is None else a
    early = [jax.tree_util.tree_map(lambda leaf: leaf[:, : max(length - 1, 1)], part) for part in rows]
    _, run = choice.scan_bank(engine, window.algorithm, first, *early, axes=(a, 0, prior[1]), keep="all", select=kept)
    scanned = length > 2 and window_scan.fits(window.algorithm)
    at_once = (
        -(-runs // -(-runs // window_scan.AT_ONCE)) if scanned else runs
    )  # the same number in each part, or almost
    T = rows[0].seen.shape[1]
    infos = jax.tree_util.tree_map(lambda leaf: np.empty((runs, T, *leaf.shape[2:]), leaf.dtype), run.info)
    _write(infos, np.s_[:, : max(length - 1, 1)], run.info)

    ran = engine
    for start in range(0, runs, at_once):
        begin = min(start, runs - at_once)
        some = slice(begin, begin + at_once)
        cut = [jax.tree_util.tree_map(lambda leaf, some=some: leaf[some], part) for part in rows]
        algorithm, own_of_some = _cut(window.algorithm, a, some), _cut(own, own_axis, some)
        windows = _Windows(engine, length, algorithm, own_of_some, cut, (a, 0, own_axis), kept)
        ran, full = _full(windows, scanned)
        _write(infos, np.s_[some, length - 1 :], full)
    return ran, infos


class _Windows(NamedTuple):
    """All windows of `length` samples of some runs: the algorithm, its prior and the rows, with the axes of a bank."""

    engine: str
    length: int
    algorithm: Algorithm[Any]
    own: Prior
    rows: list
    axes: tuple
    kept: Select


def _write(whole: Tree, place: tuple[slice | np.ndarray, ...], part: Tree) -> None:
    """Write a part into the arrays of the whole."""
    for leaf, values in zip(*map(jax.tree_util.tree_leaves, (whole, part)), strict=True):
        leaf[place] = values


def _full(windows: _Windows, scanned: bool):
    """The engine that ran, and the reports of every full window of some runs: (runs, windows, ..)."""
    engine, length, algorithm, own, rows, axes, kept = windows
    runs, T = rows[0].seen.shape[:2]
    if not scanned:
        ran, info = _rerun(windows, np.indices((runs, T - length + 1)).reshape(2, -1))
        return ran, jax.tree_util.tree_map(lambda leaf: leaf.reshape(runs, -1, *leaf.shape[1:]), info)
    keep = "all" if kept is _all else "means"
    ran, info, again = window_scan.scan_bank(engine, algorithm, length, own, *rows, axes=axes, keep=keep)
    where = np.nonzero(again)
    if not len(where[0]):
        return ran, info
    _, instead = _rerun(windows, np.array(where))
    info = jax.tree_util.tree_map(np.array, info)
    _write(info, where, instead)
    return ran, info


def _rerun(windows: _Windows, where: np.ndarray):
    """The engine that ran, and the reports of the windows that begin at (run, row) `where`, each as a separate run."""
    engine, length, algorithm, own, rows, axes, kept = windows
    columns = sum(leaf[0, 0].size for leaf in jax.tree_util.tree_leaves(rows))
    at_once = max(1, NUMBERS // (length * columns))
    ran, parts = engine, []
    for start in range(0, where.shape[1], at_once):
        run, row = where[:, start : start + at_once]
        at = run[:, None], row[:, None] + np.arange(length)
        full = [jax.tree_util.tree_map(lambda leaf, at=at: np.asarray(leaf)[at], part) for part in rows]
        ran, rerun = choice.scan_bank(
            engine, _cut(algorithm, axes[0], run), _cut(own, axes[2], run), *full, axes=axes, keep="last", select=kept
        )
        parts.append(rerun.info)
    return ran, jax.tree_util.tree_map(lambda *leaves: np.concatenate(leaves), *parts)


def _cut(part: Tree | Algorithm[Any], axis: int | None, some: slice | np.ndarray) -> Any:
    return part if axis is None else jax.tree_util.tree_map(lambda leaf: np.asarray(leaf)[some], part)
