"""Loops with a simulator that no engine can run as the plant: the same blocks, sample by sample in Python."""

from collections.abc import Callable
from typing import Any, TypeAlias

import jax
import numpy as np

from .. import forks
from ..annotations import Array
from ..engines import xla
from ..engines.step import Select
from ..frozen import replace
from ..models.prior import Prior
from ..protocols import Plant
from ..results import Info, Interval
from .loop import ControlLoop, Decided, LoopInputs, LoopState

Follow: TypeAlias = Callable[[int, np.ndarray], Any]


def scan_bank(
    simulator: Plant,
    loop: ControlLoop,
    prior: Prior | None,
    rows: LoopInputs,
    intervals: Interval,
    *,
    select: Select,
    follow: Follow | None = None,
) -> tuple[str, xla.Run]:
    """The result of `choice.scan_bank`, for loops that differ in their rows. `follow`: the estimator at a row with the last known
    outputs, where it follows them."""
    infos = [
        _fly(simulator.begin(float(loop.dt)), loop, prior, _of_run((rows, intervals), i), select, follow)
        for i in range(len(rows.seen))
    ]
    info = jax.tree_util.tree_map(lambda *leaves: np.stack(leaves), *infos)
    codes = np.asarray(info.outcome)
    failed_at = np.argmax(codes != 0, axis=1)
    return "python", xla.Run(info, None, codes[np.arange(len(codes)), failed_at], failed_at, None)


def _of_run(part: tuple[LoopInputs, Interval], i: int) -> Any:
    return jax.tree_util.tree_map(lambda leaf: np.asarray(leaf)[i], part)


def _fly(
    flight: Any,
    loop: ControlLoop,
    prior: Prior | None,
    drawn: tuple[LoopInputs, Interval],
    select: Select,
    follow: Follow | None,
) -> Info:
    """One run, its infos in rows."""
    rows, intervals = drawn
    state = replace(loop.at(0).init(prior), x=flight.state, position=flight.input)
    V = np.asarray(loop.plant.V[0])
    infos, known = [], np.full(len(V), np.nan)
    for k in range(len(rows.seen)):
        row, interval = _of_run((rows, intervals), k)
        measured, standing = flight.output + V @ row.noise[: len(V)], flight.input
        now = loop.at(k)
        if follow is not None:
            delivered = np.asarray(_delivered(now, state, measured, row))
            known = np.where(np.isnan(delivered), known, delivered)
            now = replace(now, estimator=follow(k, known))
        decided = _decide(now, state, measured, standing, row)
        x = flight.state
        flight.move(np.asarray(decided.applied), row.noise[len(V) :])
        state = replace(state, x=flight.state, position=flight.input)
        state, info = _go_on(now, state, decided, x, standing, flight.input, interval)
        infos.append(select(info, "all"))
    return jax.tree_util.tree_map(lambda *leaves: np.stack(leaves), *infos)


@forks.jit
def _delivered(loop: ControlLoop, state: LoopState, measured: Array, row: LoopInputs) -> Array:
    return loop.delivered(state, measured, row)


@forks.jit
def _decide(loop: ControlLoop, state: LoopState, measured: Array, standing: Array, row: LoopInputs) -> Decided:
    return loop.decide(state, measured, standing, row)


@forks.jit
def _go_on(
    loop: ControlLoop, state: LoopState, decided: Decided, x: Array, standing: Array, end: Array, interval: Interval
) -> tuple[LoopState, Info]:
    known = (decided.applied, decided.applied) if loop.commanded else (standing, end)
    state, info = loop.go_on(state, decided, x, standing, *known)
    return loop.predict(state, interval), info
