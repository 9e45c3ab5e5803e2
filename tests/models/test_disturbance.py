"""markov_disturbance: its process, its start, and its errors."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimable import (
    ExtendedKalman,
    Kalman,
    Prior,
    Record,
    StateSpace,
    UnknownGain,
    estimate,
    markov_disturbance,
)

PLANT = StateSpace(
    [[-1.0, 0.3], [0.0, -2.0]], [[0.5], [2.0]], [[1.0, 0.0]], Q=0.1 * np.eye(2), R=[[0.01]], dt=0, states=["slow", "fast"],
    operating_point={"states": [3.0, 4.0]},
)  # fmt: skip
RECORD = Record(
    np.random.default_rng(0).normal(size=(30, 1)) + 3.0, np.random.default_rng(1).normal(size=(30, 1)), dt=0.1
)


def test_its_process_has_the_variance_and_the_density_of_its_definition():
    lasting = markov_disturbance(PLANT, time_constant=[0.5, 2.0], density=[0.2, 0.3])
    assert lasting.states == ("slow", "fast", "disturbance_slow", "disturbance_fast")
    A, noise = lasting.A[2:, 2:], lasting.Q[2:, 2:]
    variance = np.diag([0.2 / (2 * 0.5), 0.3 / (2 * 2.0)])
    assert_allclose(A @ variance + variance @ A.T + noise, 0.0, atol=1e-15)  # stationary
    at_zero = np.linalg.solve(A, noise) @ np.linalg.inv(A).T
    assert_allclose(at_zero, np.diag([0.2, 0.3]))
    assert_allclose(lasting.A[:2, 2:], np.eye(2))
    assert_allclose(lasting.disturbance.variance, np.diag(variance))
    assert_allclose(lasting.operating_point.states, [3.0, 4.0, 0.0, 0.0])


@pytest.mark.parametrize("filter", [Kalman, ExtendedKalman, lambda m: UnknownGain(m, Prior([1.0], [[0.1]]))])
def test_a_prior_without_the_disturbances_has_theirs_from_the_model(filter):
    lasting = markov_disturbance(
        markov_disturbance(PLANT, time_constant=0.5, density=0.2, states=["fast"]), time_constant=None, density=0.7
    )
    assert lasting.states[2:] == ("disturbance_fast", "offset_slow", "offset_fast")
    some, every = Prior([3.0, 4.0], np.eye(2)), Prior([3.0, 4.0, 0, 0, 0], np.diag([1.0, 1.0, 0.2, 0.49, 0.49]))
    a, b = (estimate(filter(lasting), RECORD, prior=prior) for prior in (some, every))
    assert_allclose(a.mean, b.mean, rtol=1e-12)
    assert_allclose(a.log_likelihood, b.log_likelihood, rtol=1e-12)


def test_a_fast_one_is_white_noise_and_a_slow_one_an_offset():
    prior = Prior([3.0, 4.0], np.eye(2))
    white = StateSpace(PLANT.A, PLANT.B, PLANT.C, Q=PLANT.Q + 0.2 * np.eye(2), R=PLANT.R, dt=0, states=PLANT.states,
                       operating_point={"states": [3.0, 4.0]})  # fmt: skip
    fast = estimate(Kalman(markov_disturbance(PLANT, time_constant=1e-6, density=0.2)), RECORD, prior=prior)
    assert_allclose(fast.log_likelihood, estimate(Kalman(white), RECORD, prior=prior).log_likelihood, rtol=1e-4)
    slow = estimate(Kalman(markov_disturbance(PLANT, time_constant=1e6, density=2e6 * 0.49)), RECORD, prior=prior)
    offset = estimate(Kalman(markov_disturbance(PLANT, time_constant=None, density=0.7)), RECORD, prior=prior)
    assert_allclose(slow.log_likelihood, offset.log_likelihood, rtol=1e-5)


def test_a_discrete_model_gains_it_too():
    fine = 1e-3
    discrete = PLANT.discretise(fine)
    plain = StateSpace(discrete.A, discrete.B, discrete.C, Q=discrete.Q, R=discrete.R, dt=fine, states=PLANT.states)
    ours = markov_disturbance(plain, time_constant=0.5, density=0.2)
    exact = markov_disturbance(PLANT, time_constant=0.5, density=0.2).discretise(fine)
    assert_allclose(ours.A, exact.A, atol=2e-6)
    assert_allclose(ours.Q[2:, 2:], exact.Q[2:, 2:], rtol=1e-9)
    assert exact.disturbance.discretised
