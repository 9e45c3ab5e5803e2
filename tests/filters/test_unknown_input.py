"""Inputs that nobody measured, against least squares over the whole record, and other people's numbers."""

import json
from pathlib import Path

import numpy as np
import pytest
from benchmarks.figures import unknown_levels
from numpy.testing import assert_allclose
from scipy.linalg import solve_discrete_are

from cases import covariance
from estimable import (
    InputError,
    Kalman,
    Prior,
    Record,
    StateSpace,
    UnknownInput,
    estimate,
    online,
    smooth,
    unknown_input_existence,
)
from oracles.unknown_input import least_squares

SHARED = Path(__file__).parents[3] / "shared" / "data"
A, B = np.diag([0.67, 0.53]), np.array([[1.0], [0.53]])
C, D = np.array([[0.55, 0.11], [0.0, 0.29]]), np.array([[0.4], [0.2]])
EXAMPLE = StateSpace(A, B, C, D, Q=0.08 * np.eye(2), R=0.08 * np.eye(2), dt=1)
VAGUE = Prior([0.0, 0.0], 1e6 * np.eye(2))
RANKS = ("feedthrough", "no_feedthrough", "partial", "delayed")


def system(seed, ranks, *, known=0, cross=False, varying=False, T=40):
    """A random model whose last inputs are unknown, of the case `ranks`, without unstable zeros."""
    rng = np.random.default_rng(seed)
    n, p, d = (3, 3, 2) if ranks == "partial" else (3, 2, 1)
    for _ in range(200):
        F = rng.normal(size=(n, n))
        F *= 0.9 / np.abs(np.linalg.eigvals(F)).max()
        G, H = rng.normal(size=(n, known + d)), rng.normal(size=(p, n))
        J = rng.normal(size=(p, known + d))
        if ranks in ("no_feedthrough", "delayed"):
            J[:, known:] = 0
        if ranks == "partial":
            J[:, known] = J[:, known + 1] * 0.7
        if ranks == "delayed":
            H = H - np.outer(H @ G[:, known], G[:, known]) / (G[:, known] @ G[:, known])
        if varying:
            F = F + 0.05 * rng.normal(size=(T, n, n))
        joint = covariance(rng, n + p)
        S = joint[:n, n:] if cross else None
        model = StateSpace(F, G, H, J, Q=joint[:n, :n], R=joint[n:, n:], S=S, dt=0.5)
        if unknown_input_existence(model, unknown=range(known, known + d)).exists:
            return model, tuple(range(known, known + d)), Prior(rng.normal(size=n), covariance(rng, n)), rng
    raise AssertionError


def record(model, rng, unknown, missing, T=40):
    y = 3 * rng.normal(size=(T, model.p))
    y[rng.random(y.shape) < missing] = np.nan
    u = rng.normal(size=(T, model.m))
    known = [i for i in range(model.m) if i not in unknown]
    return Record(y, u[:, known], dt=0.5, inputs=[model.inputs[i] for i in known]), u


@pytest.mark.parametrize("ranks", RANKS)
@pytest.mark.parametrize("missing", [0.0, 0.25])
def test_equals_least_squares_over_the_whole_record(ranks, missing):
    for seed in range(2):
        model, unknown, prior, rng = system(seed, ranks, known=1, cross=seed == 1, varying=seed == 1)
        data, u = record(model, rng, unknown, missing)
        result = estimate(UnknownInput(model, unknown=unknown), data, prior=prior, engine="xla")
        delay = result.names.input_delay
        assert delay == {"feedthrough": 0, "no_feedthrough": 1, "partial": 1}.get(ranks, delay)
        for k in (0, 1, 2, 7, 20, 39):
            mean, spread, free = least_squares(model, unknown, prior, data.y, u, k)
            told = np.abs(free).max(axis=1, initial=0.0) < 1e-8
            assert_allclose(np.diag(result.diffuse_covariance[k]) == 0, told)
            if told.all():
                assert_allclose(result.mean[k], mean, rtol=1e-9, atol=1e-9 * np.abs(mean).max())
                assert_allclose(result.covariance[k], spread, rtol=1e-9, atol=1e-9 * np.abs(spread).max())
            if k < delay:
                continue
            mean, spread, free = least_squares(model, unknown, prior, data.y, u, k, k - delay)
            told = np.abs(free).max(axis=1, initial=0.0) < 1e-8
            assert_allclose(np.diag(result.extra["unknown_input_diffuse_covariance"][k]) == 0, told)
            if told.all():
                assert_allclose(result.unknown_input[k], mean, rtol=1e-9, atol=1e-9 * np.abs(mean).max())
                found = result.unknown_input_covariance[k]
                assert_allclose(found, spread, rtol=1e-9, atol=1e-9 * np.abs(spread).max())


def test_equals_another_code_without_feedthrough():
    if not (SHARED / "known-answers.json").exists():
        pytest.skip("the shared data are not here")
    answers = json.loads((SHARED / "known-answers.json").read_text())
    one = next(answer for answer in answers if answer["id"].startswith("unknown input MVU"))
    given, expected = one["inputs"], one["expected"]
    model = StateSpace(given["A"], given["G"], given["C"], Q=given["Q"], R=given["R"], dt=1)
    y = np.vstack([[np.nan, np.nan], given["y_1_to_8"]])  # the prior is about row 0, which was not measured
    result = estimate(UnknownInput(model, unknown=[0]), Record(y, dt=1), prior=Prior(given["x0"], given["P0"]))
    assert_allclose(result.mean[1:], expected["x"], rtol=1e-12, atol=1e-12)
    assert_allclose(result.covariance[1:], expected["P"], rtol=1e-12, atol=1e-14)
    assert_allclose(result.unknown_input[1:, 0], expected["d"], rtol=1e-12, atol=1e-12)
    assert_allclose(result.unknown_input_covariance[1:, 0, 0], expected["var_d"], rtol=1e-12)


def fang_fixed_point(noise):
    y = np.zeros((300, 2))
    model = StateSpace(A, B, C, D, Q=noise * np.eye(2), R=noise * np.eye(2), dt=1)
    result = estimate(UnknownInput(model, unknown=["u1"], method="fang"), Record(y, dt=1), prior=VAGUE)
    return result.extra["own_covariance"][-1], result.covariance[-1]


@pytest.mark.parametrize("scale", [1, 10])
def test_fang_has_the_fixed_points_as_printed(scale):
    own, true = fang_fixed_point(0.08 * scale)
    assert_allclose(own / scale, [[0.5037, 0.2118], [0.2118, 0.2256]], atol=1e-4)
    assert_allclose(true / scale, [[0.8671, 0.4185], [0.4185, 0.3431]], atol=1e-4)


def test_fang_own_covariance_solves_its_equation_and_the_true_one_a_lyapunov_equation():
    own, true = fang_fixed_point(0.08)
    R = 0.08 * np.eye(2)
    W = np.linalg.inv(C @ own @ C.T + R)
    H = np.linalg.solve(D.T @ W @ D, D.T @ W)
    O = np.block([[own, -own @ C.T @ H.T], [-H @ C @ own, H @ (C @ own @ C.T + R) @ H.T]])  # noqa: E741
    M, N = np.hstack([A, B]), np.hstack([C, D])
    T, U = M @ O @ N.T, N @ O @ N.T + R
    assert_allclose(M @ O @ M.T - T @ np.linalg.solve(U, T.T) + R, own, rtol=1e-10)
    L = np.linalg.solve(U, T.T).T
    K = B @ H + L @ (np.eye(2) - D @ H)
    F = A - K @ C
    dense = np.linalg.solve(np.eye(4) - np.kron(F, F), (R + K @ R @ K.T).ravel()).reshape(2, 2)
    assert_allclose(true, dense, rtol=1e-10)


def predicted_covariance(model, unknown, steps=300):
    """The finite part of the covariance of x[k] given y[0..k-1], in the steady state."""
    running = online(UnknownInput(model, unknown=unknown), prior=Prior(np.zeros(model.n), np.eye(model.n)))
    for _ in range(steps):
        running.correct(np.zeros(model.p))
        running.predict([])
    state = running.progress.state
    return (state.factor @ state.factor.T)[: model.n, : model.n]


def test_the_exact_filter_has_the_fixed_point_as_printed_and_that_of_a_riccati_equation():
    """The input eliminated by a left inverse of D, and what then is left: a Kalman filter with cross noise."""
    found = predicted_covariance(EXAMPLE, [0], steps=80)
    assert_allclose(found, [[0.8664, 0.4181], [0.4181, 0.3428]], atol=1e-4)
    R = 0.08 * np.eye(2)
    left, rest = np.linalg.pinv(D), np.array([[0.2, -0.4]]) / np.hypot(0.2, 0.4)
    F, H, K = A - B @ left @ C, rest @ C, B @ left
    dense = solve_discrete_are(F.T, H.T, R + K @ R @ K.T, rest @ R @ rest.T, s=-K @ R @ rest.T)
    assert_allclose(found, dense, rtol=1e-10)


@pytest.mark.parametrize("method", ["auto", "fang"])
def test_errors_do_not_depend_on_the_unknown_input(method):
    rng = np.random.default_rng(1)
    T, errors = 60, []
    w, v, d = rng.normal(size=(T, 2)), rng.normal(size=(T, 2)), rng.normal(size=T)
    for size in (0.0, 1.0, 1e6):
        x, y, states = np.zeros(2), [], []
        for k in range(T):
            states.append(x)
            y.append(C @ x + D[:, 0] * size * d[k] + v[k])
            x = A @ x + B[:, 0] * size * d[k] + w[k]
        result = estimate(UnknownInput(EXAMPLE, unknown=["u1"], method=method), Record(y, dt=1), prior=VAGUE)
        errors.append(np.hstack([result.mean - np.array(states), result.unknown_input - size * d[:, None]]))
    scale = np.abs(errors[0]).max()
    assert np.abs(errors[1] - errors[0]).max() < 1e-12 * scale
    assert np.abs(errors[2] - errors[0]).max() < 1e-7 * scale


@pytest.mark.parametrize("ranks", ["feedthrough", "no_feedthrough"])
def test_a_small_prior_variance_is_a_known_input_and_a_large_one_an_unknown_one(ranks):
    model, unknown, prior, rng = system(5, ranks)
    data, _ = record(model, rng, unknown, 0.2)
    exact = estimate(UnknownInput(model, unknown=unknown), data, prior=prior)
    known = estimate(Kalman(model), Record(data.y, np.zeros((40, 1)), dt=0.5), prior=prior)
    nothing = estimate(UnknownInput(model, unknown=unknown, variance=0.0), data, prior=prior)
    assert_allclose(nothing.mean, known.mean, rtol=1e-11, atol=1e-11)
    assert_allclose(nothing.log_likelihood, known.log_likelihood, rtol=1e-11)
    wide = estimate(UnknownInput(model, unknown=unknown, variance=1e12), data, prior=prior)
    determined = np.all(np.abs(exact.diffuse_covariance) == 0, axis=(1, 2))
    sigma = np.sqrt(np.diagonal(exact.covariance, axis1=1, axis2=2))[determined]
    assert determined.sum() > 20
    assert np.all(np.abs(wide.mean - exact.mean)[determined] < 1e-3 * sigma)


def test_an_input_with_a_prior_variance_is_process_noise():
    model, unknown, prior, rng = system(6, "no_feedthrough")
    data, _ = record(model, rng, unknown, 0.2)
    some = estimate(UnknownInput(model, unknown=unknown, variance=2.5), data, prior=prior)
    G, Q = np.hstack([np.eye(3), model.B]), np.block([[model.Q, np.zeros((3, 1))], [np.zeros((1, 3)), 2.5 * np.eye(1)]])
    noisy = StateSpace(model.A, C=model.C, Q=Q, G=G, R=model.R, dt=0.5)
    by_hand = estimate(Kalman(noisy), Record(data.y, dt=0.5), prior=prior)
    assert_allclose(some.mean, by_hand.mean, rtol=1e-11, atol=1e-11)
    assert_allclose(some.log_likelihood, by_hand.log_likelihood, rtol=1e-11)


def test_an_input_that_walks_is_one_more_state():
    model, unknown, prior, rng = system(7, "feedthrough")
    data, _ = record(model, rng, unknown, 0.2)
    walking = estimate(UnknownInput(model, unknown=unknown, variance=4.0, walk=0.6), data, prior=prior)
    F = np.block([[model.A, model.B], [np.zeros((1, 3)), np.ones((1, 1))]])
    Q = np.block([[model.Q, np.zeros((3, 1))], [np.zeros((1, 3)), 0.3 * np.eye(1)]])  # .6 a second, for half a second
    longer = StateSpace(F, C=np.hstack([model.C, model.D]), Q=Q, R=model.R, dt=0.5)
    P = np.block([[prior.covariance, np.zeros((3, 1))], [np.zeros((1, 3)), 4.0 * np.eye(1)]])
    by_hand = estimate(Kalman(longer), Record(data.y, dt=0.5), prior=Prior(np.append(prior.mean, 0.0), P))
    assert_allclose(walking.mean, by_hand.mean[:, :3], rtol=1e-11, atol=1e-11)
    assert_allclose(walking.unknown_input[:, 0], by_hand.mean[:, 3], rtol=1e-11, atol=1e-11)
    assert_allclose(walking.unknown_input_covariance[:, 0, 0], by_hand.covariance[:, 3, 3], rtol=1e-11)
    assert_allclose(walking.log_likelihood, by_hand.log_likelihood, rtol=1e-11)


@pytest.mark.parametrize("ranks", ["feedthrough", "no_feedthrough"])
def test_levels_that_are_decided_rightly_make_the_filter_of_a_known_input(ranks):
    model, unknown, prior, rng = system(8, ranks, cross=True)
    data, _ = record(model, rng, unknown, 0.0)
    levels = np.array([-1e4, 1e4])
    which = rng.integers(2, size=40)
    u = levels[which][:, None]
    x, y = prior.mean, []
    for k in range(40):
        y.append(model.C @ x + model.D @ u[k])
        x = model.A @ x + model.B @ u[k]
    decided = estimate(UnknownInput(model, unknown=unknown, levels=levels), Record(y, dt=0.5), prior=prior)
    known = estimate(Kalman(model), Record(y, u, dt=0.5), prior=prior)
    delay = decided.names.input_delay
    assert np.array_equal(decided.extra["level"][delay:], which[: 40 - delay])
    assert_allclose(decided.extra["level_probability"][delay:], 1.0)
    scale = np.abs(known.mean).max()
    if delay == 0:
        assert_allclose(decided.mean, known.mean, atol=1e-10 * scale)
        assert_allclose(decided.covariance, known.covariance, rtol=1e-8)
    assert_allclose(decided.unknown_input[delay:, 0], u[: 40 - delay, 0], rtol=1e-12)


def test_online_with_known_inputs_beside_the_unknown_one():
    model, unknown, prior, rng = system(9, "partial", known=1)
    data, _ = record(model, rng, unknown, 0.2)
    whole = estimate(UnknownInput(model, unknown=unknown), data, prior=prior)
    running = online(UnknownInput(model, unknown=unknown), prior=prior)
    for k in range(12):
        info = running.correct(data.y[k], data.u[k])
        running.predict(data.u[k])
        assert_allclose(info.unknown_input, whole.unknown_input[k], rtol=1e-10, atol=1e-10)


def test_no_output_at_all_leaves_everything_unknown_and_says_so():
    blind = estimate(
        UnknownInput(EXAMPLE, unknown=["u1"]), Record(np.full((5, 2), np.nan), dt=1), prior=Prior([1.0, 2.0], np.eye(2))
    )
    assert_allclose(blind.mean[0], [1.0, 2.0])
    assert np.all(np.diagonal(blind.diffuse_covariance[1:], axis1=1, axis2=2) > 0)
    assert np.all(blind.extra["unknown_input_diffuse_covariance"] > 0)
    assert blind.log_likelihood == 0


def test_a_lost_output_costs_what_it_costs():
    """Two outputs and one input: known again at the next sample (variance 5.6), two lost in a row need two more (272)."""
    T = 60
    y = np.zeros((T, 2))
    y[50, 0] = np.nan
    one = estimate(UnknownInput(EXAMPLE, unknown=["u1"]), Record(y, dt=1), prior=VAGUE)
    assert np.all(one.diffuse_covariance == 0)
    y[50] = np.nan
    both = estimate(UnknownInput(EXAMPLE, unknown=["u1"], delay=1), Record(y, dt=1), prior=VAGUE)
    assert both.extra["unknown_input_diffuse_covariance"][50] == 0  # of row 49
    assert np.all(both.diffuse_covariance[51] == 0)
    assert_allclose(both.unknown_input_covariance[51, 0, 0], 5.6, atol=0.05)
    y[51] = np.nan
    two = estimate(UnknownInput(EXAMPLE, unknown=["u1"], delay=3), Record(y, dt=1), prior=VAGUE)
    assert np.all(two.diffuse_covariance[51].diagonal() > 0)
    assert np.all(two.diffuse_covariance[53] == 0)
    assert_allclose(two.unknown_input_covariance[53, 0, 0], 272, rtol=0.02)


@pytest.mark.parametrize(("ranks", "lag"), [("partial", None), ("feedthrough", None), ("no_feedthrough", 2)])
def test_smoothed_it_equals_least_squares_with_later_samples(ranks, lag):
    model, unknown, prior, rng = system(11, ranks, known=1, cross=ranks == "partial", varying=ranks == "feedthrough")
    data, u = record(model, rng, unknown, 0.25)
    result = smooth(UnknownInput(model, unknown=unknown), data, prior=prior, lag=lag, engine="xla")
    assert result.names.input_delay == 0
    free_input = result.extra["unknown_input_diffuse_covariance"]
    for k in (0, 1, 7, 20, 37, 39):
        last = result.used[k]
        for j, mean, spread, free in (
            (None, result.mean[k], result.covariance[k], result.diffuse_covariance[k]),
            (k, result.unknown_input[k], result.unknown_input_covariance[k], free_input[k]),
        ):
            expected, covariance_, left = least_squares(model, unknown, prior, data.y, u, last, j, state=k)
            told = np.abs(left).max(axis=1, initial=0.0) < 1e-8
            assert_allclose(np.diag(free) == 0, told)
            if told.all():
                assert_allclose(mean, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
                assert_allclose(spread, covariance_, rtol=1e-9, atol=1e-9 * np.abs(covariance_).max())


def test_levels_and_fang_cannot_be_smoothed():
    for how in ({"levels": [0.0, 1.0]}, {"method": "fang"}):
        with pytest.raises(InputError, match="smooth needs a linear Gaussian model throughout"):
            smooth(UnknownInput(EXAMPLE, unknown=["u1"], **how), Record(np.zeros((3, 2)), dt=1), prior=VAGUE)


def test_levels_that_are_uncertain_stay_uncertain():
    """Two levels in noise of nearly their size: the covariance is right, and a decision is as likely right as it says."""
    nees, stated, right, _, beyond = unknown_levels.found(1.0, draws=6)
    assert 0.9 < nees < 1.2
    assert abs(stated - right) < 0.03
    assert beyond < 0.01


def test_the_likelihood_of_levels_is_that_of_the_mixture():
    """One row: y is a sum of Gaussians, one a level."""
    model = StateSpace([[0.5]], [[1.0]], [[1.0]], [[2.0]], Q=[[0.1]], R=[[0.3]], dt=1)
    levels = np.array([-1.0, 0.5, 2.0])
    run = estimate(
        UnknownInput(model, unknown=["u1"], levels=levels), Record([[1.3]], dt=1), prior=Prior([0.2], [[0.4]])
    )
    e = 1.3 - 0.2 - 2 * levels
    densities = np.exp(-(e**2) / 2 / 0.7) / np.sqrt(2 * np.pi * 0.7)
    assert_allclose(run.log_likelihood, np.log(densities.mean()), rtol=1e-10)
    w, K = densities / densities.sum(), 0.4 / 0.7
    each = 0.2 + K * e
    assert_allclose(run.mean[0], [w @ each], rtol=1e-10)
    assert_allclose(run.covariance[0], [[0.4 * (1 - K) + w @ (each - w @ each) ** 2]], rtol=1e-9)
