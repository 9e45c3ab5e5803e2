"""Disturbances and failures of sensors as numbers for each row of a run."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..frozen import frozen
from .discretisation import over, transition
from .disturbances import Gust, SensorFault, Upset
from .events import Event
from .state_space import StateSpace

SAME = 1e-9  # [s]: times nearer than this are equal


@frozen
class Sensed:
    """What the sensors do to each output, row by row (T, p): reading = `scale` y + `shift` + `sigma` e; then `forced`, if it is
    a number; then the last reading where `frozen` is 1. Where `dropped` is 1 nothing is read."""

    scale: Any
    shift: Any
    sigma: Any
    forced: Any
    frozen: Any
    dropped: Any


def sensed(events: Sequence[Event], models: Sequence[StateSpace], phase: np.ndarray, t: np.ndarray) -> Sensed | None:
    """The failures of the sensors, and what gusts add to the outputs; None without any. `models` and `phase`: as in `pushes`."""
    model = models[0]
    faults = [event for event in events if isinstance(event, SensorFault) and event.output in model.outputs]
    air = _air(events, models, phase, t)
    if not faults and air is None:
        return None
    shape = (len(t), model.p)
    rows = Sensed(np.ones(shape), np.zeros(shape), np.zeros(shape), np.full(shape, np.nan), *np.zeros((2, *shape)))
    if air is not None:
        rows.shift[:] += air
    for event in faults:
        on, j = acts(event, t), model.outputs.index(event.output)
        _apply(event, rows, on, j, t)
    return rows


def unmeasured(events: Sequence[Event], model: StateSpace, t: np.ndarray) -> np.ndarray | None:
    """The inputs whose position is not measured, (T, m); None without such an event."""
    lost = [event for event in events if isinstance(event, SensorFault) and event.output not in model.outputs]
    if not lost:
        return None
    missing = np.zeros((len(t), model.m), bool)
    for event in lost:
        missing[acts(event, t), model.inputs.index(event.output)] = True
    return missing


def _apply(event: SensorFault, rows: Sensed, on: np.ndarray, j: int, t: np.ndarray) -> None:
    value = event.value
    if event.kind == "scale":
        rows.scale[on, j] *= value
        rows.shift[on, j] *= value
    elif event.kind in ("bias", "drift"):
        rows.shift[on, j] += value * (1.0 if event.kind == "bias" else (t[on] - event.time))
    elif event.kind == "noise":
        rows.sigma[on, j] = np.hypot(rows.sigma[on, j], value)
    elif value is not None:
        rows.forced[on, j] = value
    else:
        (rows.frozen if event.kind == "frozen" else rows.dropped)[on, j] = 1.0


def acts(event: SensorFault | Upset, t: np.ndarray) -> np.ndarray:
    """The mask of the rows in which an event acts."""
    until = np.inf if event.until is None else event.until
    return (t >= event.time - SAME) & (t < until - SAME)


def _air(events: Sequence[Event], models: Sequence[StateSpace], phase: np.ndarray, t: np.ndarray) -> np.ndarray | None:
    """What gusts add to the outputs that are measured relative to the air, (T, p)."""
    gusts = [event for event in events if isinstance(event, Gust)]
    if not gusts:
        return None
    model = models[0]
    C, total = np.stack([one.C for one in models])[phase], np.zeros((len(t), model.p))
    for gust in gusts:
        column = C[:, :, entry(gust, model)]  # (T, p)
        seen = [gust.vanes is None or name in gust.vanes for name in model.outputs]
        total += value_of(gust, t)[:, None] * np.where(seen, column, 0.0)
    return total


def entry(gust: Gust, model: StateSpace) -> int:
    """The index of the state that a gust changes."""
    return 0 if gust.state is None else model.states.index(gust.state)


def value_of(gust: Gust, t: np.ndarray) -> np.ndarray:
    """The gust at the times t."""
    since = t - gust.time
    on = (since >= -SAME) & (since < gust.seconds - SAME)
    wave = (1 - np.cos(2 * np.pi * since / gust.seconds)) / 2 if gust.shape == "one_minus_cosine" else np.ones(len(t))
    return np.where(on, gust.amplitude * wave, 0.0)


def pushes(events: Sequence[Event], models: Sequence[StateSpace], phase: np.ndarray, t: np.ndarray, dt: float):
    """What upsets and gusts add to the next state, (T, n), exactly for a continuous model; None without any.

    `models`: of the phases; `phase` (T,): the phase of each row. The effect on a discrete model is that of the value at the
    sample.
    """
    active = [event for event in events if isinstance(event, Upset | Gust)]
    if not active:
        return None
    total = np.zeros((len(t), models[0].n))
    for event in active:
        for k in np.unique(phase):
            rows = phase == k
            now, model = t[rows], models[k]
            total[rows] += _upset(event, model, now, dt) if isinstance(event, Upset) else _gust(event, model, now, dt)
    return total


def _upset(event: Upset, model: StateSpace, t: np.ndarray, dt: float) -> np.ndarray:
    rates = event.rates(model)
    n = model.n
    step = (
        over(model.A, np.eye(n), np.zeros((n, n)), dt, hold="zero_order")[1] if model.is_continuous else dt * np.eye(n)
    )
    return np.outer(acts(event, t), step @ rates)


def _gust(event: Gust, model: StateSpace, t: np.ndarray, dt: float) -> np.ndarray:
    j = entry(event, model)
    if not model.is_continuous:
        return np.outer(value_of(event, t), (model.A - np.eye(model.n))[:, j])
    total = np.zeros((len(t), model.n))
    begin, end = event.time - t, event.time + event.seconds - t  # relative to each sample
    for i in np.flatnonzero((begin < dt - SAME) & (end > SAME)):
        total[i] = _gust_over(event, model, j, max(0.0, begin[i]), min(dt, end[i]), -begin[i], dt)
    return total


def _gust_over(event: Gust, model: StateSpace, j: int, a: float, b: float, since: float, dt: float) -> np.ndarray:
    """∫ e^{A (dt - s)} A e_j g ds over [a, b], by the exponential of the plant with an oscillator that makes g."""
    n, ω = model.n, 2 * np.pi / event.seconds
    M = np.zeros((n + 3, n + 3))
    M[:n, :n] = model.A
    wave = 0.5 if event.shape == "one_minus_cosine" else 0.0
    M[:n, n] = event.amplitude * model.A[:, j] * (wave if wave else 1.0)  # of the constant 1
    M[:n, n + 1] = -event.amplitude * model.A[:, j] * wave  # of cos
    M[n + 1, n + 2], M[n + 2, n + 1] = -ω, ω
    start = np.zeros(n + 3)
    start[n:] = 1.0, np.cos(ω * (since + a)), np.sin(ω * (since + a))
    moved = transition(M, b - a) @ start
    return transition(model.A, dt - b) @ moved[:n]
