"""Mixture against weights and moments that are written out run by run."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import norm

from cases import case
from estimable import (
    ChangeDetection,
    Kalman,
    Mixture,
    Prior,
    Record,
    StateSpace,
    UnknownGain,
    estimate,
    markov_disturbance,
)

GAIN = Prior([0.7], [[0.3]])
C = case(2, (3, 2, 2))
WALKS = (0.0, 0.05, 0.4)
π = np.array([0.6, 0.3, 0.1])


def members(walks=WALKS):
    return [UnknownGain(C.model, GAIN, walk=walk) for walk in walks]


@pytest.mark.parametrize("engine", ["native", "xla"])
def test_weights_moments_and_quantiles_are_those_of_the_mixture(engine):
    alone = [estimate(one, C.record, prior=C.prior) for one in members()]
    found = estimate(Mixture(members(), probability=π), C.record, prior=C.prior, engine=engine)
    total = np.log(π) + np.cumsum([one.log_likelihood_steps for one in alone], axis=1).T
    w = np.exp(total - np.logaddexp.reduce(total, axis=1)[:, None])
    assert_allclose(found.extra["probability"], w, rtol=1e-9)
    assert_allclose(found.log_likelihood, np.logaddexp.reduce(total[-1]), rtol=1e-10)
    for name, spread in (("mean", "covariance"), ("gain", "gain_covariance")):
        m, P = (np.stack([getattr(one, which) for one in alone], axis=1) for which in (name, spread))
        mean = np.einsum("tk,tki->ti", w, m)
        apart = m - mean[:, None]
        assert_allclose(getattr(found, name), mean, rtol=1e-9, atol=1e-12)
        expected = np.einsum("tk,tkij->tij", w, P + apart[..., None] * apart[..., None, :])
        assert_allclose(getattr(found, spread), expected, rtol=1e-9, atol=1e-12)
    m, sd = (
        np.array([f(one) for one in alone])
        for f in (lambda r: r.gain[-1, 0], lambda r: r.gain_covariance[-1, 0, 0] ** 0.5)
    )
    z = (found.gain_quantiles[-1, 0][:, None] - m) / sd
    assert_allclose(norm.cdf(z) @ w[-1], [0.025, 0.16, 0.5, 0.84, 0.975], atol=1e-5)


def test_members_may_have_disturbances_of_their_own_and_the_prior_leaves_them_out():
    plant = StateSpace([[-1.0, 0.3], [0.0, -2.0]], [[0.5], [2.0]], Q=0.1 * np.eye(2), R=0.01 * np.eye(2), dt=0)
    rng = np.random.default_rng(0)
    record = Record(rng.normal(size=(40, 2)), rng.normal(size=(40, 1)), dt=0.1)
    lasting = markov_disturbance(plant, time_constant=0.5, density=[0.2, 0.0])
    algorithms = [UnknownGain(lasting, GAIN), UnknownGain(plant, GAIN)]
    prior = Prior(np.zeros(2), np.eye(2))
    found = estimate(Mixture(algorithms), record, prior=prior)
    assert found.names.states == plant.states
    alone = [estimate(one, record, prior=prior) for one in algorithms]
    w = found.extra["probability"][-1]
    odds = np.exp(alone[0].log_likelihood - alone[1].log_likelihood)
    assert_allclose(w[0] / w[1], odds, rtol=1e-8)
    assert_allclose(found.mean[-1], w[0] * alone[0].mean[-1, :2] + w[1] * alone[1].mean[-1], rtol=1e-9)


def test_a_detector_takes_the_likelihood_of_its_undecided_jumps_with_it():
    model = StateSpace([[0.5]], [[1.0]], Q=[[0.0]], R=[[0.01]], dt=1)
    rng = np.random.default_rng(1)
    u, gain = np.ones(40), np.where(np.arange(40) < 30, 1.0, 0.6)
    x = np.zeros(40)
    for k in range(39):
        x[k + 1] = 0.5 * x[k] + gain[k] * u[k]
    record, prior = Record(x + 0.1 * rng.normal(size=40), u, dt=1), Prior([0.0], [[0.0]])
    settings = {"slots": 4, "levels": 2, "seconds_between_changes": 50.0}
    pair = [ChangeDetection(UnknownGain(model, GAIN), walk=walk, **settings) for walk in (0.0, 0.01)]
    found, alone = estimate(Mixture(pair), record, prior=prior), [estimate(one, record, prior=prior) for one in pair]
    assert alone[0].extra["alarm"].any()
    total = np.cumsum([one.log_likelihood_steps for one in alone], axis=1)
    total = total - np.log1p(-np.array([one.jump_probability for one in alone]))
    assert_allclose(found.extra["probability"].T, np.exp(total - np.logaddexp.reduce(total, axis=0)), rtol=1e-8)
    for name in ("alarm", "onset", "statistic"):
        assert_allclose(found.extra[name], alone[0].extra[name], rtol=1e-9)


def test_an_undetermined_gain_has_no_quantiles():
    free = Prior([0.0], [[0.0]], diffuse=[[1.0]])
    quiet = Record(np.zeros(3), np.array([0.0, 1.0, 0.0]), dt=1)
    model = StateSpace([[0.5]], [[1.0]], Q=[[0.0]], R=[[0.01]], dt=1)
    found = estimate(Mixture([UnknownGain(model, free)]), quiet, prior=Prior([0.0], [[0.0]]))
    assert np.isnan(found.gain_quantiles[:2]).all()
    assert np.isfinite(found.gain_quantiles[2]).all()


def test_each_fault_has_a_sentence(refused):
    other = replace(C.model, inputs=("u1", "u9"))
    one = UnknownGain(C.model, GAIN)
    assert "`algorithms` must be a list of algorithms" in refused(lambda: Mixture([]))[0]
    assert "`algorithms` must be a list of algorithms" in refused(lambda: Mixture(one))[0]
    assert "must have the same inputs" in refused(lambda: Mixture([one, UnknownGain(other, GAIN)]))[0]
    two = UnknownGain(C.model, Prior([1.0, 1.0], np.eye(2)), directions="per_input")
    assert "must have the same gains: the first has 'gain'" in refused(lambda: Mixture([one, two]))[0]
    assert "the same gains" in refused(lambda: Mixture([one, Kalman(C.model)]))[0]
    assert "sum to 1" in refused(lambda: Mixture([one, one], probability=[0.5, 0.6]))[0]
    assert "`probability` must be" in refused(lambda: Mixture([one, one], probability=[1.0]))[0]
    assert "write UnknownGain(model)" in refused(lambda: Mixture([UnknownGain]))[0]
