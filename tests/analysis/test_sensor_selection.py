"""The chosen sensors against every set, and where greedy fails."""

from itertools import combinations

import numpy as np
import pytest

from estimable import InputError, Prior, StateSpace, covariance_analysis, sensor_selection


def drawn(seed, n=4, p=6):
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(n, n))
    A *= 0.95 / np.abs(np.linalg.eigvals(A)).max()
    return StateSpace(
        A, C=rng.normal(size=(p, n)), Q=np.diag(rng.uniform(0.01, 1, n)), R=np.diag(rng.uniform(0.01, 4, p)), dt=1
    )


@pytest.mark.parametrize("seed", range(3))
def test_no_other_set_is_better(seed):
    model, want = drawn(seed), {"x1": 1.0, "x3": 0.5}
    prior = Prior(np.zeros(4), np.eye(4))
    found = sensor_selection(model, prior=prior, choose=2, requirement=want, horizon=9)
    assert found.exact

    def worst(rows):
        part = StateSpace(model.A, C=model.C[rows], Q=model.Q, R=model.R[np.ix_(rows, rows)], dt=1)
        σ = covariance_analysis(part, prior=prior, horizon=9).sigma[-1]
        return max(σ[0] / 1.0, σ[2] / 0.5)

    every = {rows: worst(list(rows)) for rows in combinations(range(6), 2)}
    assert found.worst == pytest.approx(min(every.values()), rel=1e-9)
    best = min(every, key=lambda rows: every[rows])
    assert found.sensors == tuple(model.outputs[i] for i in best)
    assert found.worst_all <= found.worst


def test_the_exact_choice_finds_what_greedy_misses():
    """Two sensors that help only together; the third helps at once, and greedy takes it."""
    ε = 1e-2
    model = StateSpace(
        np.eye(2),
        C=[[1, 1 / ε], [0, 1 / ε], [1, 0]],
        Q=np.diag([1, 1e-18]),
        R=np.diag(np.square([1e-3, 1e-3, 0.5])),
        dt=1,
    )
    given = {"prior": Prior([0, 0], np.eye(2)), "choose": 2, "horizon": 9, "requirement": {"x1": 1.0}}
    exact, greedy = sensor_selection(model, **given), sensor_selection(model, **given, method="greedy")
    assert exact.sensors == ("y1", "y2")
    assert exact.worst <= greedy.worst
    assert not greedy.exact
    assert "no other set" in exact.sentences[0]


def test_some_hundred_sets_decide_among_thousands():
    model = drawn(8, n=5, p=14)
    found = sensor_selection(model, prior=Prior(np.zeros(5), np.eye(5)), choose=4)
    assert found.exact
    assert found.evaluations < 400  # of 1,001
    assert len(found.sensors) == 4


def test_unknown_names_and_numbers_are_refused():
    prior = Prior(np.zeros(4), np.eye(4))
    with pytest.raises(InputError, match="`candidates` names 'gps'"):
        sensor_selection(drawn(0), prior=prior, choose=1, candidates=["gps"])
    with pytest.raises(InputError, match="`choose` must be"):
        sensor_selection(drawn(0), prior=prior, choose=7)
