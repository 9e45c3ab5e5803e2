"""The grid of onsets against a list that is moved by its description."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from estimable.kernels import onset_grid
from estimable.kernels.onset_grid import Grid, moved, moved_seconds


def follow(grid, rows, profile_of=None):
    """Onsets and seconds of each row, by the kernel; `profile_of` gives the profile of the onsets (0: none)."""

    @jax.jit
    def step(row, onsets, seconds, profile):
        move = onset_grid.move_to(row, seconds, profile, grid)
        return moved(onsets, row.astype(float), move), moved_seconds(seconds, jnp.asarray(0.5), move)

    onsets, seconds = jnp.zeros(grid.size), jnp.zeros(grid.size)
    for row in range(1, rows + 1):
        flat = np.zeros((grid.labels, grid.size)) if profile_of is None else profile_of(np.asarray(onsets))
        profile = np.where(np.asarray(seconds) > 0, flat, -np.inf)
        onsets, seconds = step(jnp.asarray(row), onsets, seconds, profile)
        yield row, np.asarray(onsets).astype(int), np.asarray(seconds)


def by_description(slots, levels, rows):
    """Lists of [onset, seconds], the youngest first."""
    grid = [[] for _ in range(levels)]
    for row in range(1, rows + 1):
        leaving = [row, 0.5]
        for level in range(levels):
            if row % 2**level:
                if not grid[level]:
                    grid[level].append(leaving)
                else:
                    grid[level][0][1] += leaving[1]
                break
            grid[level].insert(0, leaving)
            leaving = grid[level].pop() if len(grid[level]) > slots else None
            if leaving is None:
                break
        yield [onset for part in grid for onset in part]


@pytest.mark.parametrize(("slots", "levels"), [(4, 3), (8, 4), (5, 1)])
def test_it_holds_the_onsets_and_seconds_of_its_description(slots, levels):
    grid = Grid(slots, levels, 1)
    for (row, onsets, seconds), expected in zip(follow(grid, 90), by_description(slots, levels, 90), strict=True):
        there = seconds > 0
        assert onsets[there].tolist() == [onset for onset, _ in expected]
        np.testing.assert_allclose(seconds[there], [weight for _, weight in expected])
        if row <= slots * (2 ** (levels - 1)):
            np.testing.assert_allclose(seconds.sum(), 0.5 * row)  # none is lost before the oldest leaves
        assert row - onsets[there].min() < grid.reach


def test_the_likeliest_onset_is_protected_for_as_long_as_it_is_the_likeliest():
    grid = Grid(4, 3, 2)
    for row, onsets, seconds in follow(
        grid, 200, lambda onsets: np.stack([np.where(onsets == 3, 9.0, 0.0), np.where(onsets == 150, 9.0, 0.0)])
    ):
        if row >= 3:
            assert 3 in onsets[seconds > 0]
        if row >= 150:
            assert 150 in onsets[seconds > 0]
        assert seconds.min() >= 0


def test_a_later_likeliest_onset_takes_the_place_and_the_seconds_pass_on():
    grid = Grid(4, 2, 1)
    likeliest = lambda onsets: np.where(onsets == (41 if onsets.max() > 41 else 3), 9.0, 0.0)[None]  # noqa: E731
    *_, (_, onsets, seconds) = follow(grid, 80, likeliest)
    assert onsets[-1] == 41
    assert 3 not in onsets[seconds > 0]


def test_an_onset_that_is_hardly_likelier_is_not_protected():
    grid = Grid(4, 2, 1)
    *_, (_, onsets, seconds) = follow(grid, 60, lambda onsets: np.where(onsets == 3, 3.9, 0.0)[None])
    assert 3 not in onsets[seconds > 0]


def test_the_grid_reaches_far_back_at_the_cost_of_few_onsets():
    grid = Grid(8, 8, 1)
    assert (grid.size, grid.reach) == (65, 2040)
