"""A mixture run member by member is the mixture run as one algorithm."""

import numpy as np
from numpy.testing import assert_allclose

from estimable import ChangeDetection, Kalman, Mixture, Prior, Record, StateSpace, UnknownGain, estimate, simulate
from estimable.estimation.estimate_mixture import estimate_mixture


def test_it_equals_one_run_of_the_whole():
    model = StateSpace([[0.8]], [[0.5]], Q=[[0.02]], R=[[0.05]], dt=0.1)
    prior, gain, u = Prior([0.0], [[0.2]]), Prior([1.0], [[0.04]]), np.sign(np.sin(0.21 * np.arange(300)))[:, None]
    weaker = u * np.where(np.arange(300)[:, None] > 150, 0.5, 1)
    record = Record(simulate(model, weaker, seed=1).record.y, u, dt=0.1)
    members = [ChangeDetection(UnknownGain(model, gain), walk=walk) for walk in (0.0, 1e-3)]
    mixture = Mixture(members, probability=[0.7, 0.3])
    whole, parts = estimate(mixture, record, prior=prior), estimate_mixture(mixture, record, prior=prior)
    for name in ("mean", "covariance", "gain", "gain_quantiles", "innovation", "jump_probability", "log_likelihood"):
        assert_allclose(getattr(parts, name), getattr(whole, name), rtol=1e-10, atol=1e-12)
    assert set(parts.extra) == set(whole.extra)
    for name, values in whole.extra.items():
        assert_allclose(parts.extra[name], values, rtol=1e-10, atol=1e-12)


def test_angles_of_a_record_are_those_of_all_members():
    model = StateSpace([[1.0]], [[0.3]], Q=[[0.01]], R=[[0.01]], dt=1, outputs=["heading"])
    members = [Kalman(model), Kalman(StateSpace([[1.0]], [[0.3]], Q=[[1.0]], R=[[0.01]], dt=1, outputs=["heading"]))]
    heading = np.mod(0.3 * np.arange(60) + np.pi, 2 * np.pi) - np.pi
    record = Record(heading, np.ones(60), dt=1, outputs=["heading"], angles={"heading": "rad"})
    found = estimate(Mixture(members), record, prior=Prior([0.0], [[1.0]]))
    assert found.extra["probability"].shape == (60, 2)
    assert np.abs(found.innovation).max() < 1.0
