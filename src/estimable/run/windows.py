"""Moving windows over a whole record: every window is a run of its own, and all of them are one bank."""

from typing import Any

import jax
import numpy as np

from ..engines import choice, xla
from ..filters.bounded import Bounded
from ..filters.moving_window import MovingWindow
from ..filters.smoothed import Smoothed
from ..frozen import frozen, replace
from ..results import Info, Interval, Sample
from .binding import select as keep_of

NUMBERS = 2_000_000  # of rows that are laid out at a time: windows overlap, so a record is copied `length` times


@frozen
class Replayed:
    """In the place of a window that has been run: each sample brings in `arrived` what it says."""

    algorithm: Any

    def at(self, k) -> "Replayed":
        """The same: what is replayed has been worked out."""
        return self

    def init(self, prior) -> tuple[()]:
        """Nothing is remembered."""
        return ()

    def correct(self, state, sample: Sample) -> tuple[Any, Info]:
        """What the window said."""
        return state, sample.arrived

    def predict(self, state, interval: Interval):
        """Nothing moves."""
        return state


def scan(engine: str, algorithm: Any, prior: Any, samples: Any, intervals: Any, **options: Any) -> tuple[str, xla.Run]:
    """`choice.scan`, with the windows of a `MovingWindow` side by side where they can be."""
    if window_of(algorithm) is None:
        return choice.scan(engine, algorithm, prior, samples, intervals, **options)
    rows = [jax.tree_util.tree_map(lambda leaf: np.asarray(leaf)[None], part) for part in (samples, intervals)]
    engine, run = scan_bank(engine, algorithm, prior, *rows, axes=(None, 0, None), **options)
    return engine, jax.tree_util.tree_map(lambda leaf: leaf[0], run)


def scan_bank(
    engine: str, algorithm: Any, prior: Any, samples: Any, intervals: Any, *, axes: tuple, keep: str, select: Any
) -> tuple[str, xla.Run]:
    """`choice.scan_bank`, with the windows of a `MovingWindow` side by side where they can be."""
    window, (a, r, p) = window_of(algorithm), axes
    if window is None or r is None:
        return choice.scan_bank(engine, algorithm, prior, samples, intervals, axes=axes, keep=keep, select=select)
    kept = _all if keep in ("all", "last") else _means
    engine, infos = _run_windows(engine, window, a, (prior, p), (samples, intervals), kept)
    rows = replace(samples, arrived=infos)
    _, run = choice.scan_bank(
        engine, _replaying(algorithm), prior, rows, intervals, axes=axes, keep=keep, select=select
    )
    return engine, run


def window_of(algorithm: Any) -> MovingWindow | None:
    """The window that can be replayed: around it are bounds and averages only, and its model does not vary in time."""
    while isinstance(algorithm, Bounded | Smoothed):
        algorithm = algorithm.algorithm
    if not isinstance(algorithm, MovingWindow):
        return None
    now = jax.eval_shape(lambda inner: inner.at(0), algorithm.algorithm)
    constant = jax.tree_util.tree_structure(now) == jax.tree_util.tree_structure(algorithm.algorithm)
    return algorithm if constant else None


def _replaying(algorithm: Any) -> Any:
    """The algorithm with its window replaced."""
    if isinstance(algorithm, MovingWindow):
        return Replayed(algorithm.algorithm)
    return replace(algorithm, algorithm=_replaying(algorithm.algorithm))


def _all(info: Info, keep: str) -> Info:
    return info


def _means(info: Info, keep: str) -> Info:
    return keep_of(info, "means")


def _run_windows(engine: str, window: MovingWindow, a: int | None, prior: tuple, rows: tuple, kept: Any):
    """The engine that ran, and what the windows say at every row of every run."""
    length = window.length
    runs, T = rows[0].seen.shape[:2]
    own, first = window.priors(prior[0])
    own_axis = prior[1] if window.state_prior is None else a
    columns = sum(leaf[0, 0].size for leaf in jax.tree_util.tree_leaves(rows))
    at_once = max(1, NUMBERS // (T * length * columns))
    parts = []
    for start in range(0, runs, at_once):
        some = slice(start, min(start + at_once, runs))
        cut = [jax.tree_util.tree_map(lambda leaf, some=some: leaf[some], part) for part in rows]
        algorithm = _cut(window.algorithm, a, some)
        early = [jax.tree_util.tree_map(lambda leaf: leaf[:, : length - 1], part) for part in cut]
        said = []
        if length > 1:
            engine, run = choice.scan_bank(
                engine, algorithm, _cut(first, prior[1], some), *early, axes=(a, 0, prior[1]), keep="all", select=kept
            )
            said.append(run.info)
        full = [jax.tree_util.tree_map(lambda leaf: _windows(np.asarray(leaf), length), part) for part in cut]
        W = T - length + 1
        engine, run = choice.scan_bank(
            engine, _repeated(algorithm, a, W), _repeated(_cut(own, own_axis, some), own_axis, W), *full,
            axes=(a, 0, own_axis), keep="last", select=kept,
        )  # fmt: skip
        said.append(jax.tree_util.tree_map(lambda leaf, W=W: leaf.reshape(-1, W, *leaf.shape[1:]), run.info))
        parts.append(jax.tree_util.tree_map(lambda *leaves: np.concatenate(leaves, axis=1), *said))
    return engine, jax.tree_util.tree_map(lambda *leaves: np.concatenate(leaves), *parts)


def _cut(part: Any, axis: int | None, some: slice) -> Any:
    return part if axis is None else jax.tree_util.tree_map(lambda leaf: np.asarray(leaf)[some], part)


def _repeated(part: Any, axis: int | None, count: int) -> Any:
    return part if axis is None else jax.tree_util.tree_map(lambda leaf: np.repeat(leaf, count, axis=0), part)


def _windows(leaf: np.ndarray, length: int) -> np.ndarray:
    """(runs, T, ..) as (runs × windows, length, ..)."""
    views = np.moveaxis(np.lib.stride_tricks.sliding_window_view(leaf, length, axis=1), -1, 2)
    return views.reshape(views.shape[0] * views.shape[1], *views.shape[2:])
