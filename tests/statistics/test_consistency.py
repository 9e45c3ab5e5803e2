"""Errors are as large as the covariances say."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimable import Kalman, Prior, Record, StateSpace, UnknownGain, estimate, estimate_bank, simulate_bank
from estimable.diagnostics import nees, nis
from estimable.plants import f16
from oracles.augmented import augmented, together

RUNS, T = 500, 120


def loop(walk):
    """A loop with process noise, two actuators of unknown gain, and a state that is not measured."""
    model = StateSpace(
        [[0.9, 0.2, 0.0], [-0.1, 0.8, 0.1], [0.0, 0.05, 0.7]], [[0.5, 0.0], [1.0, 0.3], [0.0, 1.0]],
        [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], Q=0.05 * np.eye(3), R=np.diag([0.1, 0.2]), dt=0.1,
    )  # fmt: skip
    gain, prior = Prior([1.0, 0.8], np.diag([0.5, 0.3])), Prior(np.zeros(3), 2 * np.eye(3))
    u = np.sign(np.sin(np.outer(np.arange(T), [0.31, 0.17]) + 0.1))
    algorithm = UnknownGain(model, gain, directions="per_input", walk=walk)
    directions = np.stack([model.B * [1, 0], model.B * [0, 1]])
    truth = augmented(model, gain, directions, np.zeros((3, 2)), np.zeros((2, 2, 2)), 0.1 * walk * np.eye(2), u)
    return algorithm, prior, truth, together(prior, gain), u


def draw(truth, prior, u, seed, missing=0.2):
    """500 runs, true states and gains among them, with outputs missing at random."""
    runs = simulate_bank(truth, u, seed=seed, runs=RUNS, prior=prior).items
    y = runs.record.y.copy()
    y[np.random.default_rng(seed).random(y.shape) < missing] = np.nan
    records = [Record(y[i], u, dt=0.1) for i in range(RUNS)]
    return records, runs.state


def joint_nees(bank, truth, k):
    error = np.concatenate([bank.mean[:, k], bank.gain[:, k]], axis=1) - truth[:, k]
    cross = bank.extra["state_gain_covariance"][:, k]
    P = np.block([[bank.covariance[:, k], cross], [np.swapaxes(cross, 1, 2), bank.gain_covariance[:, k]]])
    return nees(error, P)


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("walk", [0.0, 0.3])
def test_errors_of_state_and_gain_are_what_their_covariance_says(seed, walk):
    algorithm, prior, truth, joint_prior, u = loop(walk)
    records, states = draw(truth, joint_prior, u, seed)
    bank = estimate_bank(algorithm, records, prior=prior)
    for k in (0, 10, T - 1):
        assert joint_nees(bank, states, k).consistent, joint_nees(bank, states, k).sentence
    assert nis(bank.innovation, bank.innovation_covariance).consistent


def test_a_wrong_noise_level_is_found_out():
    """The same statistic must be able to fail."""
    algorithm, prior, truth, joint_prior, u = loop(0.0)
    records, states = draw(truth, joint_prior, u, 1)
    confident = Kalman(
        StateSpace(**_with(algorithm.model, R=0.7 * algorithm.model.R, B=algorithm.model.B * [1.0, 0.8]))
    )
    bank = estimate_bank(confident, records, prior=prior)
    assert not nis(bank.innovation, bank.innovation_covariance).consistent
    assert "too small" in nis(bank.innovation, bank.innovation_covariance).sentence


def _with(model, **changes):
    return {name: getattr(model, name) for name in ("A", "B", "C", "D", "Q", "R", "dt")} | changes


def test_without_excitation_the_gain_says_that_it_does_not_know():
    """Quiet input: under a walk the variance of the gain grows as the walk's, and covers where the gain has gone."""
    algorithm, prior, _, joint_prior, u = loop(0.3)
    u = np.concatenate([u[: T // 2], np.zeros((T // 2, 2))])
    directions = np.stack([algorithm.model.B * [1, 0], algorithm.model.B * [0, 1]])
    truth = augmented(
        algorithm.model, algorithm.gain, directions, np.zeros((3, 2)), np.zeros((2, 2, 2)), 0.03 * np.eye(2), u
    )
    records, states = draw(truth, joint_prior, u, 5, missing=0.0)
    bank = estimate_bank(algorithm, records, prior=prior)
    variance = np.diagonal(bank.gain_covariance, axis1=2, axis2=3)
    assert_allclose(variance[:, -1] - variance[:, -31], 30 * 0.03, rtol=1e-6)
    errors = bank.gain[:, -1] - states[:, -1, 3:]
    assert nees(errors, bank.gain_covariance[:, -1]).consistent
    assert np.mean(np.abs(errors) < 3 * np.sqrt(variance[:, -1])) > 0.99


def test_a_constant_gain_is_neither_lost_nor_learnt_without_excitation():
    algorithm, prior, *_ = loop(0.0)
    quiet = Record(np.random.default_rng(0).normal(size=(50, 2)), np.zeros((50, 2)), dt=0.1)
    result = estimate(algorithm, quiet, prior=prior)
    assert_allclose(result.gain, np.broadcast_to(algorithm.gain.mean, (50, 2)))
    assert_allclose(result.gain_covariance[-1], algorithm.gain.covariance)


@pytest.mark.parametrize("simulation", f16.SIMULATIONS)
def test_the_f16_unfailed_on_either_plant_is_consistent_with_its_own_hold(simulation):
    """Feedback makes the input depend on past outputs only through the state here; the posterior stays exact."""
    model = f16.short_period()
    flights = [f16.flight(1.0, seed=seed, simulation=simulation) for seed in range(100)]
    algorithm = UnknownGain(model, Prior([0.8], [[0.4]]))
    bank = estimate_bank(algorithm, [flight.record for flight in flights], prior=Prior([0.0, 0.0], np.diag([0.1, 1.0])))
    assert nis(bank.innovation, bank.innovation_covariance).consistent
    assert nees(bank.gain[:, -1] - 1.0, bank.gain_covariance[:, -1]).consistent


def test_a_moving_elevator_taken_for_a_held_one_is_found_out():
    flown = f16.flight(1.0, seed=1)
    wrong = Record(flown.record.y, flown.record.u, dt=0.01, outputs=f16.OUTPUTS, inputs=f16.INPUTS)
    result = estimate(Kalman(f16.short_period()), wrong, prior=Prior([0.0, 0.0], np.diag([0.1, 1.0])))
    assert nis(result.innovation, result.innovation_covariance).mean > 2.5


def test_draws_of_a_simulation_have_the_covariance_of_the_model():
    model = StateSpace([[0.5]], C=[[1.0]], Q=[[1.0]], R=[[0.5]], S=[[0.6]], dt=1)
    runs = simulate_bank(model, seed=1, runs=20_000, steps=3, prior=Prior([1.0], [[2.0]])).items
    x, y = runs.state[..., 0], runs.record.y[..., 0]
    w, v = x[:, 1] - 0.5 * x[:, 0], y[:, 0] - x[:, 0]
    found = np.cov(np.stack([x[:, 0], w, v]))
    expected = np.array([[2.0, 0.0, 0.0], [0.0, 1.0, 0.6], [0.0, 0.6, 0.5]])
    errors = np.sqrt((np.outer(np.diag(expected), np.diag(expected)) + expected**2) / 20_000)
    assert np.all(np.abs(found - expected) < 4 * errors)
    assert abs(x[:, 0].mean() - 1.0) < 4 * np.sqrt(2.0 / 20_000)


def test_a_bank_is_its_runs():
    algorithm, prior, truth, joint_prior, u = loop(0.3)
    records, _ = draw(truth, joint_prior, u, 7)
    bank = estimate_bank(algorithm, records[:3], prior=prior)
    assert isinstance(bank.names, tuple)
    assert len(bank) == 3
    for i in range(3):
        alone = estimate(algorithm, records[i], prior=prior)
        assert_allclose(bank[i].mean, alone.mean, rtol=1e-12, atol=1e-13)
        assert_allclose(bank[i].gain_covariance, alone.gain_covariance, rtol=1e-12)
        assert_allclose(bank.log_likelihood[i], alone.log_likelihood, rtol=1e-12)


def test_a_stack_of_models_is_sampled_together():
    """Continuous models of different dynamics, one record."""
    rng = np.random.default_rng(0)
    record = Record(rng.normal(size=(20, 1)), rng.normal(size=(20, 1)), t=np.cumsum(rng.choice([0.1, 0.3], size=20)))
    filters = [Kalman(StateSpace([[-a]], [[1.0]], Q=[[a]], R=[[1.0]], dt=0)) for a in (0.5, 1.0, 2.0)]
    prior = Prior([0.0], [[1.0]])
    bank = estimate_bank(filters, record, prior=prior)
    for i, algorithm in enumerate(filters):
        assert_allclose(bank[i].mean, estimate(algorithm, record, prior=prior).mean, rtol=1e-12)


def test_what_was_known_exactly_or_not_at_all_is_left_out_of_the_check():
    model = StateSpace(
        0.9 * np.eye(2), C=[[1.0, 0.0], [1.0, 1.0], [0.0, 2.0]], Q=0.1 * np.eye(2), R=np.diag([0, 1, 0]), dt=1
    )
    drawn = simulate_bank(model, seed=1, runs=1, steps=4000).items.record.y[0]
    diffuse = Prior([7.0, -5.0], np.zeros((2, 2)), diffuse=np.eye(2))
    result = estimate(Kalman(model), Record(drawn, dt=1), prior=diffuse)
    assert np.all(np.isnan(result.innovation_covariance[0]))
    check = nis(result.innovation, result.innovation_covariance)
    assert check.consistent, check.sentence
    assert check.degrees == 3 * 3999
    twice = StateSpace([[0.9]], C=[[1.0], [2.0]], Q=[[1.0]], R=np.zeros((2, 2)), dt=1)
    y = simulate_bank(twice, seed=2, runs=1, steps=2000, prior=Prior([0.0], [[1.0]])).items.record.y[0]
    same = estimate(Kalman(twice), Record(y, dt=1), prior=Prior([0.0], [[1.0]]))
    assert nis(same.innovation, same.innovation_covariance).degrees == 2000
    assert nis(same.innovation, same.innovation_covariance).consistent
