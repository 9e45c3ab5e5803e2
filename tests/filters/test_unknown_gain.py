"""UnknownGain against the augmented model, the printed scalar form, the batch form and a closed form."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cases import case, covariance
from estimable import Kalman, Prior, Record, StateSpace, UnknownGain, batch_gain, estimate
from oracles import textbook
from oracles.augmented import augmented, together

ANSWERS = json.loads((Path(__file__).parents[1] / "answers" / "loop-gain.json").read_text())


@pytest.mark.parametrize("cross", [False, True])
@pytest.mark.parametrize("sizes", [(3, 2, 2), (1, 1, 1)], ids=str)
def test_equals_the_textbook_filter_of_the_augmented_model(sizes, cross):
    for seed in range(4):
        c = case(seed, sizes, cross=cross)
        n, m, p_out = sizes
        gain = Prior(c.rng.normal(size=2), covariance(c.rng, 2))
        walk = covariance(c.rng, 2)  # per second; a step is half a second
        directions, fixed = c.rng.normal(size=(2, n, m)), c.rng.normal(size=(n, m))
        feedthrough = c.rng.normal(size=(2, p_out, m))
        algorithm = UnknownGain(c.model, gain, directions=directions, fixed=fixed, feedthrough=feedthrough, walk=walk)
        ours = estimate(algorithm, c.record, prior=c.prior)
        model = augmented(c.model, gain, directions, fixed, feedthrough, 0.5 * walk, c.record.u)
        means, covariances, total = textbook.kalman(model, together(c.prior, gain), c.record.y, c.record.u)
        assert_allclose(np.hstack([ours.mean, ours.gain]), means, rtol=1e-8, atol=1e-9)
        assert_allclose(ours.covariance, covariances[:, :n, :n], rtol=1e-8, atol=1e-9)
        assert_allclose(ours.gain_covariance, covariances[:, n:, n:], rtol=1e-8, atol=1e-9)
        assert_allclose(ours.extra["state_gain_covariance"], covariances[:, :n, n:], rtol=1e-8, atol=1e-9)
        assert_allclose(ours.log_likelihood, total, rtol=1e-9)


def sillence():
    """The example of the errata, as a model of which only one combination is measured."""
    return StateSpace(
        [[0.9, 0.2], [-0.1, 0.8]], [[0.5], [1.0]], [[1.0, 0.0]], Q=0.05 * np.eye(2), R=[[0.1]], dt=1
    )  # fmt: skip


INPUTS = {
    "white": lambda k: np.random.default_rng(4).normal(size=len(k)),
    "sine": lambda k: np.sin(0.3 * k),
    "step": lambda k: np.ones(len(k)),
    "square": lambda k: np.sign(np.sin(0.2 * k + 0.1)),
}


@pytest.mark.parametrize("shape", INPUTS)
@pytest.mark.parametrize("rows", [20, 100])
def test_the_batch_form_with_the_full_noise_covariance_equals_the_recursive_one(shape, rows):
    model, u = sillence(), INPUTS[shape](np.arange(rows))[:, None]
    rng = np.random.default_rng(rows)
    y = rng.normal(size=(rows, 1)) * 2
    y[rng.random(rows) < 0.2] = np.nan
    prior, gain = Prior([0.3, -0.2], 2 * np.eye(2)), Prior([1.0], [[0.5]])
    recursive = estimate(UnknownGain(model, gain), Record(y, u, dt=1), prior=prior)
    batch = batch_gain(UnknownGain(model, gain), Record(y, u, dt=1), prior=prior)
    assert_allclose(batch.gain, recursive.gain[-1], rtol=1e-10)
    assert_allclose(batch.gain_covariance, recursive.gain_covariance[-1], rtol=1e-10)


def test_the_batch_form_takes_continuous_models_several_gains_and_unequal_steps(refused):
    model = StateSpace(
        [[-1.0, 0.5], [0.0, -2.0]], [[1.0, 0.2], [0.0, 1.5]], [[1.0, 0.0]], [[0.0, 0.3]], Q=0.1 * np.eye(2), R=[[0.04]], dt=0,
        operating_point={"states": [1.0, 2.0], "inputs": [0.5, 0.0]},
    )  # fmt: skip
    rng = np.random.default_rng(3)
    t = np.cumsum(rng.choice([0.1, 0.14], size=60))
    record = Record(rng.normal(size=(60, 1)), rng.normal(size=(60, 2)), t=t, hold="first_order")
    algorithm = UnknownGain(model, Prior([1.0, 0.8], 0.3 * np.eye(2)), directions="per_input", feedthrough="scaled")
    prior = Prior([1.0, 2.0], np.diag([0.5, 0.0]))
    recursive, batch = estimate(algorithm, record, prior=prior), batch_gain(algorithm, record, prior=prior)
    assert_allclose(batch.gain, recursive.gain[-1], rtol=1e-10)
    assert_allclose(batch.gain_covariance, recursive.gain_covariance[-1], rtol=1e-10)
    assert batch.mean[1] == 2.0
    walking = replace(algorithm, walk=np.eye(2), forgetting=0.9)
    assert len(refused(lambda: batch_gain(walking, record, prior=prior))) == 2
    long = Record(np.zeros((7000, 1)), np.zeros((7000, 2)), dt=0.1)
    assert "at most 6,000 output values" in refused(lambda: batch_gain(algorithm, long, prior=prior))[0]
    assert "UnknownGain" in refused(lambda: batch_gain(Kalman(model), record, prior=prior))[0]


def test_the_diagonal_noise_covariance_of_the_thesis_claims_too_little_variance():
    model, u = sillence(), INPUTS["step"](np.arange(100))[:, None]
    record = Record(np.zeros((100, 1)), u, dt=1)
    full = batch_gain(UnknownGain(model, Prior([1.0], [[0.5]])), record, prior=Prior(np.zeros(2), 2 * np.eye(2)))
    claimed = np.diag(np.diag(full.noise_covariance))
    H = _regressor(model, u)
    information = np.linalg.inv(np.diag([2, 2, 0.5])) + H.T @ np.linalg.inv(claimed) @ H
    assert full.gain_covariance[0, 0] / np.linalg.inv(information)[2, 2] > 1.3


def _regressor(model, u):
    rows, Φ, forced = [], np.eye(2), np.zeros(2)
    for uk in u[:, 0]:
        rows.append(np.append(model.C[0] @ Φ, model.C[0] @ forced))
        Φ, forced = model.A @ Φ, model.A @ forced + model.B[:, 0] * uk
    return np.array(rows)


def test_equals_the_scalar_measurement_form_as_printed():
    model, rng = sillence(), np.random.default_rng(2)
    u, z = rng.normal(size=30), rng.normal(size=30)
    prior, gain = Prior([1.0, -1.0], np.diag([0.4, 2.0])), Prior([0.8], [[0.4]])
    y = np.append(np.nan, z)[:, None]  # Pachter's z[1] .. z[N]: row 0 is not measured
    ours = estimate(UnknownGain(model, gain), Record(y, np.append(u, 0.0)[:, None], dt=1), prior=prior)
    printed = textbook.scalar_gain(
        model.A, model.B[:, 0], model.C, model.Q, 0.1, prior.mean, 0.8, prior.covariance, np.zeros(2), 0.4, u, z
    )
    for k, (x, K, Pxx, PxK, PKK) in enumerate(printed, start=1):
        assert_allclose(ours.mean[k], x, rtol=1e-10, atol=1e-12)
        assert_allclose(ours.gain[k, 0], K, rtol=1e-10)
        assert_allclose(ours.covariance[k], Pxx, rtol=1e-9)
        assert_allclose(ours.extra["state_gain_covariance"][k, :, 0], PxK, rtol=1e-8, atol=1e-12)
        assert_allclose(ours.gain_covariance[k, 0, 0], PKK, rtol=1e-9)


@pytest.mark.parametrize("cross", [False, True])
def test_a_known_gain_is_the_plain_kalman_filter(cross):
    c = case(8, (3, 2, 2), cross=cross)
    ours = estimate(UnknownGain(c.model, Prior([0.3], [[0.0]])), c.record, prior=c.prior)
    plain = estimate(Kalman(replace(c.model, B=0.3 * c.model.B)), c.record, prior=c.prior)
    assert_allclose(ours.mean, plain.mean, rtol=1e-13, atol=1e-13)
    assert_allclose(ours.covariance, plain.covariance, rtol=1e-13, atol=1e-13)
    assert_allclose(ours.log_likelihood, plain.log_likelihood, rtol=1e-13)
    assert np.all(ours.gain == 0.3)
    assert np.all(ours.gain_covariance == 0.0)


def test_the_closed_form_of_a_plant_without_noise():
    given, expected = ANSWERS["inputs"], ANSWERS["expected"]
    model = StateSpace([[0.5]], [[1.0]], R=[[given["R"]]], dt=1)
    record = Record([np.nan, *given["y"]], np.ones(4), dt=1)
    gain = Prior([given["K_prior_mean"]], [[given["K_prior_var"]]])
    ours = estimate(UnknownGain(model, gain), record, prior=Prior([0.0], [[0.0]]))
    assert_allclose(ours.gain[-1, 0], expected["K_hat"], rtol=1e-12)
    assert_allclose(ours.gain_covariance[-1, 0, 0], expected["K_var"], rtol=1e-12)


def test_words_for_directions_are_the_matrices_they_stand_for():
    c = case(4, (3, 2, 2))
    model = replace(c.model, D=np.random.default_rng(0).normal(size=(2, 2)))
    pairs = {"one": model.B[None], "per_input": np.stack([model.B * [1, 0], model.B * [0, 1]]),
             "every_entry": np.eye(6).reshape(6, 3, 2)}  # fmt: skip
    for word, matrices in pairs.items():
        p = len(matrices)
        gain = Prior(np.arange(1.0, p + 1), np.eye(p))
        spoken = estimate(UnknownGain(model, gain, directions=word), c.record, prior=c.prior)
        written = estimate(UnknownGain(model, gain, directions=matrices), c.record, prior=c.prior)
        assert_allclose(spoken.gain, written.gain, rtol=1e-12)
    default = estimate(UnknownGain(model, Prior([1.0], [[1.0]])), c.record, prior=c.prior)
    one = estimate(UnknownGain(model, Prior([1.0], [[1.0]]), directions="one"), c.record, prior=c.prior)
    assert np.array_equal(default.gain, one.gain)


@pytest.mark.parametrize("word", ["one", "per_input"])
def test_a_scaled_feedthrough_is_multiplied_by_the_same_gain(word):
    c = case(4, (3, 2, 2))
    p = 1 if word == "one" else 2
    matrices = c.model.D[None] if p == 1 else np.stack([c.model.D * [1, 0], c.model.D * [0, 1]])
    gain = Prior(np.full(p, 0.7), np.eye(p))
    scaled = estimate(UnknownGain(c.model, gain, directions=word, feedthrough="scaled"), c.record, prior=c.prior)
    without = replace(c.model, D=np.zeros((2, 2)))
    written = estimate(UnknownGain(without, gain, directions=word, feedthrough=matrices), c.record, prior=c.prior)
    assert_allclose(scaled.gain, written.gain, rtol=1e-12)
    assert_allclose(scaled.log_likelihood, written.log_likelihood, rtol=1e-12)


def test_forgetting_divides_the_gain_covariance_at_every_step_and_nothing_else():
    model = StateSpace([[0.5]], [[1.0]], R=[[1.0]], dt=1)
    blind = Record(np.full((3, 1), np.nan), np.zeros(3), dt=1)
    prior = Prior([2.0], [[4.0]])
    ours = estimate(UnknownGain(model, Prior([3.0], [[1.0]]), forgetting=0.5), blind, prior=prior)
    assert_allclose(ours.gain_covariance.ravel(), [1.0, 2.0, 4.0])
    assert_allclose(ours.covariance.ravel(), [4.0, 1.0, 0.25])
    assert_allclose(ours.gain.ravel(), 3.0)


def test_a_walk_is_a_variance_per_second():
    blind = Record(np.full((3, 1), np.nan), np.zeros(3), t=[0.0, 0.5, 2.0])
    model = StateSpace([[-1.0]], [[1.0]], R=[[1.0]], dt=0)
    ours = estimate(UnknownGain(model, Prior([1.0], [[1.0]]), walk=0.2), blind, prior=Prior([0.0], [[0.0]]))
    assert_allclose(ours.gain_covariance.ravel(), [1.0, 1.1, 1.4])


def test_a_diffuse_gain_needs_one_excited_sample():
    model = StateSpace([[0.5]], [[1.0]], R=[[0.01]], dt=1)
    record = Record([0.0, 2.0, 2.9], [1.0, 1.0, 1.0], dt=1)
    gain = Prior([0.0], [[0.0]], diffuse=[[1.0]])
    ours = estimate(UnknownGain(model, gain), record, prior=Prior([0.0], [[0.0]]))
    assert ours.extra["gain_diffuse_covariance"].ravel().tolist() == [1.0, 0.0, 0.0]
    assert_allclose(ours.gain[1, 0], 2.0)
    assert_allclose(ours.gain_covariance[1, 0, 0], 0.01)
    s = np.array([1.0, 1.5])  # least squares of the outputs on what K = 1 gives
    assert_allclose(ours.gain[2, 0], s @ [2.0, 2.9] / (s @ s), rtol=1e-12)


def test_the_gain_multiplies_the_input_about_the_operating_point():
    A, B, point = [[0.5]], [[1.0]], {"states": [10.0], "inputs": [4.0]}
    model = StateSpace(A, B, R=[[0.01]], dt=1, operating_point=point)
    rng = np.random.default_rng(0)
    u, y = rng.normal(size=(6, 1)), rng.normal(size=(6, 1))
    about = estimate(
        UnknownGain(model, Prior([1.0], [[1.0]])), Record(y + 10, u + 4, dt=1), prior=Prior([10.0], [[1.0]])
    )
    plain = StateSpace(A, B, R=[[0.01]], dt=1)
    zero = estimate(UnknownGain(plain, Prior([1.0], [[1.0]])), Record(y, u, dt=1), prior=Prior([0.0], [[1.0]]))
    assert_allclose(about.gain, zero.gain, rtol=1e-12)
    assert_allclose(about.mean, zero.mean + 10, rtol=1e-12)


@pytest.mark.parametrize("hold", ["zero_order", "first_order"])
def test_a_continuous_model_is_discretised_block_by_block(hold):
    rng = np.random.default_rng(1)
    model = StateSpace([[-1.0, 0.3], [0.2, -0.5]], rng.normal(size=(2, 2)), Q=np.eye(2), R=np.eye(2), dt=0)
    t = np.cumsum(rng.uniform(0.1, 0.5, size=15))
    record = Record(rng.normal(size=(15, 2)), rng.normal(size=(15, 2)), t=t, hold=hold)
    prior = Prior([0.0, 0.0], np.eye(2))
    known = np.array([0.7, -1.2])
    ours = estimate(UnknownGain(model, Prior(known, np.zeros((2, 2))), directions="per_input"), record, prior=prior)
    plain = estimate(Kalman(replace(model, B=model.B * known)), record, prior=prior)
    assert_allclose(ours.mean, plain.mean, rtol=1e-10, atol=1e-12)
    assert_allclose(ours.log_likelihood, plain.log_likelihood, rtol=1e-12)


def test_a_model_discretised_beforehand_for_a_moving_input_gives_the_same():
    rng = np.random.default_rng(1)
    model = StateSpace([[-1.0, 0.3], [0.2, -0.5]], rng.normal(size=(2, 2)), Q=np.eye(2), R=np.eye(2), dt=0)
    record = Record(rng.normal(size=(15, 2)), rng.normal(size=(15, 2)), dt=0.1, hold="first_order")
    gain, prior = Prior([1.0, 1.0], np.eye(2)), Prior([0.0, 0.0], np.eye(2))
    continuous = estimate(UnknownGain(model, gain, directions="per_input"), record, prior=prior)
    discrete = model.discretise(0.1, hold="first_order")
    beforehand = estimate(UnknownGain(discrete, gain, directions="per_input"), record, prior=prior)
    assert_allclose(beforehand.gain, continuous.gain, rtol=1e-12)
