"""Lost samples: known answers, the filter with rows that are missing, gains that prove, what has no answer."""

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimable import (
    AssumptionError,
    InputError,
    Kalman,
    Prior,
    Record,
    StateSpace,
    estimate,
    kalman_gain,
    loss_tolerance,
)
from estimable.kernels.losses import stabilising_gain

I2 = np.eye(2)
SHARED = Path(__file__).parents[3] / "shared" / "data" / "known-answers.json"
A2 = np.array([[1.2, 0.3], [0.0, 1.1]])


def model(A, C=None, **noises):
    n = len(A)
    C = np.eye(n) if C is None else C
    return StateSpace(A, C=C, **({"Q": np.eye(n), "R": np.eye(len(C))} | noises), dt=1)


def test_sinopoli_s_scalar_against_the_closed_form():
    found = loss_tolerance(model([[1.25]]))
    assert_allclose([found.lower, found.upper], 0.36, rtol=1e-12)
    for rate, X in {1.0: 2.0502462815154345, 0.8: 2.7934296485052896, 0.5: 7.733943509809562}.items():
        assert_allclose(found.at(rate).upper, [[X]], rtol=1e-9)
        assert found.at(rate).bounded == "yes"
    below = found.at(0.35)
    assert (below.bounded, below.upper[0, 0], below.lower[0, 0]) == ("no", np.inf, np.inf)


def test_the_shared_answers_are_those_of_the_test():
    if not SHARED.exists():
        pytest.skip("the shared data are not here")
    expected = next(a for a in json.loads(SHARED.read_text()) if "Sinopoli" in a["id"])["expected"]
    found = loss_tolerance(model([[1.25]]))
    assert_allclose(found.upper, expected["lambda_c"], rtol=1e-9)
    assert_allclose(found.at(0.8).upper, expected["P_lambda_08"], rtol=1e-9)


def test_every_sample_or_none():
    A = 0.7 * A2
    stable = loss_tolerance(model(A))
    assert (stable.lower, stable.upper, stable.exact) == (0.0, 0.0, True)
    assert_allclose(stable.at(0.0).upper, stable.at(0.0).lower, rtol=1e-10)
    crossed = model(A, [[1.0, 0.0]], R=[[0.5]], S=[[0.3], [-0.2]])
    assert_allclose(loss_tolerance(crossed).at(1.0).upper, kalman_gain(crossed).predicted_covariance, rtol=1e-9)


def test_it_solves_the_modified_riccati_equation_and_nothing_less():
    plant = model(A2, [[1.0, 0.0]], R=[[0.5]])
    found = loss_tolerance(plant)
    assert_allclose(found.upper, 1 - 1 / (1.2 * 1.1) ** 2, rtol=1e-12)
    X = found.at(0.6).upper
    back = A2 @ X @ A2.T + I2 - 0.6 * (A2 @ X[:, :1]) @ (A2 @ X[:, :1]).T / (X[0, 0] + 0.5)
    assert_allclose(back, X, rtol=1e-10)
    assert (found.at(0.35).bounded, found.at(0.2).bounded) == ("unknown", "no")


def test_the_closed_form_of_one_output_is_where_gains_begin_to_exist():
    critical = 1 - 1 / (1.2 * 1.1) ** 2
    parts = A2, np.array([[1.0, 0.0]]), I2, np.eye(1), np.zeros((2, 1))
    assert stabilising_gain(*parts, critical + 0.01) is not None
    assert stabilising_gain(*parts, critical - 0.01) is None


def test_two_outputs_of_three_unstable_states_lie_between():
    A, C = np.diag([1.3, 1.2, 1.1]), np.array([[1.0, 1.0, 0.0], [0.0, 1.0, 1.0]])
    found = loss_tolerance(model(A, C))
    assert_allclose(found.lower, 1 - 1 / 1.3**2, rtol=1e-12)
    assert found.lower <= found.upper < 1 - 1 / np.linalg.det(A) ** 2
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    turned = loss_tolerance(model(turn @ A @ turn.T, C @ turn.T))
    assert_allclose([turned.lower, turned.upper], [found.lower, found.upper], atol=2e-3)


def test_a_stable_part_changes_nothing():
    A = np.array([[1.25, 0.0], [0.4, 0.5]])
    found = loss_tolerance(model(A, [[1.0, 0.7]]))
    assert_allclose([found.lower, found.upper], 0.36, rtol=1e-9)


def test_the_filter_s_covariance_with_missing_rows_lies_between():
    rate, T = 0.7, 200_000
    plant = model(A2, [[1.0, 0.0]], R=[[0.5]])
    found = loss_tolerance(plant).at(rate)
    y = np.where(np.random.default_rng(3).random((T, 1)) < rate, 0.0, np.nan)
    kept = estimate(Kalman(plant), Record(y, dt=1), prior=Prior([0.0, 0.0], I2)).covariance[50:]
    mean = np.mean(A2 @ kept @ A2.T + I2, axis=0)
    assert np.linalg.eigvalsh(mean - found.lower).min() > 0
    assert np.linalg.eigvalsh(found.upper - mean).min() > 0


def test_what_has_no_answer():
    unseen = model(np.diag([1.2, 0.5]), [[0.0, 1.0]])
    with pytest.raises(AssumptionError, match="no arrival rate is enough: x1 never shows in y1"):
        loss_tolerance(unseen)
    wrong = {
        "`model` must be a StateSpace. Got 1.": lambda: loss_tolerance(1),
        "`model` is continuous": lambda: loss_tolerance(StateSpace([[1.0]], Q=[[1.0]], R=[[1.0]], dt=0)),
        "`model` has no R": lambda: loss_tolerance(StateSpace([[1.0]], dt=1)),
        "`R` must be positive definite": lambda: loss_tolerance(model([[1.2]], R=[[0.0]])),
        "`model` must have at most 30 states. Got 31.": lambda: loss_tolerance(model(np.eye(31))),
        "`model` varies in time": lambda: loss_tolerance(
            StateSpace(np.ones((3, 1, 1)), np.ones((1, 1)), Q=[[1.0]], R=[[1.0]], dt=1)
        ),
        "`rate` must be": lambda: loss_tolerance(model([[1.2]])).at(1.2),
    }
    for sentence, call in wrong.items():
        with pytest.raises(InputError) as refusal:
            call()
        assert sentence in str(refusal.value)
