"""Numbers of other people's codes; each file in tests/answers names its source."""

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimable import InputError, Kalman, Prior, Record, StateSpace, estimate
from oracles import textbook

ANSWERS = Path(__file__).parents[1] / "answers"


def read(name):
    return json.loads((ANSWERS / name).read_text())


def arrays(inputs):
    return {name: np.array(value) for name, value in inputs.items() if isinstance(value, list)}


def test_the_oracle_of_these_tests_is_slicot_s_conventional_filter():
    """FB01VD's example has an indefinite P and Q (its numbers are arbitrary): a formula takes them, `Prior` does not."""
    answer = read("kalman-steps.json")[0]
    given, expected = arrays(answer["inputs"]), arrays(answer["expected"])
    model = SimpleNamespace(
        n=4, p=2, varying=(), A=given["A"], B=np.zeros((4, 1)), C=given["C"], D=np.zeros((2, 1)), G=given["B"],
        Q=given["Q"], R=given["R"], S=None,
    )  # fmt: skip
    prior = SimpleNamespace(mean=np.zeros(4), covariance=given["P_pred"])
    _, covariances, _ = textbook.kalman(model, prior, np.zeros((1, 2)), np.zeros((1, 1)))
    predicted = model.A @ covariances[0] @ model.A.T + model.G @ model.Q @ model.G.T
    assert_allclose(predicted, expected["P_next_pred"], atol=6e-5)
    with pytest.raises(
        InputError, match=r"`covariance` must be positive semidefinite: its smallest eigenvalue is -0\.307"
    ):
        Prior(np.zeros(4), given["P_pred"])


def test_three_steps_of_slicot_s_square_root_filter_from_a_known_state():
    answer = read("kalman-steps.json")[1]
    given, expected = arrays(answer["inputs"]), arrays(answer["expected"])
    Lq, Lr = given["Q_sqrt"], given["R_sqrt"]
    model = StateSpace(given["A"], C=given["C"], G=given["B"], Q=Lq @ Lq.T, R=Lr @ Lr.T, dt=1)
    ours = estimate(Kalman(model), Record(np.zeros((3, 2)), dt=1), prior=Prior(np.zeros(4), given["S0"]))
    predicted = model.A @ ours.covariance[-1] @ model.A.T + model.G @ model.Q @ model.G.T
    assert_allclose(predicted, expected["P_next_pred"], atol=3e-4)


def presidents(φ, mean, variance):
    """An AR process about a mean, stationary at the first quarter of 1945, measured without noise where it was measured."""
    φ = np.atleast_1d(φ)
    n = len(φ)
    A = np.vstack([φ, np.eye(n - 1, n)])
    G = np.eye(n, 1)
    stationary = np.linalg.solve(np.eye(n * n) - np.kron(A, A), (variance * G @ G.T).ravel()).reshape(n, n)
    model = StateSpace(A, C=np.eye(1, n), G=G, Q=[[variance]], R=[[0.0]], dt=0.25)
    y = np.array([np.nan if v is None else v for v in read("presidents-missing.json")["inputs"]["y"]]) - mean
    prior = Prior(np.zeros(n), (stationary + stationary.T) / 2)
    return estimate(Kalman(model), Record(y, dt=0.25), prior=prior).log_likelihood


def test_the_exact_likelihood_of_r_s_arima_with_missing_data():
    given, expected = (read("presidents-missing.json")[part] for part in ("inputs", "expected"))
    assert_allclose(presidents(given["phi"], given["mean"], expected["sigma2"]), expected["loglik"], rtol=1e-9)


@pytest.mark.parametrize("order", ["mle_ar1", "mle_ar3"])
def test_the_maximum_that_r_found(order):
    mle = read("presidents-missing.json")["expected"][order]
    at_maximum = presidents(mle["phi"], mle["mean"], mle["sigma2"])
    assert_allclose(at_maximum, mle["loglik"], atol=1e-4)
    for step in (0.98, 1.02):
        assert presidents(mle["phi"], mle["mean"], step * mle["sigma2"]) < at_maximum
