"""Gaps: bridges against the joint Gaussian of state and input, breaks, and rows of NaN against long intervals."""

import numpy as np
import pytest
from benchmarks.figures import gaps as figures
from numpy.testing import assert_allclose
from scipy.linalg import expm
from scipy.signal import lfilter

import estimable as es
from estimable.models.stationary_spread import spread

A, B = np.array([[-1.3, 1.0], [0.5, -1.0]]), np.array([[-0.2], [-3.0]])
Q, R, DT, T = np.diag([1e-3, 0.1]), np.diag([1e-3, 0.01]), 0.02, 120
CONTINUOUS = es.StateSpace(A, B, Q=Q, R=R, dt=0)
PRIOR, GAIN = es.Prior([0.0, 0.0], np.eye(2)), es.Prior([0.9], [[0.2]])
RNG = np.random.default_rng(4)
U = np.cumsum(0.2 * RNG.normal(size=(T, 1)), axis=0)
Y = RNG.normal(size=(T, 2))
INSIDE = np.zeros(T, bool)
INSIDE[30:34] = INSIDE[70:85] = True


def model_of(hold, discrete):
    return CONTINUOUS.discretise(DT, hold=hold) if discrete else CONTINUOUS


def with_nan(hold):
    return es.Record(np.where(INSIDE[:, None], np.nan, Y), np.where(INSIDE[:, None], np.nan, U), dt=DT, hold=hold)


def without_rows(hold):
    return es.Record(Y[~INSIDE], U[~INSIDE], t=DT * np.flatnonzero(~INSIDE), hold=hold)


def joint(P, u, u_end, g, h, hold):
    """Mean and covariance of x after h seconds, from (x, u) as one Gaussian whose input is a Brownian motion."""
    F = np.block([[A, B], [np.zeros((1, 3))]])
    N = np.zeros((3, 3))
    N[:2, :2], N[2, 2] = Q, g
    E = expm(np.block([[-F, N], [np.zeros((3, 3)), F.T]]) * h)
    Φ = E[3:, 3:].T
    S = Φ @ np.block([[P, np.zeros((2, 1))], [np.zeros((1, 3))]]) @ Φ.T + Φ @ E[:3, 3:]
    m = Φ @ np.array([0.0, 0.0, u])
    if hold == "first_order":
        K = S[:2, 2] / S[2, 2]
        return m[:2] + K * (u_end - m[2]), S[:2, :2] - np.outer(K, S[2, :2])
    return m[:2], S[:2, :2]


@pytest.mark.parametrize("hold", ["first_order", "zero_order"])
def test_a_bridge_is_the_conditional_of_a_brownian_input(hold):
    h, g = 0.5, 2.0
    t = np.concatenate([DT * np.arange(6), 5 * DT + h + DT * np.arange(6)])
    y, u = np.full((12, 2), np.nan), np.zeros((12, 1))
    u[5:] = 1.5
    u[6:] = -0.5
    record = es.Record(y, u, t=t, hold=hold)
    found = es.estimate(es.Kalman(CONTINUOUS), record, prior=PRIOR, gaps=es.Gaps("bridge", diffusion=[g]))
    (gap,) = found.gaps
    assert (gap.row, gap.end, gap.done) == (5, 6, "bridge")
    start = found.covariance[5]
    mean, covariance = joint(start, 1.5, -0.5, g, h, hold)
    assert_allclose(found.mean[6], expm(A * h) @ found.mean[5] + mean, rtol=1e-9, atol=1e-12)
    assert_allclose(found.covariance[6], covariance, rtol=1e-8)


@pytest.mark.parametrize("hold", ["first_order", "zero_order"])
@pytest.mark.parametrize("discrete", [False, True])
@pytest.mark.parametrize("gain", [False, True])
@pytest.mark.parametrize("how", ["bridge", "break"])
def test_rows_of_nan_equal_a_long_interval(hold, discrete, gain, how):
    model = model_of(hold, discrete)
    algorithm = es.UnknownGain(model, GAIN) if gain else es.Kalman(model)
    rows, long = (
        es.estimate(algorithm, record, prior=PRIOR, gaps=how) for record in (with_nan(hold), without_rows(hold))
    )
    assert rows.engine == long.engine == "native"
    assert_allclose(rows.mean[~INSIDE], long.mean, rtol=0, atol=1e-10)
    assert_allclose(rows.covariance[~INSIDE], long.covariance, rtol=0, atol=1e-10)
    assert_allclose(rows.log_likelihood, long.log_likelihood, rtol=1e-10)
    assert [gap.seconds for gap in rows.gaps] == pytest.approx([gap.seconds for gap in long.gaps])
    variance = rows.covariance[:, 1, 1]
    assert variance[76] > 2 * variance[69]
    assert np.isnan(rows.innovation[INSIDE]).all()


@pytest.mark.parametrize("how", ["bridge", "break"])
def test_smoothing_over_gaps(how):
    algorithm = es.UnknownGain(CONTINUOUS, GAIN)
    rows, long = (
        es.smooth(algorithm, record, prior=PRIOR, gaps=how)
        for record in (with_nan("first_order"), without_rows("first_order"))
    )
    assert_allclose(rows.mean[~INSIDE], long.mean, rtol=0, atol=1e-10)
    assert_allclose(rows.covariance[~INSIDE], long.covariance, rtol=0, atol=1e-10)
    assert [gap.done for gap in rows.gaps] == [how, how]
    if how == "bridge":  # pinned at both ends
        filtered = es.estimate(algorithm, with_nan("first_order"), prior=PRIOR, gaps=how)
        assert np.all(rows.covariance[70:85, 1, 1] < filtered.covariance[70:85, 1, 1])
        assert rows.covariance[77, 1, 1] > rows.covariance[69, 1, 1]


def test_a_smoothed_row_inside_a_gap_is_that_of_a_measured_one_without_information():
    """With the row inside the gap present, and its output too noisy to tell anything, the joint Gaussian is the same."""
    keep = ~INSIDE
    inside = keep.copy()
    inside[77] = True
    quiet = es.StateSpace(A, np.zeros((2, 1)), Q=Q, R=R, dt=0)  # the input does not matter: only process noise
    full = es.smooth(es.Kalman(quiet), with_nan("zero_order"), prior=PRIOR, gaps="bridge")
    y = np.where(INSIDE[:, None], np.nan, Y)[inside]
    part = es.Record(y, np.zeros((inside.sum(), 1)), t=DT * np.flatnonzero(inside))
    exact = es.smooth(es.Kalman(quiet), part, prior=PRIOR, gaps="bridge")
    at = int(np.sum(inside[:77]))
    assert_allclose(full.mean[77], exact.mean[at], rtol=1e-8, atol=1e-10)
    assert_allclose(full.covariance[77], exact.covariance[at], rtol=1e-8)


@pytest.mark.parametrize("hold", ["first_order", "zero_order"])
@pytest.mark.parametrize("how", ["bridge", "break", "auto"])
def test_online_equals_offline(hold, how):
    settings = es.Gaps(how, diffusion=[1.0], spread=[2.0])
    algorithm = es.UnknownGain(CONTINUOUS, GAIN)
    for record in (with_nan(hold), without_rows(hold)):
        found = es.estimate(algorithm, record, prior=PRIOR, gaps=settings)
        running = es.online(algorithm, prior=PRIOR, hold=hold, gaps=settings)
        for k in range(len(record)):
            info = running.correct(record.y[k])
            if not np.isnan(record.y[k]).all():
                assert_allclose(info.mean, found.mean[k], rtol=0, atol=1e-10)
                assert_allclose(info.covariance, found.covariance[k], rtol=0, atol=1e-10)
            if k + 1 < len(record):
                ends = {"u_end": record.u[k + 1]} if hold == "first_order" else {}
                running.predict(record.u[k], dt=float(record.t[k + 1] - record.t[k]), **ends)
        assert {gap.done for gap in running.gaps} == {gap.done for gap in found.gaps}


def test_a_bank_and_a_fit_and_a_forecast():
    record, algorithm = with_nan("first_order"), es.Kalman(CONTINUOUS)
    one = es.estimate(algorithm, record, prior=PRIOR, gaps="bridge")
    bank = es.estimate_bank(algorithm, [record, record], prior=PRIOR, gaps="bridge")
    assert_allclose(bank.mean[1], one.mean, atol=1e-12)
    assert_allclose(bank.covariance[1], one.covariance, atol=1e-12)
    assert bank.gaps == one.gaps
    long = without_rows("first_order")
    fits = [es.fit_noise(algorithm, r, prior=PRIOR, free=("R",), gaps="break", progress=False) for r in (record, long)]
    assert_allclose(fits[0].parameters, fits[1].parameters, rtol=1e-6)
    assert es.forecast(one, np.zeros((3, 1))).output.shape == (3, 2)


def test_auto_bridges_what_is_short_and_breaks_what_is_long():
    quick = es.StateSpace([[-20.0]], [[20.0]], Q=[[0.01]], R=[[0.01]], dt=0)
    u, y = lfilter([1.0], [1.0, -0.95], RNG.normal(size=(400, 1)), axis=0), RNG.normal(size=(400, 1))
    inside = np.zeros(400, bool)
    inside[50] = inside[200:300] = True
    y[inside], u[inside] = np.nan, np.nan
    found = es.estimate(es.Kalman(quick), es.Record(y, u, dt=0.01), prior=es.Prior([0.0], [[1.0]]))
    assert [gap.done for gap in found.gaps] == ["bridge", "break"]
    assert "restart" in found.gaps[1].sentence


def test_a_break_of_the_record_starts_the_state_and_carries_the_gain():
    record = es.Record(Y, U, dt=DT, breaks=[60])
    algorithm = es.UnknownGain(CONTINUOUS, GAIN)
    found, plain = (
        es.estimate(algorithm, record, prior=PRIOR),
        es.estimate(algorithm, es.Record(Y, U, dt=DT), prior=PRIOR),
    )
    assert [(gap.end, gap.done) for gap in found.gaps] == [(60, "break")]
    assert_allclose(found.mean[:60], plain.mean[:60], atol=1e-12)
    predicted = found.innovation_covariance[60] - R
    assert np.all(np.diagonal(predicted) > 5 * np.diagonal(plain.innovation_covariance[60] - R))
    assert found.gain_covariance[60, 0, 0] <= found.gain_covariance[59, 0, 0] * (1 + 1e-9)


@pytest.mark.parametrize("size", [2, 3, 7])
@pytest.mark.parametrize("kind", ["stable", "marginal", "unstable"])
def test_innovations_after_a_break_are_as_large_as_said(size, kind):
    model = figures.plants()[size, kind]
    assert max(figures.after_a_break(model, seed) for seed in range(3)) < 4.5


def test_the_gain_of_a_flight_with_gaps():
    rows = figures.table(12)
    for seconds, z, ratio in rows:
        assert z < 1.6  # of 12 flights: 1.2 within two standard errors
        assert ratio < (1.45 if seconds == 1 else 1.2)


def test_a_nonlinear_model_is_bridged_or_needs_a_prior_for_a_break():
    smooth = es.NonlinearModel(
        lambda x, u, θ: -(x**3) + u, lambda x, u, θ: x, Q=[[0.01]], R=[[0.01]], dt=0, inputs=["u1"], substeps=2
    )
    u = np.where(INSIDE[:, None], np.nan, U)
    record = es.Record(Y[:, :1], u, dt=DT)
    prior = es.Prior([0.0], [[1.0]])
    found = es.estimate(es.ExtendedKalman(smooth), record, prior=prior)
    plain = es.estimate(es.ExtendedKalman(smooth), es.Record(Y[:, :1], U, dt=DT), prior=prior)
    assert {gap.done for gap in found.gaps} == {"bridge"}
    assert np.all(found.covariance[76, 0, 0] > plain.covariance[76, 0, 0])
    with pytest.raises(es.InputError, match="no stationary spread"):
        es.estimate(es.ExtendedKalman(smooth), record, prior=prior, gaps="break")
    again = es.estimate(es.ExtendedKalman(smooth), record, prior=prior, gaps=es.Gaps("break", restart=prior))
    assert {gap.done for gap in again.gaps} == {"break"}


def test_columns_of_the_record_in_another_order_change_nothing():
    two = es.StateSpace(A, np.hstack([B, [[5.0], [0.0]]]), Q=Q, R=R, dt=0, inputs=["a", "b"], outputs=["p", "q"])
    u = np.where(INSIDE[:, None], np.nan, np.hstack([U, 0.1 * np.sin(U)]))
    ordered = es.Record(Y, u, dt=DT, inputs=["a", "b"], outputs=["p", "q"])
    mixed = es.Record(
        Y[:, ::-1], np.stack([U[:, 0], u[:, 1], u[:, 0]], 1), dt=DT, inputs=["other", "b", "a"], outputs=["q", "p"]
    )
    for how in ("bridge", "break", "auto"):
        found, exact = (es.estimate(es.Kalman(two), one, prior=PRIOR, gaps=how) for one in (mixed, ordered))
        assert_allclose(found.covariance, exact.covariance, rtol=1e-12)
        assert_allclose(found.mean, exact.mean, atol=1e-12)


def test_an_input_that_is_not_logged_while_outputs_are():
    u = np.where(INSIDE[:, None], np.nan, U)
    record = es.Record(Y, u, dt=DT, hold="first_order")
    found = es.estimate(es.Kalman(CONTINUOUS), record, prior=PRIOR, gaps="bridge")
    plain = es.estimate(es.Kalman(CONTINUOUS), es.Record(Y, U, dt=DT, hold="first_order"), prior=PRIOR)
    assert np.all(found.covariance[72:84, 1, 1] > plain.covariance[72:84, 1, 1])
    assert len(found.gaps) == 2


def test_the_last_input_matters_to_no_row():
    u = U.copy()
    u[-1] = np.nan
    found = es.estimate(es.Kalman(CONTINUOUS), es.Record(Y, u, dt=DT), prior=PRIOR)
    plain = es.estimate(es.Kalman(CONTINUOUS), es.Record(Y, U, dt=DT), prior=PRIOR)
    assert found.gaps == ()
    assert_allclose(found.mean, plain.mean, atol=1e-12)


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ("jump", "`gaps` must be one of"),
        ("refuse", "the input is unknown from row 29 to row 34"),
        (es.Gaps("bridge", diffusion=[1.0, 2.0]), "`diffusion` of the gaps must have 1 entry"),
    ],
)
def test_refusals(given, sentence):
    with pytest.raises(es.InputError, match=sentence):
        es.estimate(es.Kalman(CONTINUOUS), with_nan("zero_order"), prior=PRIOR, gaps=given)


def test_refusals_of_settings():
    with pytest.raises(es.InputError, match="`diffusion` must be variances"):
        es.Gaps("bridge", diffusion=[-1.0])
    with pytest.raises(es.InputError, match="a bridge online needs the variance"):
        es.online(es.Kalman(CONTINUOUS), prior=PRIOR, gaps="bridge")


def test_the_spread_of_a_model_with_an_integrator():
    found = spread(np.diag([-1.0, 0.0]), np.eye(2), np.zeros((2, 1)), np.zeros(1), np.zeros(1), 0.0)
    assert_allclose(found.covariance, np.diag([0.5, 0.0]), atol=1e-12)
    assert_allclose(np.abs(found.diffuse), [[0.0], [1.0]], atol=1e-12)


def test_the_spread_of_an_input_that_hardly_moves_is_that_of_a_constant():
    slow = spread(np.array([[-2.0]]), np.zeros((1, 1)), np.ones((1, 1)), np.array([4.0]), np.array([1e-9]), 0.0)
    constant = spread(np.array([[-2.0]]), np.zeros((1, 1)), np.ones((1, 1)), np.array([4.0]), np.zeros(1), 0.0)
    assert_allclose(slow.covariance, [[1.0]], rtol=1e-6)
    assert_allclose(constant.covariance, [[1.0]], rtol=1e-12)


@pytest.mark.parametrize("hold", ["first_order", "zero_order"])
def test_an_input_that_stays_unknown_online_is_as_uncertain_as_offline(hold):
    """Outputs are seen while the input walks away unseen: the errors stay within what is said, as offline."""
    a, dt, seen, errors = 0.05, 0.1, slice(40, 120), {"online": [], "offline": []}
    model = es.StateSpace([[-a]], [[1.0]], Q=[[1e-4]], R=[[1.0]], dt=0)
    prior, gaps, φ = es.Prior([0.0], [[1.0]]), es.Gaps("bridge", diffusion=[1.0]), np.exp(-a * dt)
    for seed in range(4):
        rng = np.random.default_rng(seed)
        u = np.cumsum(np.sqrt(dt) * rng.normal(size=121))
        held = u[:-1] if hold == "zero_order" else (u[:-1] + u[1:]) / 2
        x = lfilter([0.0, 1.0], [1.0, -φ], (1 - φ) / a * held)
        record = es.Record(x + rng.normal(size=120), np.where(np.arange(120) < 30, u[:-1], np.nan), dt=dt, hold=hold)
        offline = es.estimate(es.Kalman(model), record, prior=prior, gaps=gaps)
        running, told = es.online(es.Kalman(model), prior=prior, hold=hold, gaps=gaps), []
        for k in range(119):
            info = running.correct(record.y[k])
            told.append((info.mean[0], info.covariance[0, 0]))
            running.predict(record.u[k], **({"u_end": record.u[k + 1]} if hold == "first_order" else {}), dt=dt)
            if k == 60:
                with pytest.raises(es.InputError, match="the run is inside a gap of its input: save it after a step"):
                    running.save("run.npz")
        mean, variance = np.array(told)[seen].T
        errors["online"].append((mean - x[seen][: len(mean)]) ** 2 / variance)
        errors["offline"].append((offline.mean[seen, 0] - x[seen]) ** 2 / offline.covariance[seen, 0, 0])
    for each in errors.values():
        assert 0.3 < np.mean(np.concatenate(each)) < 1.5
