"""Possible onsets of a change, on a grid that coarsens with their age.

Level l = 0, 1, .. has `slots` onsets and moves by one slot every 2^l rows: it holds every 2^l-th row. What leaves level l
enters level l + 1 where that moves too, or is empty; else the onset is lost, and the seconds that it represents go to the
youngest onset of that level. At each row at most one onset is lost. The grid reaches back slots (2^levels - 1) rows at the cost
of slots · levels onsets. One further place for each label (a kind of change) is reserved for a protected onset: one that is lost
while it is the likeliest onset of its label by a log-likelihood ratio above `PROTECTED`.

Arrays of the onsets have their axis last: level 0 first, the youngest onset of each level first, then the protected onsets.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from .shapes import Bool, Float
from .small import Real

PROTECTED = 4.0  # log-likelihood ratio of an onset that is not given up while it is the likeliest


class Grid(NamedTuple):
    """The number of onsets of each level, of levels, and of labels."""

    slots: int
    levels: int
    labels: int

    @property
    def size(self) -> int:
        """The number of onsets."""
        return self.slots * self.levels + self.labels

    @property
    def reach(self) -> int:
        """The age in rows of the oldest onset."""
        return self.slots * (2**self.levels - 1)

    @property
    def level(self) -> np.ndarray:
        """The level of each onset that is not protected."""
        return np.repeat(np.arange(self.levels), self.slots)


def by_level(values: Float[Real, "... r"], grid: Grid) -> Float[Real, "... l s"]:
    """The values of the onsets of each level; each protected onset is one more level, with zeros."""
    count = grid.slots * grid.levels
    levels = values[..., :count].reshape(*values.shape[:-1], grid.levels, grid.slots)
    alone = values[..., count:, None]
    zeros = jnp.zeros((*alone.shape[:-1], grid.slots - 1))
    return jnp.concatenate([levels, jnp.concatenate([alone, zeros], axis=-1)], axis=-2)


class Move(NamedTuple):
    """The changes of the grid at a row: which onsets move (slots · levels,), which one is lost, the labels that protect it,
    the onset that inherits seconds, and the empty place that the lost one takes."""

    shifts: Bool[Real, " s"]
    lost: Bool[Real, " s"]
    taken: Bool[Real, " h"]
    heir: Bool[Real, " s"]
    filled: Bool[Real, " s"]


def move_to(row: Real, seconds: Float[Real, " r"], profile: Float[Real, "h r"], grid: Grid) -> Move:
    """The move to `row` (1, 2, ..). `seconds` that each onset represents, 0 for none; `profile`: the log-likelihood ratio of each
    label at each onset, -inf for none."""
    level = grid.level
    last, first = np.roll(np.diff(level, prepend=level[-1] + 1) != 0, -1), np.diff(level, prepend=-1) != 0
    shifts = (row & (2**level - 1)) == 0
    follows = jnp.concatenate([shifts[1:], jnp.zeros(1, bool)])  # the level after this one moves too
    lost = last & shifts & ~follows
    heir = jnp.concatenate([jnp.zeros(1, bool), lost[:-1]]) & first
    its = jnp.sum(jnp.where(lost[None], profile[:, : len(level)], 0.0), axis=1)
    taken = (its > PROTECTED) & (its >= jnp.max(profile, axis=1))
    earlier = np.tri(grid.labels, grid.labels, -1, bool)
    taken = taken & ~jnp.any(earlier & taken[None, :], axis=1)  # one label keeps it
    empty = heir & (seconds[: len(level)] == 0)
    return Move(shifts, lost, taken, heir & ~empty, empty & ~jnp.any(taken))


def moved(values: Float[Real, "... r"], new: Float[Real, "..."], move: Move) -> Float[Real, "... r"]:
    """The values of the onsets after a move; `new`: that of the row itself."""
    count = len(move.shifts)
    there, protected = values[..., :count], values[..., count:]
    shifted = jnp.concatenate([new[..., None], there[..., :-1]], axis=-1)
    shifts, lost, taken, filled = (
        x.reshape((1,) * (there.ndim - 1) + x.shape) for x in (move.shifts, move.lost, move.taken, move.filled)
    )
    given_up = jnp.sum(jnp.where(lost, there, 0.0), axis=-1, keepdims=True)
    kept = jnp.where(filled, given_up, jnp.where(shifts, shifted, there))
    return jnp.concatenate([kept, jnp.where(taken, given_up, protected)], axis=-1)


def moved_seconds(seconds: Float[Real, " r"], new: Float[Real, ""], move: Move) -> Float[Real, " r"]:
    """The seconds that each onset represents after a move. Their sum grows by `new` until the oldest onset leaves the grid."""
    count, any_taken = len(move.shifts), jnp.any(move.taken)
    lost = jnp.sum(jnp.where(move.lost, seconds[:count], 0.0))
    displaced = jnp.sum(jnp.where(move.taken, seconds[count:], 0.0))
    inherited = jnp.where(any_taken, displaced, lost)
    heir = jnp.concatenate([move.heir, jnp.zeros(len(seconds) - count, bool)])
    return moved(seconds, new, move) + jnp.where(heir, inherited, 0.0)
