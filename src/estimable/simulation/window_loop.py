"""Closed loops with a moving window as the estimator, at a cost independent of its length.

A window is the end of a block of rows and the beginning of the next (`kernels.stretch`). The beginning grows with the loop; the
ends are gathered backwards after each block, so that machine code alternates forwards and backwards (`engines.two_passes`).
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ..engines import choice, two_passes, xla
from ..engines.step import Select
from ..errors import EstimableError
from ..estimation import window_scan
from ..estimation.window_scan import PassInfo, or_empty, step_of
from ..estimation.windows import window_of
from ..filters.moving_window import MovingWindow
from ..frozen import frozen, replace, static
from ..kernels import stretch
from ..models.prior import Prior
from ..protocols import Wrapper
from ..results import Info, Interval, Sample
from .loop import ControlLoop, LoopInputs, entries

SHORTEST = 3  # rows of a window: for shorter ones copies are as fast


def scan_bank(
    engine: str, loop: ControlLoop, prior: Prior | None, rows: LoopInputs, intervals: Interval, *, select: Select
) -> tuple[str, xla.Run]:
    """`choice.scan_bank` for loops that differ in their rows, with the windows in blocks where possible."""
    general: dict[str, Any] = {"axes": (None, 0, None), "keep": "all", "select": select}
    window = window_of(loop.estimator)
    if (
        prior is None
        or window is None
        or engine not in ("auto", "native")
        or jax.default_backend() != "cpu"
        or loop.plant.rows is not None
        or loop.input_covariance is not None  # its effect depends on the gain
        or loop.loses
        or not _fits(window)
    ):
        return choice.scan_bank(engine, loop, prior, rows, intervals, **general)
    run = None
    try:
        run = _in_blocks(loop, window, prior, rows, intervals, select)
    except EstimableError:
        raise
    except Exception as why:
        choice.pass_over("native", "a window in blocks", why)
    if run is None:
        return choice.scan_bank(engine, loop, prior, rows, intervals, **general)
    info, again = run.info
    run = xla.Run(info, None, run.code, run.failed_at, None)
    copied = np.flatnonzero(again.any(axis=1))
    if len(copied) == 0:
        return "native", run
    some = jax.tree_util.tree_map(lambda leaf: np.asarray(leaf)[copied], (rows, intervals))
    ran, instead = choice.scan_bank("auto", loop, prior, *some, **general)
    instead = instead._replace(log_likelihood=None, state=None)
    for leaf, other in zip(*map(jax.tree_util.tree_leaves, (run, instead)), strict=True):
        leaf[copied] = other
    return (ran if len(copied) == len(again) else "native"), run


def _fits(window: MovingWindow) -> bool:
    return window.length >= SHORTEST and window_scan.fits(window.algorithm)


def _in_blocks(
    loop: ControlLoop, window: MovingWindow, prior: Prior, rows: LoopInputs, intervals: Interval, select: Select
) -> xla.Run:
    """The loops; their info is (the selected outputs, the mask of windows that must be computed copy by copy)."""
    own, first = window.priors(prior)
    fresh, before = (
        jax.tree_util.tree_map(np.asarray, window_scan.short(window.algorithm.init(p))) for p in (own, first)
    )
    begin = jax.tree_util.tree_map(  # no window is full before the last row of the first block
        lambda full, early: np.concatenate([np.repeat(early[None], window.length - 1, axis=0), full[None]]),
        fresh, before,
    )  # fmt: skip
    runs, T = rows.seen.shape[:2]
    blank = jax.tree_util.tree_map(lambda leaf: np.broadcast_to(leaf[0], (runs, T, *leaf.shape[1:])), begin)
    rows = replace(rows, begin=blank, place=np.broadcast_to(np.arange(T) % window.length, (runs, T)))
    in_block = _in_block(loop.estimator, len(loop.columns), loop.plant.B.shape[-1])
    return two_passes.scan_bank(
        two_passes.Way(replace(loop, estimator=in_block), prior), two_passes.Way(_BlockEnds(window.algorithm), own), rows,
        intervals, begin=begin, length=window.length, select=_Select(select, loop.columns),
    )  # fmt: skip


def _in_block(estimator: Any, outputs: int, inputs: int) -> Any:
    """The estimator with its window in blocks."""
    if isinstance(estimator, MovingWindow):
        return _BlockBeginnings(estimator.algorithm, outputs, inputs)
    return replace(estimator, algorithm=_in_block(estimator.algorithm, outputs, inputs))


class _Select(NamedTuple):
    """The selected outputs of a row of the loop, and the data of the backward pass."""

    select: Any
    columns: tuple[int, ...]

    def __call__(self, info: Info, keep: str) -> tuple[Any, Any]:
        extra = dict(info.extra)
        estimator = dict(extra["estimator"])
        again, loop = estimator.pop("again"), extra["loop"]
        output = entries(loop["output"], self.columns)
        seen = output == output
        sample = Sample(jnp.where(seen, output, 0.0), seen, loop["known_input"])
        selected = self.select(replace(info, extra={**extra, "estimator": estimator}), keep)
        return (selected, again), (sample, loop["interval"])


@frozen
class _Begun:
    """The gathered part of a block, and its last sample, whose step to the next is not yet known."""

    gathered: stretch.Stretch
    y: Any
    seen: Any
    u: Any


@frozen
class _BlockBeginnings(Wrapper[_Begun]):
    """Forwards: the report of the filter at the end of each window."""

    algorithm: Any
    outputs: int = static()
    inputs: int = static()

    def init(self, prior: Prior) -> _Begun:
        """An empty stretch."""
        p, nothing = self.outputs, stretch.empty(self.algorithm.init(prior).mean.shape[0])
        return _Begun(nothing, jnp.zeros(p), jnp.zeros(p, bool), jnp.zeros(self.inputs))

    def correct(self, state: _Begun, sample: Sample) -> tuple[_Begun, Info]:
        """Apply the gathered part of the block, and update with the sample like the filter."""
        begin, place = sample.extra
        gathered = or_empty(place == 0, state.gathered)
        info, again = window_scan.learn(self.algorithm, begin, gathered, replace(sample, extra=None))
        info = replace(info, extra={**(info.extra or {}), "again": again})
        return _Begun(gathered, sample.y, sample.seen, sample.u), info

    def predict(self, state: _Begun, interval: Interval) -> _Begun:
        """Gather the sample and the step to the next."""
        row = window_scan.WindowRow(Sample(state.y, state.seen, state.u), interval, None)
        return replace(state, gathered=stretch.joined(state.gathered, step_of(self.algorithm, row)))


@frozen
class _BlockEnds(window_scan.Backwards):
    """Backwards over a block: the belief at its end, for the window that ends at the same place of the next block."""

    def correct(self, state: tuple, sample: Sample) -> tuple[tuple, PassInfo]:
        """The stretch gathered after this row; then put the row before it."""
        return (*state, sample), PassInfo(window_scan.short(window_scan.through(*state)), False, 0)

    def predict(self, state: tuple, interval: Interval) -> tuple:
        """Put the row before the gathered ones."""
        fresh, gathered, sample = state
        row = window_scan.WindowRow(sample, interval, None)
        return fresh, stretch.joined(step_of(self.algorithm, row), gathered)
