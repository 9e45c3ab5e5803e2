"""What is exactly unknown stays unknown, what is exactly known stays known, whatever rounding does."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimable import Kalman, Prior, Record, RunError, StateSpace, UnknownGain, estimate, simulate


def observed(result, c):
    """Standard deviation of c'x at each sample."""
    return np.sqrt(np.einsum("i,tij,j->t", c, result.covariance, c))


@pytest.mark.parametrize("seed", range(30))
def test_an_unobservable_diffuse_direction_is_never_determined_by_rounding(seed):
    """The span counts, not the basis: an orthogonal basis along the axes has no rounding at all."""
    rng = np.random.default_rng(seed)
    model = StateSpace(np.eye(2), C=[[1.0, 0.0]], R=[[0.01]], dt=1)
    record = Record(rng.normal(size=(20, 1)), dt=1)
    plain, skew = (
        estimate(Kalman(model), record, prior=Prior([0, 0], np.zeros((2, 2)), diffuse=D))
        for D in (np.eye(2), rng.normal(size=(2, 2)))
    )
    assert_allclose(observed(skew, np.array([1.0, 0.0])), 0.1 / np.sqrt(np.arange(1, 21)), rtol=1e-10)
    assert_allclose(skew.mean[:, 0], plain.mean[:, 0], rtol=1e-9, atol=1e-12)
    assert np.all(skew.diffuse_covariance[:, 1, 1] > 0)
    assert_allclose(np.diff(skew.log_likelihood_steps), np.diff(plain.log_likelihood_steps), atol=1e3)
    assert_allclose(skew.log_likelihood_steps[1:], plain.log_likelihood_steps[1:], rtol=1e-9)


def test_a_decaying_unobservable_direction_is_never_determined_by_rounding():
    T0 = np.array([[1.0, 0.3], [0.7, -1.2]])
    back = np.linalg.inv(T0)
    C = np.array([[1.0, 0.0]]) @ back
    model = StateSpace(T0 @ np.diag([1.0, 0.8]) @ back, C=C, R=[[0.01]], dt=1)
    record = Record(np.random.default_rng(0).normal(size=(400, 1)), dt=1)
    result = estimate(Kalman(model), record, prior=Prior([0, 0], np.zeros((2, 2)), diffuse=np.eye(2)))
    assert_allclose(observed(result, C[0]), 0.1 / np.sqrt(np.arange(1, 401)), rtol=1e-6)


def test_two_ganged_actuators_of_diffuse_gain_stay_undetermined_in_one_direction():
    model = StateSpace([[0.5]], [[0.5, 0.25]], Q=[[0.01]], R=[[0.01]], dt=1)
    u1 = np.sign(np.sin(np.arange(40.0) + 1))
    u = np.stack([u1, u1 / 2], axis=1)
    y = simulate(model, u, seed=0).record.y
    algorithm = UnknownGain(model, Prior([0, 0], np.zeros((2, 2)), diffuse=np.eye(2)), directions="per_input")
    result = estimate(algorithm, Record(y, u, dt=1), prior=Prior([0.0], [[0.0]]))
    effect = np.array([0.5, 0.125])  # all that the record can tell of the two
    found = result.gain @ effect
    sigma = np.sqrt(np.einsum("i,tij,j->t", effect, result.gain_covariance, effect))
    assert abs(found[-1] - effect.sum()) < 4 * sigma[-1] < 0.2
    diffuse = result.extra["gain_diffuse_covariance"][-1]
    assert np.trace(diffuse) > 0
    assert_allclose(effect @ diffuse @ effect, 0.0, atol=1e-12 * np.trace(diffuse))


def rotation(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def noise_free():
    """A rotation seen twice without noise: known exactly from the first sample on."""
    C = np.array([[1.3, 0.7], [0.4, -2.1]])
    model = StateSpace(rotation(0.3), C=C, R=np.zeros((2, 2)), dt=1)
    x, rows = np.array([1.0, 2.0]), []
    for _ in range(200):
        rows.append(C @ x)
        x = rotation(0.3) @ x
    return model, np.array(rows)


def test_what_became_known_exactly_says_nothing_more():
    model, y = noise_free()
    result = estimate(Kalman(model), Record(y, dt=1), prior=Prior([0, 0], np.eye(2)))
    assert np.all(result.log_likelihood_steps[1:] == 0.0)
    y[50] += 1.0
    with pytest.raises(RunError, match=r"At sample 50 .*contradicts"):
        estimate(Kalman(model), Record(y, dt=1), prior=Prior([0, 0], np.eye(2)))


def test_a_double_integrator_without_any_noise_is_known_from_its_second_sample():
    model = StateSpace([[1.0, 0.01], [0.0, 1.0]], C=[[1.0, 0.0]], R=[[0.0]], dt=0.01)
    y = simulate(model, seed=3, steps=300, prior=Prior([0, 0], np.eye(2))).record.y.copy()
    result = estimate(Kalman(model), Record(y, dt=0.01), prior=Prior([0, 0], np.eye(2)))
    assert np.all(result.log_likelihood_steps[2:] == 0.0)
    y[10] += 5.0
    with pytest.raises(RunError, match=r"At sample 10 .*contradicts"):
        estimate(Kalman(model), Record(y, dt=0.01), prior=Prior([0, 0], np.eye(2)))


def test_a_gain_without_any_noise_is_known_from_the_first_excited_sample():
    model = StateSpace([[0.9]], [[1.0]], C=[[1.7]], R=[[0.0]], dt=1)
    u = np.sin(np.arange(100.0) + 1)[:, None]
    doubled = StateSpace([[0.9]], [[0.6]], C=[[1.7]], R=[[0.0]], dt=1)
    record = Record(simulate(doubled, u, seed=0).record.y, u, dt=1)
    result = estimate(UnknownGain(model, Prior([1.0], [[1.0]])), record, prior=Prior([0.0], [[0.0]]))
    assert_allclose(result.gain[1:, 0], 0.6, rtol=1e-12)
    assert np.all(result.log_likelihood_steps[2:] == 0.0)


@pytest.mark.parametrize(
    ("model", "y", "u"),
    [
        (StateSpace([[1.0]], [[1.0]], R=[[0.0]], dt=1), [0, 0.1, 0.2, 0.3, 0.0], [0.1, 0.1, 0.1, -0.3, 0.0]),
        (
            StateSpace(rotation(np.pi / 2), C=[[1.0, 0.0]], R=[[0.0]], dt=1),
            np.cos(np.pi / 2 * np.arange(40)),
            np.zeros((40, 0)),
        ),
    ],
    ids=["an integrator", "an oscillator"],
)
def test_a_zero_crossing_of_what_is_known_exactly_is_no_contradiction(model, y, u):
    prior = Prior(np.eye(model.n)[0] * y[0], np.zeros((model.n, model.n)))
    result = estimate(Kalman(model), Record(y, u, dt=1), prior=prior)
    assert result.log_likelihood == 0.0


@pytest.mark.parametrize(("growth", "blind"), [(2.0, 600), (2.0, 1500), (0.9, 3600), (0.9, 8000)])
def test_what_is_unknown_stays_so_however_long_nothing_is_seen(growth, blind):
    model = StateSpace([[growth]], R=[[1.0]], dt=1)
    y = np.append(np.full(blind, np.nan), [1.0, growth, growth**2])
    result = estimate(Kalman(model), Record(y, dt=1), prior=Prior([0.0], [[0.0]], diffuse=[[1.0]]))
    assert_allclose(result.mean[-3:, 0], y[-3:], rtol=1e-12)
    information = np.cumsum(growth ** (2.0 * np.arange(3)))
    assert_allclose(result.covariance[-3:, 0, 0], growth ** (2.0 * np.arange(3)) / information, rtol=1e-12)
    assert np.all(result.diffuse_covariance[:-3, 0, 0] > 0)


def test_the_likelihood_of_a_diffuse_start_counts_how_far_the_unknown_has_grown():
    model = StateSpace([[2.0]], R=[[1.0]], dt=1)
    for blind in (10, 600):
        y = np.append(np.full(blind, np.nan), 1.0)
        result = estimate(Kalman(model), Record(y, dt=1), prior=Prior([0.0], [[0.0]], diffuse=[[1.0]]))
        assert_allclose(result.log_likelihood, -0.5 * np.log(2 * np.pi) - blind * np.log(2.0), rtol=1e-12)


def test_a_diffuse_gain_that_is_forgotten_for_long_is_still_learnt():
    model = StateSpace([[0.5]], [[1.0]], R=[[0.01]], dt=0.01)
    u = np.append(np.zeros(40_000), np.ones(50))
    x, y = 0.0, []
    for k in range(len(u)):
        y.append(x)
        x = 0.5 * x + 0.6 * u[k]
    algorithm = UnknownGain(model, Prior([1.0], [[0.0]], diffuse=[[1.0]]), forgetting=0.98)
    result = estimate(algorithm, Record(y, u, dt=0.01), prior=Prior([0.0], [[0.0]]), keep="last")
    assert_allclose(result.gain[-1, 0], 0.6, atol=1e-3)
    assert 0.005 < np.sqrt(result.gain_covariance[-1, 0, 0]) < 0.05


def test_an_overflow_of_a_proper_variance_is_called_so():
    model = StateSpace([[0.5]], [[1.0]], R=[[0.01]], dt=0.01)
    algorithm = UnknownGain(model, Prior([1.0], [[1.0]]), forgetting=0.98)
    with pytest.raises(RunError, match="no longer finite"):
        estimate(algorithm, Record(np.zeros(40_000), np.zeros(40_000), dt=0.01), prior=Prior([0.0], [[0.0]]))
