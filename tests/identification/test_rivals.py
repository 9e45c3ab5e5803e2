"""Outputs seen at every n-th row: every model that fits as well is found, and none where there is one model."""

import numpy as np
import pytest
from benchmarks.figures.every_nth import drawn, found
from numpy.testing import assert_allclose
from scipy.signal import lfilter

import estimable as es
from estimable.identification.rivals import rotations
from estimable.kernels.missing_series import spacing


@pytest.mark.parametrize(("case", "count"), [("pole .8, N 2", 1), ("poles .6+-.37i, N 2", 1), ("poles .8, .5, N 2", 3)])
def test_rivals_are_found(case, count):
    assert max(found(seed, case)[0] for seed in range(3)) == count
    assert min(found(seed, case)[0] for seed in range(3)) > 0


@pytest.mark.parametrize("settings", [{"held": 1}, {"between": 0.02}], ids=["fast input", "rows between"])
def test_there_are_none_where_the_record_decides(settings):
    for seed in range(3):
        assert found(seed, "pole .8, N 2", **settings) == (0, True)


@pytest.mark.parametrize("method", [
    es.JointOutputError(1, 0, delay=1, noise_variance=0.01), es.RecursiveOutputError(1, 0, delay=1, noise_variance=0.01),
    es.OutputErrorML(1, 0, delay=1), es.Subspace(1, feedthrough=False),
], ids=lambda method: type(method).__name__)  # fmt: skip
def test_every_method_says_so(method):
    fit = es.identify(method, drawn(0, "pole .8, N 2"))
    (check,) = (one for one in fit.validation.checks if one.name == "rivals")
    assert not fit.validation.passed
    assert "1 other model fits y1 as well, which is seen every 2 rows" in check.sentence
    assert "See a few rows between, or move the input between them" in check.sentence


def test_the_rivals_fit_to_the_last_digit():
    record = drawn(0, "pole .8, N 2")
    fit = es.identify(es.OutputErrorML(1, 0, delay=1), record)
    both = np.vstack([fit.parameters, fit.rivals])
    both = both[np.argsort(both[:, 0])]
    assert_allclose(both[0], [-0.8, 0.5], atol=0.05)
    assert_allclose(both[1], [-both[0, 0], both[0, 1] * (1 - both[0, 0]) / (1 + both[0, 0])], rtol=0.02)
    e = [np.nansum((record.y[100:] - fit.model.with_parameters(θ).response(record.u)[100:]) ** 2) for θ in both]
    assert_allclose(e[0], e[1], rtol=1e-3)


def test_a_prior_picks_one():
    prior = es.Prior([-0.7, 0.5], np.diag([0.04, 1.0]))
    fit = es.identify(es.JointOutputError(1, 0, delay=1, noise_variance=0.01, prior=prior), drawn(0, "pole .8, N 2"))
    assert fit.rivals is None
    assert np.all(np.abs(fit.parameters - [-0.8, 0.5]) < 4 * fit.sigma)


def test_a_high_degree_is_said_and_not_searched():
    g = np.random.default_rng(0)
    u = np.repeat(g.normal(size=200), 2)
    y = np.where(np.arange(400) % 2 == 0, lfilter([0, 0.5], [1, -0.8], u) + 0.1 * g.normal(size=400), np.nan)
    fit = es.identify(es.OutputErrorML(4, 0, delay=1), es.Record(y, u, dt=1))
    assert "A has too high a degree to search them" in " ".join(fit.validation.sentences)


def test_rotated_poles_stay_real():
    assert [one.tolist() for one in rotations(np.array([-0.8]), 2)] == [[0.8]]
    assert rotations(np.array([-0.8]), 3) == []
    assert len(rotations(np.array([-1.3, 0.4]), 2)) == 3


def test_the_spacing_of_seen_rows():
    every_third = np.arange(30) % 3 == 0
    assert spacing([every_third]) == 3
    assert spacing([every_third, np.arange(30) % 6 == 1]) == 3
    assert spacing([np.ones(5, bool)]) == spacing([np.zeros(5, bool)]) == 1
