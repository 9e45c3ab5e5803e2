"""What must not depend on how the problem is written down."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from cases import SIZES, case
from estimable import Kalman, Prior, Record, StateSpace, UnknownGain, estimate, load, online, simulate, simulate_bank

SEEDS = st.integers(0, 10**6)
few = settings(max_examples=15, deadline=None, derandomize=True)


def kalman(c):
    return Kalman(c.model)


def unknown_gain(c):
    return UnknownGain(c.model, Prior([0.5], [[2.0]]), walk=0.1)


def constant_gain(c):
    return UnknownGain(c.model, Prior([0.5], [[2.0]]))


BUILDERS = pytest.mark.parametrize("build", [kalman, unknown_gain], ids=lambda b: b.__name__)


@BUILDERS
@given(seed=SEEDS, sizes=st.sampled_from(SIZES))
@few
def test_a_change_of_state_basis_leaves_innovations_and_gain_unchanged(build, seed, sizes):
    c = case(seed, sizes)
    basis = c.rng.normal(size=(sizes[0], sizes[0])) + 2 * np.eye(sizes[0])
    direct = estimate(build(c), c.record, prior=c.prior)
    turned = estimate(build(c._replace(model=c.model.in_basis(basis))), c.record, prior=c.prior.in_basis(basis))
    tolerance = 1e-13 * max(np.linalg.cond(basis), 10) ** 2
    assert_allclose(turned.innovation, direct.innovation, rtol=tolerance, atol=tolerance)
    assert_allclose(turned.log_likelihood, direct.log_likelihood, rtol=tolerance)
    assert_allclose(turned.mean, direct.mean @ basis.T, rtol=tolerance, atol=tolerance)
    if direct.gain is not None:
        assert_allclose(turned.gain, direct.gain, rtol=tolerance, atol=tolerance)


@BUILDERS
@given(seed=SEEDS, channel=st.integers(0, 2))
@few
def test_a_channel_never_seen_is_a_channel_deleted(build, seed, channel):
    c = case(seed, (4, 1, 3))
    y = c.record.y.copy()
    y[:, channel] = np.nan
    keep = [i for i in range(3) if i != channel]
    blind = estimate(build(c), replace(c.record, y=y), prior=c.prior)
    model = replace(c.model, C=c.model.C[keep], D=c.model.D[keep], R=c.model.R[np.ix_(keep, keep)], outputs=None)
    deleted = estimate(build(c._replace(model=model)), Record(y[:, keep], c.record.u, dt=0.5), prior=c.prior)
    assert_allclose(blind.mean, deleted.mean, rtol=1e-12, atol=1e-12)
    assert_allclose(blind.covariance, deleted.covariance, rtol=1e-12, atol=1e-12)
    assert_allclose(blind.log_likelihood, deleted.log_likelihood, rtol=1e-12)


@BUILDERS
@given(seed=SEEDS)
@few
def test_what_a_missing_channel_would_have_said_does_not_matter(build, seed):
    c = case(seed, (4, 1, 3), cross=True)
    row = int(c.rng.integers(12))
    first, second = c.record.y.copy(), c.record.y.copy()
    first[row, 1], second[row, 1] = np.nan, np.nan
    first[row + 1 :, 0] = 1e3  # later samples do not reach back
    a = estimate(build(c), replace(c.record, y=first), prior=c.prior)
    b = estimate(build(c), replace(c.record, y=second), prior=c.prior)
    assert np.array_equal(a.mean[: row + 1], b.mean[: row + 1])


@BUILDERS
@given(seed=SEEDS)
@few
def test_the_order_and_units_of_sensors_do_not_matter(build, seed):
    c = case(seed, (4, 1, 3), cross=True)
    order, units = c.rng.permutation(3), np.diag(10.0 ** c.rng.integers(-4, 5, size=3))
    U = units[order]
    model = replace(c.model, C=U @ c.model.C, D=U @ c.model.D, R=U @ c.model.R @ U.T, S=c.model.S @ U.T, outputs=None)
    direct = estimate(build(c), c.record, prior=c.prior)
    y = (c.record.y * np.diag(units))[:, order]
    turned = estimate(build(c._replace(model=model)), Record(y, c.record.u, dt=0.5), prior=c.prior)
    assert_allclose(turned.mean, direct.mean, rtol=1e-10, atol=1e-10)
    seen = (~np.isnan(c.record.y)) @ np.log(np.diag(units))
    assert_allclose(turned.log_likelihood_steps, direct.log_likelihood_steps - seen, rtol=1e-10, atol=1e-10)


@BUILDERS
@given(seed=SEEDS)
@settings(max_examples=5, deadline=None, derandomize=True)
def test_channels_are_matched_by_name_in_any_order(build, seed):
    c = case(seed, (3, 2, 2))
    model = replace(c.model, outputs=("a", "b"), inputs=("r", "s"))
    straight = Record(c.record.y, c.record.u, dt=0.5, outputs=["a", "b"], inputs=["r", "s"])
    mixed = Record(
        np.column_stack([c.record.y[:, 1], np.zeros(12), c.record.y[:, 0]]), c.record.u[:, ::-1], dt=0.5,
        outputs=["b", "spare", "a"], inputs=["s", "r"],
    )  # fmt: skip
    named = c._replace(model=model)
    assert np.array_equal(
        estimate(build(named), straight, prior=c.prior).mean, estimate(build(named), mixed, prior=c.prior).mean
    )


@BUILDERS
@given(seed=SEEDS, cut=st.integers(0, 11))
@settings(max_examples=5, deadline=None, derandomize=True)
def test_online_equals_offline_and_resumes_from_a_file(build, seed, cut, tmp_path_factory):
    c = case(seed, (3, 2, 2), cross=True, varying=True)
    whole = estimate(build(c), c.record, prior=c.prior)
    running = online(build(c), prior=c.prior)
    path = tmp_path_factory.mktemp("resume") / "run.npz"
    for k in range(12):
        if k == cut:
            running.save(path)
            running = load(path)
        info = running.correct(c.record.y[k], c.record.u[k])
        assert_allclose(info.mean, whole.mean[k], rtol=1e-13, atol=1e-13)
        assert_allclose(info.covariance, whole.covariance[k], rtol=1e-13, atol=1e-13)
        if k < 11:
            running.predict(c.record.u[k])
    assert_allclose(running.info.log_likelihood, whole.log_likelihood_steps[-1], rtol=1e-12)


@BUILDERS
@given(seed=SEEDS)
@settings(max_examples=5, deadline=None, derandomize=True)
def test_online_equals_offline_in_irregular_time(build, seed):
    rng = np.random.default_rng(seed)
    model = StateSpace(
        [[-1.0, 0.5], [0.0, -0.2]], rng.normal(size=(2, 1)), Q=np.eye(2), R=np.eye(2), dt=0,
        operating_point={"states": [1.0, 2.0], "inputs": [0.5]},
    )  # fmt: skip
    t = np.cumsum(rng.choice([0.1, 0.2, 0.5], size=10))
    record = Record(rng.normal(size=(10, 2)), rng.normal(size=(10, 1)), t=t, hold="first_order")
    c = case(seed, (2, 1, 1))._replace(model=model)
    whole = estimate(build(c), record, prior=c.prior)
    running = online(build(c), prior=c.prior, hold="first_order")
    for k in range(10):
        info = running.correct(record.y[k])
        assert_allclose(info.mean, whole.mean[k], rtol=1e-11, atol=1e-12)
        if k < 9:
            running.predict(record.u[k], u_end=record.u[k + 1], dt=float(t[k + 1] - t[k]))


@pytest.mark.parametrize("build", [kalman, constant_gain])
def test_a_record_with_time_steps_in_between_equals_one_with_missing_rows(build):
    rng = np.random.default_rng(5)
    model = StateSpace([[-0.4]], [[1.0]], Q=[[0.3]], R=[[0.1]], dt=0)
    y, u = rng.normal(size=(8, 1)), np.ones((8, 1))
    y[[2, 3, 6]] = np.nan
    c = case(0, (1, 1, 1))._replace(model=model)
    full = estimate(build(c), Record(y, u, dt=0.1), prior=c.prior)
    rows = [0, 1, 4, 5, 7]
    sparse = estimate(build(c), Record(y[rows], u[rows], t=0.1 * np.array(rows)), prior=c.prior)
    assert_allclose(sparse.mean, full.mean[rows], rtol=1e-10, atol=1e-12)
    assert_allclose(sparse.covariance, full.covariance[rows], rtol=1e-10, atol=1e-12)


@BUILDERS
@pytest.mark.parametrize("lost", ["zero", "hold"])
def test_a_lost_input_is_the_input_that_the_actuator_applied(build, lost):
    c = case(3, (3, 2, 2), missing=0.0)
    arrived = (c.rng.random((12, 2)) < 0.6).astype(float)
    applied = c.record.u.copy()
    for k in range(12):
        previous = applied[k - 1] if k else np.zeros(2)
        applied[k] = np.where(arrived[k] == 1, c.record.u[k], previous if lost == "hold" else 0.0)
    sent = Record(c.record.y, c.record.u, dt=0.5, arrived=arrived, lost=lost)
    a = estimate(build(c), sent, prior=c.prior)
    b = estimate(build(c), Record(c.record.y, applied, dt=0.5), prior=c.prior)
    assert_allclose(a.mean, b.mean, rtol=1e-13)
    running = online(build(c), prior=c.prior, lost=lost)
    for k in range(12):
        info = running.correct(c.record.y[k], c.record.u[k], arrived=arrived[k])
        running.predict(c.record.u[k], arrived=arrived[k])
        assert_allclose(info.mean, b.mean[k], rtol=1e-12)


def test_a_simulation_does_not_depend_on_how_many_runs_are_drawn():
    model = StateSpace([[0.9]], [[1.0]], Q=[[0.1]], R=[[0.2]], dt=1)
    u, prior = np.ones((5, 1)), Prior([1.0], [[2.0]])
    one = simulate(model, u, seed=3, prior=prior)
    few, many = (simulate_bank(model, u, seed=3, runs=runs, prior=prior) for runs in (2, 7))
    assert np.array_equal(one.record.y, many.items.record.y[0])
    assert np.array_equal(few.items.state, many.items.state[:2])
