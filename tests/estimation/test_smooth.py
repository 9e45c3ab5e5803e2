"""Smoothing against the whole record as one Gaussian vector."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cases import case
from estimable import (
    FixedGain,
    InputError,
    Kalman,
    Prior,
    Record,
    StateSpace,
    UnknownGain,
    estimate,
    simulate,
    smooth,
)
from oracles.augmented import augmented, together
from oracles.dense import smoothed

FEATURES = ({}, {"cross": True}, {"varying": True}, {"singular": True})


def smallest(P):
    """Smallest eigenvalue over all of them, each relative to its largest."""
    values = np.linalg.eigvalsh(P)
    return np.min(values[..., 0] / np.maximum(values[..., -1], 1e-300))


@pytest.mark.parametrize("features", FEATURES, ids=str)
@pytest.mark.parametrize("sizes", [(2, 1, 1), (3, 2, 2)], ids=str)
def test_every_row_is_what_the_whole_record_says(features, sizes):
    for seed in range(3):
        c = case(seed, sizes, **features)
        mean, covariance = smoothed(c.model, c.prior, c.record.y, c.record.u)
        result = smooth(Kalman(c.model), c.record, prior=c.prior)
        assert_allclose(result.mean, mean, atol=1e-10)
        assert_allclose(result.covariance, covariance, atol=1e-11)
        assert result.used.tolist() == [11] * 12


def test_a_fixed_lag_uses_so_many_later_samples_and_no_more():
    c = case(1, cross=True)
    result = smooth(Kalman(c.model), c.record, prior=c.prior, lag=3)
    assert result.used.tolist() == [3, 4, 5, 6, 7, 8, 9, 10, 11, 11, 11, 11]
    for k in range(12):
        upto = c.record[: result.used[k] + 1]
        mean, covariance = smoothed(c.model, c.prior, upto.y, upto.u)
        assert_allclose(result.mean[k], mean[k], atol=1e-11)
        assert_allclose(result.covariance[k], covariance[k], atol=1e-12)


def test_lag_zero_is_the_filter_and_a_long_lag_the_whole_record():
    c = case(2, missing=0.5)
    now, filtered = (
        smooth(Kalman(c.model), c.record, prior=c.prior, lag=0),
        estimate(Kalman(c.model), c.record, prior=c.prior),
    )
    assert_allclose(now.mean, filtered.mean, atol=1e-12)
    assert_allclose(now.covariance, filtered.covariance, atol=1e-12)
    late, whole = (
        smooth(Kalman(c.model), c.record, prior=c.prior, lag=50),
        smooth(Kalman(c.model), c.record, prior=c.prior),
    )
    assert_allclose(late.mean, whole.mean, atol=1e-12)
    assert_allclose(late.covariance, whole.covariance, atol=1e-12)


@pytest.mark.parametrize("cross", [False, True])
def test_a_gain_that_walks_is_smoothed_with_its_state(cross):
    c = case(3, cross=cross)
    gain, walk = Prior([1.0, 0.5], [[0.5, 0.1], [0.1, 0.3]]), np.array([[0.3, 0.1], [0.1, 0.2]])
    directions = np.stack([c.model.B * [1, 0], c.model.B * [0, 1]])
    feedthrough = np.stack([c.model.D * [1, 0], c.model.D * [0, 1]])
    known = StateSpace(
        c.model.A, c.model.B, c.model.C, 0 * c.model.D, Q=c.model.Q, G=c.model.G, R=c.model.R, S=c.model.S, dt=0.5
    )
    whole = augmented(known, gain, directions, np.zeros((3, 2)), feedthrough, 0.5 * walk, c.record.u)
    mean, covariance = smoothed(whole, together(c.prior, gain), c.record.y, c.record.u)
    algorithm = UnknownGain(c.model, gain, directions="per_input", feedthrough="scaled", walk=walk)
    result = smooth(algorithm, c.record, prior=c.prior)
    assert_allclose(result.mean, mean[:, :3], atol=1e-11)
    assert_allclose(result.gain, mean[:, 3:], atol=1e-11)
    assert_allclose(result.gain_covariance, covariance[:, 3:, 3:], atol=1e-12)
    assert_allclose(result.extra["state_gain_covariance"], covariance[:, :3, 3:], atol=1e-12)


@pytest.mark.parametrize("lag", [None, 12])
def test_a_diffuse_start_is_determined_by_what_comes_later(lag):
    c = case(4, cross=True)
    prior = Prior(c.prior.mean, c.prior.covariance, diffuse=np.random.default_rng(0).normal(size=(3, 2)))
    mean, covariance = smoothed(c.model, prior, c.record.y, c.record.u)
    result = smooth(Kalman(c.model), c.record, prior=prior, lag=lag)
    assert_allclose(result.mean, mean, atol=1e-10)
    assert_allclose(result.covariance, covariance, atol=1e-10)
    assert np.all(result.diffuse_covariance == 0)


def test_what_the_whole_record_leaves_unknown_stays_diffuse():
    """A second state that no output ever sees; the first is as if it were alone."""
    model = StateSpace(np.eye(2), C=[[1.0, 0.0]], R=[[0.01]], dt=1)
    record = Record(np.random.default_rng(0).normal(size=(20, 1)), dt=1)
    turned = np.array([[1.0, 0.3], [0.7, -1.2]])
    for D in (np.eye(2), turned):
        result = smooth(Kalman(model), record, prior=Prior([0, 0], np.zeros((2, 2)), diffuse=D))
        assert_allclose(result.mean[:, 0], record.y.mean(), rtol=1e-10)
        assert_allclose(result.covariance[:, 0, 0], 0.01 / 20, rtol=1e-9)
        assert np.all(result.diffuse_covariance[:, 1, 1] > 0)
        assert_allclose(result.diffuse_covariance[:, 0], 0.0, atol=1e-15)


def test_irregular_time_of_a_continuous_model():
    rng = np.random.default_rng(0)
    t = np.cumsum(rng.choice([0.1, 0.25, 0.37], size=12))
    model = StateSpace([[-1.0, 1.0], [0.0, -0.5]], [[0.0], [1.0]], [[1.0, 0.0]], Q=0.3 * np.eye(2), R=[[0.1]], dt=0)
    record = Record(rng.normal(size=(12, 1)), rng.normal(size=(12, 1)), t=t, hold="first_order")
    prior = Prior([0.0, 1.0], np.eye(2))
    steps = [model.discretise(h, hold="first_order") for h in np.append(np.diff(t), t[-1] - t[-2])]
    u = np.hstack([record.u, np.vstack([record.u[1:], record.u[-1:]])])
    B = np.array([np.hstack([s.B, s.B_end]) for s in steps])
    varying = StateSpace(np.array([s.A for s in steps]), B, model.C, Q=np.array([s.Q for s in steps]), R=model.R, dt=1)
    mean, covariance = smoothed(varying, prior, record.y, u)
    result = smooth(Kalman(model), record, prior=prior)
    assert_allclose(result.mean, mean, atol=1e-12)
    assert_allclose(result.covariance, covariance, atol=1e-12)


def test_an_operating_point_moves_every_row_with_it():
    c = case(5, feedthrough=False)
    point = {"states": [10.0, -5.0, 3.0], "inputs": [2.0, 1.0], "outputs": [7.0, 8.0]}
    moved = StateSpace(
        c.model.A, c.model.B, c.model.C, Q=c.model.Q, G=c.model.G, R=c.model.R, dt=0.5, operating_point=point
    )
    record = Record(c.record.y + point["outputs"], c.record.u + point["inputs"], dt=0.5)
    prior = Prior(c.prior.mean + point["states"], c.prior.covariance)
    plain, shifted = smooth(Kalman(c.model), c.record, prior=c.prior), smooth(Kalman(moved), record, prior=prior)
    assert_allclose(shifted.mean - point["states"], plain.mean, atol=1e-11)
    assert_allclose(shifted.covariance, plain.covariance, atol=1e-12)


@pytest.mark.parametrize("engine", ["native", "xla"])
def test_both_engines_say_the_same(engine):
    c = case(6)
    mean, _ = smoothed(c.model, c.prior, c.record.y, c.record.u)
    result = smooth(Kalman(c.model), c.record, prior=c.prior, engine=engine)
    assert result.engine == engine
    assert_allclose(result.mean, mean, atol=1e-11)


def test_a_change_of_basis_changes_nothing_but_the_basis():
    c = case(7, cross=True)
    T = np.array([[2.0, 1.0, 0.0], [0.0, 1.0, -1.0], [1.0, 0.0, 3.0]])
    direct = smooth(Kalman(c.model), c.record, prior=c.prior)
    turned = smooth(Kalman(c.model.in_basis(T)), c.record, prior=c.prior.in_basis(T))
    assert_allclose(turned.mean, direct.mean @ T.T, atol=1e-11)
    assert_allclose(turned.covariance, T @ direct.covariance @ T.T, atol=1e-11)


def test_a_record_of_one_row_and_one_of_nothing_seen():
    c = case(8)
    one = smooth(Kalman(c.model), c.record[:1], prior=c.prior)
    assert_allclose(one.mean, estimate(Kalman(c.model), c.record[:1], prior=c.prior).mean, atol=1e-13)
    blind = Record(np.full((12, 2), np.nan), c.record.u, dt=0.5)
    for prior in (c.prior, Prior(c.prior.mean, np.zeros((3, 3)))):
        result, predicted = (run(Kalman(c.model), blind, prior=prior) for run in (smooth, estimate))
        assert_allclose(result.mean, predicted.mean, atol=1e-13)
        assert_allclose(result.covariance, predicted.covariance, atol=1e-13)


def test_noise_free_sensors_and_states_known_exactly_stay_exact():
    """Position measured without noise, speed driven by noise: every position is known, every speed nearly."""
    model = StateSpace([[1.0, 0.1], [0.0, 1.0]], C=[[1.0, 0.0]], G=[[0.0], [1.0]], Q=[[0.01]], R=[[0.0]], dt=0.1)
    drawn = simulate(model, seed=1, steps=200, prior=Prior([0, 0], np.eye(2)))
    y = drawn.record.y.copy()
    y[50:60] = np.nan
    result = smooth(Kalman(model), Record(y, dt=0.1), prior=Prior([0, 0], 1e6 * np.eye(2)))
    known = ~np.isnan(y[:, 0])
    assert_allclose(result.mean[known], drawn.state[known], atol=0.1)
    assert_allclose(result.mean[:-1][known[:-1] & known[1:]], drawn.state[:-1][known[:-1] & known[1:]], atol=1e-9)
    assert np.all(result.covariance[known, 0, 0] < 1e-20)
    assert smallest(result.covariance) >= -1e-15


def test_covariances_stay_semidefinite_where_a_subtraction_loses_it():
    """A vague prior and a precise sensor: P - P Λ P is negative by far more than rounding of what it should be."""
    rng = np.random.default_rng(3)
    for _ in range(10):
        A = rng.normal(size=(3, 3))
        A /= np.abs(np.linalg.eigvals(A)).max()
        model = StateSpace(
            A, C=rng.normal(size=(2, 3)), G=rng.normal(size=(3, 1)), Q=[[1e-4]], R=np.diag([0, 1e-8]), dt=1
        )
        y = simulate(model, seed=0, steps=12, prior=Prior(np.zeros(3), np.eye(3))).record.y
        result = smooth(Kalman(model), Record(y, dt=1), prior=Prior(np.zeros(3), 1e8 * np.eye(3)))
        assert smallest(result.covariance) >= -1e-15


def test_a_record_read_backwards_gives_the_same_smoothed_states():
    """A reversible model: the same record, told from the end."""
    A = np.array([[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]])
    prior = Prior([0.0, 0.0], 5 * np.eye(2))  # as at any other time: Q = 0, and A turns a circle onto itself
    y = np.random.default_rng(0).normal(size=(12, 1))
    y[4] = np.nan
    forwards = smooth(Kalman(StateSpace(A, C=[[1.0, 0.0]], R=[[0.3]], dt=1)), Record(y, dt=1), prior=prior)
    backwards = smooth(Kalman(StateSpace(A.T, C=[[1.0, 0.0]], R=[[0.3]], dt=1)), Record(y[::-1], dt=1), prior=prior)
    assert_allclose(forwards.mean, backwards.mean[::-1], atol=1e-13)
    assert_allclose(forwards.covariance, backwards.covariance[::-1], atol=1e-13)


def test_results_say_what_they_are():
    c = case(9)
    result = smooth(Kalman(c.model), c.record, prior=c.prior)
    assert repr(result).startswith("SmoothedEstimate(log-likelihood")
    assert result.innovation is None
    assert result.log_likelihood == pytest.approx(estimate(Kalman(c.model), c.record, prior=c.prior).log_likelihood)
    columns = result.to_pandas().columns.tolist()
    assert columns[:7] == ["x1", "x1_sigma", "x2", "x2_sigma", "x3", "x3_sigma", f"{c.model.outputs[0]}_smoothed"]
    assert result.plot().data


def test_what_cannot_be_smoothed_is_refused_in_words():
    c = case(9)
    forgetful = UnknownGain(c.model, Prior([1.0], [[1.0]]), forgetting=0.98)
    with pytest.raises(InputError, match=r"forgetting = 0\.98 is not one: give UnknownGain a `walk`"):
        smooth(forgetful, c.record, prior=c.prior)
    with pytest.raises(InputError, match=r"`lag` must be an integer of at least 0\. Got -1"):
        smooth(Kalman(c.model), c.record, prior=c.prior, lag=-1)
    with pytest.raises(
        InputError, match=r"smooth needs an algorithm with a Gaussian model of each row.* FixedGain has none"
    ):
        smooth(FixedGain(c.model, np.zeros((3, 2))), c.record, prior=c.prior)


@pytest.mark.parametrize("cross", [False, True])
def test_what_settles_is_the_same_on_both_engines(cross):
    """A long record: information and covariance settle, move where an output is missing, and settle again."""
    c = case(0, cross=cross)
    y = np.random.default_rng(0).normal(size=(600, 2))
    y[300, 1] = np.nan
    record = Record(y, np.zeros((600, 2)), dt=0.5)
    ours, xla = (smooth(Kalman(c.model), record, prior=c.prior, engine=engine) for engine in ("native", "xla"))
    assert_allclose(ours.mean, xla.mean, atol=1e-12)
    assert_allclose(ours.covariance, xla.covariance, atol=1e-13)
    if not cross:
        same = (ours.covariance[1:] == ours.covariance[:-1]).all(axis=(1, 2))
        assert same[100:200].all()
        assert same[400:500].all()
        assert not same[300]
