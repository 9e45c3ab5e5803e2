"""Channels that jump by a turn and are not declared as angles."""

from collections.abc import Sequence

import numpy as np

from .. import checks

TURNS = ((2 * np.pi, "2 pi", "rad"), (360.0, "360", "deg"))
ORDINARY = 1 / 3  # of a turn: the longest step between two samples of an angle that can be followed
REACH = 2.0  # times the longest ordinary step: how far a jump may be from a whole turn, and its ends from the ends of the range
LEAST = 0.025  # of a turn: the same, for a channel that hardly moves, and how far noise goes beyond the range
SMOOTH = 0.04  # of a turn: median step of a channel in which even a pair of jumps is no chance
USUAL = 0.1  # of a turn: the same, of the median step
NEAREST = 0.25  # of a turn: the same, at most
FEWEST = 40  # known samples: fewer may jump by about a turn by chance
HEAD = 50  # rows: a channel in which a step of these is neither ordinary nor a turn is no angle, and is looked at no further
OFTEN = 0.05  # of the samples: between the ends, or at jumps; else the channel steps from level to level


def jump(channel: np.ndarray) -> tuple[int, str, str] | None:
    """The row after the first jump of a channel (T,) by a turn, the turn as text, and its unit; None without one.

    The channel then has only two kinds of steps: ordinary ones, and jumps that differ from a turn by no more than those, from
    one end of the range of an angle to the other, and it is not at these ends alone.
    """
    rows = np.flatnonzero(~np.isnan(channel))
    if len(rows) < FEWEST:
        return None
    apart, v = np.diff(rows), channel[rows]
    together = apart == apart.min()  # a step over missing rows is longer than others
    before, after = v[:-1][together], v[1:][together]
    span, step = np.ptp(v), after - before
    for period, words, unit in TURNS:
        if span < period / 2:
            continue
        far = np.abs(step) > period / 2
        rest = _from_a_turn(step, period)
        if not far.any() or rest.max() > ORDINARY * period or np.median(rest[~far]) > USUAL * period:
            continue
        smooth = np.median(rest[~far]) <= SMOOTH * period
        near = min(max(LEAST * period, REACH * rest[~far].max(initial=0.0)), NEAREST * period)
        if (
            rest[far].max() <= near
            and (smooth or _stays(far))
            and _at_the_ends(v, before[far], after[far], period, near)
        ):
            return int(rows[1:][together][np.argmax(far)]), words, unit
    return None


def _from_a_turn(step: np.ndarray, period: float) -> np.ndarray:
    """How far each step is from the nearest multiple of a turn."""
    return np.abs(step - period * np.round(step / period))


def _may_jump(y: np.ndarray) -> np.ndarray:
    """Whether the whole of a channel need be looked at, by its first rows: y (.., T, p), the answer (.., p)."""
    span = np.fmax.reduce(y, axis=None, initial=-np.inf) - np.fmin.reduce(y, axis=None, initial=np.inf)
    step = np.diff(y[..., :HEAD, :], axis=-2)
    may = np.zeros((*y.shape[:-2], y.shape[-1]), bool)
    for period, *_ in TURNS:
        if span >= period / 2:
            may |= ~np.any(_from_a_turn(step, period) > ORDINARY * period, axis=-2)
    return may


def _stays(far: np.ndarray) -> bool:
    """Whether some jump is not taken back by the next sample, as that of a single large value is, or there are many."""
    neighbour = np.concatenate([[False], far[:-1]]) | np.concatenate([far[1:], [False]])
    return bool(np.any(far & ~neighbour) or far.sum() > 2)


def _at_the_ends(v: np.ndarray, before: np.ndarray, after: np.ndarray, period: float, near: float) -> bool:
    """Whether the values are in the range of an angle, about zero or from zero, and the jumps lead from end to end."""
    ends = np.concatenate([before, after])
    for lower in (-period / 2, 0.0):
        upper = lower + period
        to_end, inside = (np.minimum(np.abs(x - lower), np.abs(x - upper)) for x in (ends, v))
        moves = np.sum(inside > near) >= OFTEN * len(v) or len(before) >= OFTEN * len(v)
        rim = LEAST * period
        if v.min() >= lower - rim and v.max() <= upper + rim and to_end.max() <= near and moves:
            return True
    return False


def check(y: np.ndarray, names: Sequence[str], known: Sequence[str], faults: checks.Faults) -> None:
    """Point out each channel of y (.., T, p) that jumps by a turn. `known`: names whose declaration says what they are."""
    may = _may_jump(y)
    for j, name in enumerate(names):
        if name in known:
            continue
        for run in y[..., j][may[..., j]].reshape(-1, y.shape[-2]):
            if (found := jump(run)) is not None:
                row, words, unit = found
                faults.add(
                    f"{name} jumps by {words} at row {row}: declare it as an angle, angles={{{name!r}: {unit!r}}}, in the model "
                    f"or in the record. If it is not an angle, say so in the record: angles={{{name!r}: None}}."
                )
                break
