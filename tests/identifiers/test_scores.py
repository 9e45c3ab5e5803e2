"""Score tests of the link and the plant: size, power, the right row, and what their sentences advise."""

import numpy as np
import pytest
from benchmarks.figures.link_faults import FAULTS, A, B, drawn, fitted, rates
from scipy.signal import lfilter

import estimable as es
from estimable.kernels import scores as kernel


def test_a_right_fit_passes():
    found = [fitted(seed) for seed in range(40)]
    assert sum(all(row.passed for row in rows) for rows in found) >= 38
    z = np.array([[row.value for row in rows if row.name != "offset"] for rows in found])
    assert 0.85 < np.sqrt(np.mean(z**2)) < 1.15


@pytest.mark.parametrize(("fault", "row"), FAULTS.items(), ids=FAULTS.values())
def test_a_fault_fails_its_own_row(fault, row):
    found = [{one.name: abs(one.value) for one in fitted(seed, fault)} for seed in range(8)]
    weak = fault.startswith("output saturates")
    assert sum(one[row] > 3.5 for one in found) >= (4 if weak else 7)
    assert weak or sum(max(one, key=one.get) == row for one in found) >= 5


def test_the_check_names_the_largest_first_and_the_next_call():
    fit = es.identify(es.OutputErrorML(2, 1), drawn(0, "hold"))
    (check,) = (one for one in fit.validation.checks if one.name == "scores")
    assert not fit.validation.passed
    assert "held is" in check.sentence
    assert 'say lost="hold" in the Record' in check.sentence
    assert abs(check.value) == max(abs(row.value) for row in fit.validation.scores)


def test_a_held_input_that_is_zero_is_seen():
    g = np.random.default_rng(0)
    u, came = g.normal(size=600), g.random(600) < 0.8
    y = lfilter([1.0], [1, -0.5], u * came) + 0.2 * g.normal(size=600)
    record = es.Record(y, u, dt=1, arrived=came[:, None] * 1.0, lost="hold")
    fit = es.identify(es.OutputErrorML(1, 0), record)
    worst = max(fit.validation.scores, key=lambda row: abs(row.value))
    assert worst.name == "zero"
    assert 'lost="zero"' in worst.sentence


def test_what_the_fit_contains_is_no_score():
    z, e = np.random.default_rng(0).normal(size=(2, 100))
    assert kernel.scores(z[:, None], np.column_stack([z, e]), e, np.arange(100))[0] == 0


def test_the_rate_of_arrival_is_estimated():
    for arrival, sd in ((0.95, 0.018), (0.6, 0.03)):
        found = rates(12, arrival)
        assert abs(found[:, 0].mean() - arrival) < 4 * sd / np.sqrt(12)
        assert 0.5 < np.sqrt(np.mean(((found[:, 0] - arrival) / found[:, 1]) ** 2)) < 1.6


@pytest.mark.parametrize(("said", "passes"), [(0.7, True), (0.95, False)])
def test_a_given_rate_of_arrival_is_checked(said, passes):
    g = np.random.default_rng(0)
    u, came = g.normal(size=1200), g.random(1200) < 0.7
    y = lfilter([1.0], [1, -0.5], u * came) + 0.3 * g.normal(size=1200)
    record = es.Record(y, u, dt=1, arrived=np.full((1200, 1), np.nan))
    fit = es.identify(es.OutputErrorML(1, 0, arrival=said), record)
    (row,) = fit.validation.scores
    assert row.passed == passes
    assert f"`arrival` is {said:g}" in row.sentence
    assert passes or "give arrival=0.7" in row.sentence or "give arrival=0.6" in row.sentence


def test_losses_that_nobody_reports_are_seen():
    g = np.random.default_rng(0)
    u = g.normal(size=1200)
    y = lfilter([1.0], [1, -0.5], u * (g.random(1200) < 0.7)) + 0.3 * g.normal(size=1200)
    fit = es.identify(es.OutputErrorML(1, 0), es.Record(y, u, dt=1))
    worst = max(fit.validation.scores, key=lambda row: abs(row.value))
    assert worst.name == "lost inputs"
    assert "give `arrival`" in worst.sentence


@pytest.mark.parametrize("first", [True, False])
def test_losses_in_some_records_only_are_tested(first):
    g = np.random.default_rng(3)
    u = g.normal(size=600)
    whole = es.Record(lfilter(B, A, u) + 0.3 * g.normal(size=600), u, dt=1)
    records = [drawn(0, "hold"), whole] if first else [whole, drawn(0, "hold")]
    fit = es.identify(es.OutputErrorML(2, 1), records)
    assert max(fit.validation.scores, key=lambda row: abs(row.value)).name == "held"
