"""The families of tests: right sizes under a right model, and each its own fault."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimable.diagnostics import model_tests as tests

RNG = np.random.default_rng(0)


@pytest.mark.parametrize(
    "family", [tests.size, tests.whiteness, lambda ε: tests.bursts(ε, 0.01)], ids=["size", "whiteness", "bursts"]
)
@pytest.mark.parametrize("missing", [0.0, 0.3])
def test_a_right_model_fails_as_often_as_it_may(family, missing):
    """White innovations: a p-value below 5 % in at most 5 % of 400 draws, give or take three standard errors."""
    found = []
    for _ in range(400):
        ε = RNG.normal(size=(1200, 2))
        ε[RNG.random(ε.shape) < missing] = np.nan
        found.append(family(ε))
    share = np.mean(np.array(found) < 0.05)
    assert share < 0.05 + 3 * np.sqrt(0.05 * 0.95 / 400)
    assert share > 0.005  # the test can fail


@pytest.mark.parametrize(
    ("family", "wrong"),
    [
        (tests.size, lambda e: 1.1 * e),
        (tests.size, lambda e: 0.9 * e),
        (tests.whiteness, lambda e: e + 0.3 * np.roll(e, 1, axis=0)),
        (tests.whiteness, lambda e: e + np.sin(np.arange(len(e)) / 200)[:, None]),
        (tests.whiteness, lambda e: e + 0.3 * e[:, ::-1]),
        (lambda e: tests.bursts(e, 0.01), lambda e: np.where(np.arange(len(e))[:, None] // 100 == 3, 1.7, 1.0) * e),
    ],
)
def test_each_fault_is_found(family, wrong):
    ε = np.random.default_rng(1).normal(size=(1200, 2))
    assert family(ε) > 0.01
    assert family(wrong(ε)) < 1e-4


def test_correlated_outputs_become_independent_ones_whatever_is_missing():
    S = np.array([[2.0, 0.9], [0.9, 1.0]])
    e = RNG.normal(size=(500, 2)) @ np.linalg.cholesky(S).T
    e[::7, 0], e[3::11, 1] = np.nan, np.nan
    ε = tests.whitened(e, np.broadcast_to(S, (500, 2, 2)))
    assert np.array_equal(np.isnan(ε), np.isnan(e))
    L = np.linalg.inv(np.linalg.cholesky(S))
    both = ~np.isnan(e).any(axis=1)
    assert_allclose(ε[both], e[both] @ L.T, rtol=1e-12)
    assert_allclose(ε[::7, 1][~np.isnan(e[::7, 1])], e[::7, 1][~np.isnan(e[::7, 1])], rtol=1e-12)  # alone: divided by 1
    known = tests.whitened(np.ones((2, 1)), np.array([[[0.0]], [[4.0]]]))
    assert np.isnan(known[0, 0])
    assert known[1, 0] == 0.5


def test_the_joint_score_does_not_depend_on_units_and_passes_over_what_is_not_known():
    J = RNG.normal(size=(3, 50))
    H, s = J @ J.T, J @ RNG.normal(size=50)
    from scipy.stats import chi2

    assert_allclose(tests.joint_score(s, H), chi2.sf(s @ np.linalg.solve(H, s), 3), rtol=1e-10)
    units = np.array([1e6, 1e-4, 1.0])
    assert_allclose(tests.joint_score(units * s, np.outer(units, units) * H), tests.joint_score(s, H), rtol=1e-8)
    wide = np.zeros((4, 4))
    wide[:3, :3] = H
    assert_allclose(tests.joint_score(np.append(s, 0), wide), tests.joint_score(s, H), rtol=1e-12)
    assert tests.joint_score(np.zeros(2), np.zeros((2, 2))) == 1.0
    twice = np.array([[1.0, 1.0], [1.0, 1.0]])  # one direction under two names
    assert_allclose(tests.joint_score(np.array([3.0, 3.0]), twice), tests.normal(3.0), rtol=1e-10)


def test_so_many_alarms_are_false_by_the_poisson_law_of_the_bound():
    assert tests.alarms(0, 16.5, 3600) == tests.alarms(1, 16.5, 3600) == tests.alarms(2, 16.5, 3600) == 1.0
    assert tests.alarms(3, 16.5, 3600) < 1e-7
    assert tests.alarms(4, 3600.0, 3600) == 1.0


def test_nothing_seen_is_no_evidence():
    blind = np.full((50, 2), np.nan)
    assert tests.size(blind) == tests.whiteness(blind) == tests.bursts(blind, 0.1) == 1.0
