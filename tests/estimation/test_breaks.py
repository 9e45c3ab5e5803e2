"""Breaks under windows, change detectors and mixtures: the state restarts, gains and what was learned of them go on."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import estimable as es
from estimable.frozen import replace

A, B, C = np.array([[0.9, 0.1], [-0.2, 0.8]]), np.array([[0.1], [1.0]]), np.eye(2)
Q, R, DT, T, BREAK = np.diag([1e-3, 1e-2]), np.diag([1e-2, 4e-2]), 0.1, 60, 30
MODEL = es.StateSpace(A, B, Q=Q, R=R, dt=DT)
PRIOR, GAIN = es.Prior([0.0, 0.0], np.eye(2)), es.Prior([1.0], [[0.2]])
RESTART = es.Prior([0.5, -0.5], [[4.0, 1.0], [1.0, 3.0]])
GAPS = es.Gaps("break", restart=RESTART)
RNG = np.random.default_rng(3)
U = np.sign(RNG.normal(size=(T, 1)))


def flown(onset, after, seed=0):
    """Outputs of a plant whose gain becomes `after` at a row, and whose state jumps at the break."""
    rng, x, y = np.random.default_rng(seed), np.zeros(2), []
    for k in range(T):
        x = rng.multivariate_normal(RESTART.mean, RESTART.covariance) if k == BREAK else x
        y.append(x + rng.multivariate_normal([0, 0], R))
        x = A @ x + B[:, 0] * U[k, 0] * (after if k >= onset else 1.0) + rng.multivariate_normal([0, 0], Q)
    return np.array(y)


def record_of(y, **given):
    return es.Record(y, U, dt=DT, breaks=[BREAK], **given)


def likelihoods(y, onset=None, jump=0.0):
    """The log-likelihood of each row by a textbook filter of (x, gain), whose gain has one more variance at `onset`."""
    z, P, found = np.array([0.0, 0.0, 1.0]), np.diag([1.0, 1.0, 0.2]), []
    H = np.hstack([C, np.zeros((2, 1))])
    for k in range(T):
        if k == BREAK:
            z[:2], P[:2, :], P[:, :2] = RESTART.mean, 0.0, 0.0
            P[:2, :2] = RESTART.covariance
        if k == onset:
            P[2, 2] += jump
        e, S = y[k] - H @ z, H @ P @ H.T + R
        found.append(-0.5 * (np.log(np.linalg.det(2 * np.pi * S)) + e @ np.linalg.solve(S, e)))
        K = P @ H.T @ np.linalg.inv(S)
        z, P = z + K @ e, P - K @ S @ K.T
        F = np.block([[A, B * U[k, 0]], [np.zeros((1, 2)), np.eye(1)]])
        z, P = F @ z, F @ P @ F.T
        P[:2, :2] += Q
    return np.array(found)


DETECTOR = es.ChangeDetection(
    es.UnknownGain(MODEL, GAIN), jump=0.25, scales=(1.0,), slots=T, levels=1, seconds_between_false_alarms=1e200,
)  # fmt: skip


def test_the_evidence_for_a_jump_goes_on_over_a_break():
    """Every onset's likelihood ratio is that of a textbook filter that restarts x and keeps the gain."""
    y = flown(20, 0.6)
    found = es.estimate(DETECTOR, record_of(y), prior=PRIOR, gaps=GAPS)
    plain = np.cumsum(likelihoods(y))
    ratios = np.array([np.cumsum(likelihoods(y, r, 0.25)) - plain for r in range(1, T)])
    for k in (25, BREAK, BREAK + 1, BREAK + 5, T - 1):
        exact = np.log(DT * np.sum(np.exp(ratios[:k, k])))
        assert found.extra["statistic"][k] + np.log(1e200) == pytest.approx(exact, abs=1e-6)
    assert_allclose(found.log_likelihood, plain[-1], rtol=1e-10)


def test_a_detector_takes_no_break_for_a_change():
    """The state jumps by two of its spreads; held over, that is a change of the gain."""
    detector = replace(DETECTOR, seconds_between_false_alarms=600.0)
    alarms = {"break": 0, "held": 0}
    for seed in range(8):
        y = flown(T, 1.0, seed)
        for name, record in (("break", record_of(y)), ("held", es.Record(y, U, dt=DT))):
            alarms[name] += int(np.any(es.estimate(detector, record, prior=PRIOR, gaps=GAPS).extra["alarm"]))
    assert alarms["break"] <= 1
    assert alarms["held"] >= 5


def test_rows_of_nan_and_online_equal_a_long_interval_in_a_detector():
    model = es.StateSpace([[-1.0, 1.0], [-2.0, -1.0]], [[0.0], [1.0]], Q=0.01 * np.eye(2), R=R, dt=0)
    detector = es.ChangeDetection(
        es.UnknownGain(model, GAIN), jump=0.25, slots=8, levels=3, seconds_between_false_alarms=1e3
    )
    gaps = es.Gaps("break", diffusion=[1.0], spread=[1.0])
    left = np.delete(np.arange(T), slice(BREAK, BREAK + 6))
    y, u = flown(20, 0.6), U.copy()
    y[BREAK : BREAK + 6], u[BREAK : BREAK + 6] = np.nan, np.nan
    rows = es.estimate(detector, es.Record(y, u, dt=DT), prior=PRIOR, gaps=gaps)
    long = es.estimate(detector, es.Record(y[left], u[left], t=DT * left), prior=PRIOR, gaps=gaps)
    assert [gap.done for gap in rows.gaps] == [gap.done for gap in long.gaps] == ["break"]
    assert_allclose(rows.gain[left], long.gain, atol=1e-10)
    assert_allclose(rows.mean[left], long.mean, atol=1e-10)
    assert_allclose(rows.extra["statistic"][left], long.extra["statistic"], atol=1e-8)
    running = es.online(detector, prior=PRIOR, gaps=gaps)
    for i, k in enumerate(left):
        info = running.correct(y[k])
        assert_allclose(info.gain, long.gain[i], atol=1e-10)
        if i + 1 < len(left):
            running.predict(u[k], dt=DT * (left[i + 1] - k))


def test_a_window_restarts_inside():
    """Row k is the last of a run over its window, whose state restarts where the record breaks."""
    record, inner, length = record_of(flown(T, 0.7)), es.UnknownGain(MODEL, GAIN), 8
    found = es.estimate(es.MovingWindow(inner, length), record, prior=PRIOR, gaps=GAPS)
    start = es.Prior([0.0, 0.0], np.zeros((2, 2)), diffuse=np.eye(2))
    for k in (BREAK, BREAK + 4, BREAK + length - 1):  # it begins at the break in the last case
        window = es.estimate(inner, record[k - length + 1 : k + 1], prior=start, gaps=GAPS, engine="xla")
        assert_allclose(found.mean[k], window.mean[-1], rtol=0, atol=1e-9)
        assert_allclose(found.gain[k], window.gain[-1], rtol=0, atol=1e-9)
        assert_allclose(found.gain_covariance[k], window.gain_covariance[-1], rtol=1e-7)


def test_a_mixture_weighs_members_that_restart():
    """Its numbers are those of its members, run one by one, a detector among them."""
    record = record_of(flown(20, 0.6))
    members = [replace(DETECTOR, seconds_between_changes=1e100), es.UnknownGain(replace(MODEL, Q=4 * Q), GAIN)]
    one = [es.estimate(member, record, prior=PRIOR, gaps=GAPS) for member in members]
    found = es.estimate(es.Mixture(members), record, prior=PRIOR, gaps=GAPS)
    assert_allclose(found.gain, weighed(one, "gain"), atol=1e-9)
    assert_allclose(found.mean, weighed(one, "mean"), atol=1e-9)
    assert_allclose(found.extra["statistic"], one[0].extra["statistic"], atol=1e-7)


def weighed(results, name):
    """The mean of several results, weighed by their likelihoods up to each row."""
    total = np.array([np.cumsum(one.log_likelihood_steps) for one in results])
    weight = np.exp(total - total.max(axis=0))
    return np.einsum("it,itn->tn", weight / weight.sum(axis=0), np.stack([getattr(one, name) for one in results]))


def test_a_disturbance_that_lasts_restarts_from_its_own_spread():
    """In a mixture a member with further states restarts all of them, as it does by itself."""
    record = record_of(flown(20, 0.6))
    lasting = es.markov_disturbance(MODEL, time_constant=0.3, density=0.05)
    members = [es.UnknownGain(MODEL, GAIN), es.UnknownGain(lasting, GAIN)]
    gaps = es.Gaps("break", spread=[1.0], diffusion=[1.0])
    one = [es.estimate(member, record, prior=PRIOR, gaps=gaps) for member in members]
    found = es.estimate(es.Mixture(members), record, prior=PRIOR, gaps=gaps)
    assert_allclose(found.gain, weighed(one, "gain"), atol=1e-9)
