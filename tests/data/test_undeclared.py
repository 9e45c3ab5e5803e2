"""Channels that jump by a turn are pointed out; ordinary ones are not."""

import numpy as np
import pytest

from estimable import checks
from estimable.data.undeclared import check, jump


def headings(count, period, lower):
    """Turns at different rates, with noise and missing samples, in the range of an angle."""
    rng = np.random.default_rng(1)
    for _ in range(count):
        rows, rate = int(rng.integers(60, 600)), period * rng.uniform(0.02, 0.1) * rng.choice([-1, 1])
        turned = np.cumsum(rate * (1 + 0.3 * rng.normal(size=rows))) + 0.01 * period * rng.normal(size=rows)
        logged = np.mod(turned - lower, period) + lower
        logged[rng.random(rows) < 0.05] = np.nan
        yield logged


@pytest.mark.parametrize(("period", "unit"), [(2 * np.pi, "rad"), (360.0, "deg")])
@pytest.mark.parametrize("share", [-0.5, 0.0])
def test_a_heading_that_wraps_is_pointed_out(period, unit, share):
    found = [jump(one) for one in headings(50, period, share * period)]
    assert all(one is not None and one[2] == unit for one in found)
    for logged in headings(50, period, share * period):
        bank = np.stack([logged[:, None], np.full((len(logged), 1), np.nan)])
        faults = checks.Faults()
        check(bank, ["yaw"], [], faults)
        assert len(faults.sentences) == 1


def test_the_row_is_that_after_the_jump():
    v = np.mod(np.linspace(2.0, 7.0, 51) + np.pi, 2 * np.pi) - np.pi
    assert jump(v) == (12, "2 pi", "rad")
    v[3] = np.nan
    assert jump(v) == (12, "2 pi", "rad")


def ordinary(count):
    """Records of about the size of a turn that are no angles."""
    rng = np.random.default_rng(2)
    for i in range(count):
        rows, size = int(rng.integers(30, 600)), (2 * np.pi, 360.0)[i % 2] * rng.uniform(0.3, 3)
        k, w = np.arange(rows), rng.normal(size=rows)
        spikes = 0.05 * size * w
        spikes[rng.integers(0, rows, 3)] += size
        yield from (
            size * w,
            size * np.cumsum(w) / np.sqrt(rows),
            size * np.sin(k * rng.uniform(0.01, 2)) + 0.02 * size * w,
            size * rng.uniform(-0.5, 0.5, rows),
            np.where(k > rows // 2, size, 0.0) + 0.01 * size * w,
            spikes,
        )


def test_ordinary_records_are_not_pointed_out():
    assert [one for one in map(jump, ordinary(50)) if one is not None] == []


@pytest.mark.parametrize("v", [np.full(50, np.nan), np.zeros(50), np.array([0.0, 6.28]), np.array([1.0, np.nan, 2.0])])
def test_records_without_steps(v):
    assert jump(v) is None
