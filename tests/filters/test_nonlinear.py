"""The nonlinear filters: equal to `Kalman` where the model is linear, and to brute-force moments where it is not."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import least_squares

import estimable as es
from cases import SIZES, case, covariance
from estimable.kernels import flow
from oracles import moments

FILTERS = {
    "extended": es.ExtendedKalman,
    "iterated": lambda model, **s: es.ExtendedKalman(model, iterations=3, **s),
    "second": es.SecondOrderKalman,
    "second twice": lambda model, **s: es.SecondOrderKalman(model, iterations=2, **s),
    "bias only": lambda model, **s: es.SecondOrderKalman(model, moments="bias_only", **s),
    "truncated": lambda model, **s: es.SecondOrderKalman(model, moments="truncated", **s),
    "unscented": es.UnscentedKalman,
    "cubature": lambda model, **s: es.UnscentedKalman(model, kappa=0.0, **s),
}
EVERY = pytest.mark.parametrize("make", FILTERS.values(), ids=FILTERS)
RNG = np.random.default_rng(3)
P0 = covariance(RNG, 2)
Q2, R2 = 0.1 * covariance(RNG, 2), 0.2 * covariance(RNG, 2)
HF, HH = (0.1 * (M + M.transpose(0, 2, 1)) for M in RNG.normal(size=(2, 2, 2, 2)))
SLOPE = np.array([[0.8, 0.3], [-0.2, 0.7]])


def f(x, u, θ):
    return SLOPE @ x + jnp.einsum("ijk,j,k->i", HF, x, x)


def h(x, u, θ):
    return x + jnp.einsum("ijk,j,k->i", HH, x, x)


QUADRATIC = es.NonlinearModel(f, h, Q=Q2, R=R2, dt=1)
Y = RNG.normal(size=(6, 2))
Y[1, 0] = Y[3, 1] = Y[4, :] = np.nan
PRIOR = es.Prior([0.3, -0.2], P0)


def close(result, oracle, **tolerance):
    means, covariances, likelihood = oracle
    assert_allclose(result.mean, means, **tolerance)
    assert_allclose(result.covariance, covariances, **tolerance)
    assert_allclose(result.log_likelihood, likelihood, **tolerance)


@EVERY
@pytest.mark.parametrize(("sizes", "varying"), [(SIZES[0], True), (SIZES[1], False), (SIZES[2], True)])
def test_of_a_linear_model_each_is_the_kalman_filter(make, sizes, varying):
    c = case(5, sizes, varying=varying)
    result, exact = (es.estimate(a, c.record, prior=c.prior, engine="xla") for a in (make(c.model), es.Kalman(c.model)))
    for field in ("mean", "covariance", "innovation", "innovation_covariance", "log_likelihood_steps"):
        assert_allclose(getattr(result, field), getattr(exact, field), rtol=1e-11, atol=1e-12)


@EVERY
def test_functions_of_a_linear_model_are_that_model(make):
    c = case(6, (3, 2, 2))
    A, B, C, D = (jnp.asarray(M) for M in (c.model.A, c.model.B, c.model.C, c.model.D))
    model = es.NonlinearModel(
        lambda x, u, θ: A @ x + B @ u, lambda x, u, θ: C @ x + D @ u, Q=c.model.Q, R=c.model.R, G=c.model.G, dt=0.5,
        states=c.model.states, inputs=c.model.inputs,
    )  # fmt: skip
    exact = es.estimate(es.Kalman(c.model), c.record, prior=c.prior)
    result = es.estimate(make(model), c.record, prior=c.prior)
    assert_allclose(result.mean, exact.mean, rtol=1e-11, atol=1e-12)
    assert_allclose(result.covariance, exact.covariance, rtol=1e-11, atol=1e-12)


def test_the_gaussian_second_order_filter_has_the_moments_of_quadratic_functions():
    oracle = moments.moment_filter(
        lambda x: np.asarray(f(x, None, None)), lambda x: np.asarray(h(x, None, None)), Q2, R2, PRIOR.mean, P0, Y,
        moments.quadrature,
    )  # fmt: skip
    close(es.estimate(es.SecondOrderKalman(QUADRATIC), es.Record(Y, dt=1), prior=PRIOR), oracle, rtol=1e-10)


@pytest.mark.parametrize("κ", [0.0, 1.0, 2.5])
def test_the_unscented_filter_is_the_textbook_one(κ):
    oracle = moments.moment_filter(
        lambda x: np.asarray(f(x, None, None)), lambda x: np.asarray(h(x, None, None)), Q2, R2, PRIOR.mean, P0, Y,
        moments.unscented(κ),
    )  # fmt: skip
    close(es.estimate(es.UnscentedKalman(QUADRATIC, kappa=κ), es.Record(Y, dt=1), prior=PRIOR), oracle, rtol=1e-10)


def test_the_extended_filter_is_the_textbook_one():
    def tangent(function):
        slope = jax.jacfwd(lambda x: function(x, None, None))

        def moments_of(_, mean, P):
            G = np.asarray(slope(mean))
            return np.asarray(function(mean, None, None)), G @ P @ G.T, P @ G.T

        return moments_of

    both = {id(f): tangent(f), id(h): tangent(h)}
    oracle = moments.moment_filter(f, h, Q2, R2, PRIOR.mean, P0, Y, lambda g, m, P: both[id(g)](g, m, P))
    close(es.estimate(es.ExtendedKalman(QUADRATIC), es.Record(Y, dt=1), prior=PRIOR), oracle, rtol=1e-10)


def test_the_iterated_filter_ends_at_the_most_probable_state():
    """Iterating is Gauss-Newton on |y - h(x)|² / R + |x - m|² / P (Bell & Cathey, IEEE TAC 38, 1993)."""
    model = es.NonlinearModel(lambda x, u, θ: x, lambda x, u, θ: jnp.exp(x[:1] / 2) + x[1:], Q=Q2, R=[[0.01]], dt=1)
    result = es.estimate(es.ExtendedKalman(model, iterations=30), es.Record([3.0], dt=1), prior=PRIOR)
    white = np.linalg.inv(np.linalg.cholesky(P0))

    def residual(x):
        return np.r_[(3.0 - np.exp(x[0] / 2) - x[1]) / 0.1, white @ (x - PRIOR.mean)]

    found = least_squares(residual, PRIOR.mean, xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    assert_allclose(result.mean[0], found, rtol=1e-6)


def test_truncated_moments_lack_the_fourth_and_bias_only_the_curvature_of_the_covariance():
    model = es.NonlinearModel(lambda x, u, θ: x, lambda x, u, θ: x**2, Q=[[0.0]], R=[[30.0]], dt=1)
    prior, record = es.Prior([2.0], [[1.5]]), es.Record([5.0], dt=1)
    for kind, second in (("gaussian", 2 * 1.5**2), ("bias_only", 0.0), ("truncated", -(1.5**2))):
        result = es.estimate(es.SecondOrderKalman(model, moments=kind), record, prior=prior)
        assert_allclose(result.innovation[0], [5 - 4 - 1.5])
        assert_allclose(result.innovation_covariance[0], [[16 * 1.5 + 30 + second]])
        assert_allclose(result.extra["output_bias"][0], [1.5])


def test_truncated_moments_that_are_no_covariance_end_the_run():
    model = es.NonlinearModel(lambda x, u, θ: x, lambda x, u, θ: x**2, Q=[[0.0]], R=[[0.1]], dt=1)
    with pytest.raises(es.RunError, match="truncated moments are no longer a covariance"):
        es.estimate(
            es.SecondOrderKalman(model, moments="truncated"), es.Record([1.0], dt=1), prior=es.Prior([0.0], [[2.0]])
        )


@pytest.mark.parametrize("make", [es.SecondOrderKalman, es.UnscentedKalman])
def test_a_noise_that_grows_with_the_state_counts_with_its_spread(make):
    """x+ = x + σ x w: var x+ = P + σ² (m² + P), where the tangent has P + σ² m²."""
    model = es.NonlinearModel(lambda x, u, θ: x, lambda x, u, θ: x, G=lambda x, u, θ: 0.5 * x[:, None], Q=[[1.0]],
                              R=[[1.0]], dt=1, states=["x"])  # fmt: skip
    blind = es.Record([np.nan, np.nan], dt=1)
    settings = {"kappa": 1.0} if make is es.UnscentedKalman else {}
    result = es.estimate(make(model, **settings), blind, prior=es.Prior([2.0], [[0.8]]))
    if make is es.SecondOrderKalman:
        assert_allclose(result.covariance[1], [[0.8 + 0.25 * (4 + 0.8)]])
    extended = es.estimate(es.ExtendedKalman(model), blind, prior=es.Prior([2.0], [[0.8]]))
    assert_allclose(extended.covariance[1], [[0.8 + 0.25 * 4]])
    assert result.covariance[1, 0, 0] > extended.covariance[1, 0, 0] or make is es.UnscentedKalman


def test_estimating_the_parameter_of_a_linear_gain_is_the_unknown_gain_filter():
    c = case(8, (2, 1, 1), feedthrough=False)
    A, B, C = (jnp.asarray(M) for M in (c.model.A, c.model.B, c.model.C))
    model = es.NonlinearModel(
        lambda x, u, θ: A @ x + θ[0] * (B @ u), lambda x, u, θ: C @ x, Q=c.model.Q, R=c.model.R, G=c.model.G, dt=0.5,
        states=c.model.states, inputs=c.model.inputs, parameters={"gain": 1.0},
    )  # fmt: skip
    gain = es.Prior([0.7], [[0.4]])
    exact = es.estimate(es.UnknownGain(c.model, gain, walk=0.02), c.record, prior=c.prior)
    result = es.estimate(es.ExtendedKalman(model, parameters=gain, walk=0.02), c.record, prior=c.prior)
    # f is linear given θ and in θ given x only: the tangents at the estimate are those of A x + θ B u, exactly
    assert_allclose(result.gain, exact.gain, rtol=1e-10)
    assert_allclose(result.gain_covariance, exact.gain_covariance, rtol=1e-9)
    assert_allclose(result.log_likelihood, exact.log_likelihood, rtol=1e-10)


@EVERY
def test_a_channel_of_nan_is_a_deleted_row(make):
    alone = es.NonlinearModel(f, lambda x, u, θ: h(x, u, θ)[1:], Q=Q2, R=R2[1:, 1:], dt=1)
    y = np.array([[np.nan, 0.4], [np.nan, -0.3], [np.nan, np.nan]])
    left = es.estimate(make(QUADRATIC), es.Record(y, dt=1), prior=PRIOR, on_failure="keep")
    right = es.estimate(make(alone), es.Record(y[:, 1:], dt=1), prior=PRIOR, on_failure="keep")
    assert_allclose(left.mean, right.mean, rtol=1e-12)
    assert_allclose(left.log_likelihood, right.log_likelihood, rtol=1e-12)


@EVERY
def test_an_exact_prior_and_exact_outputs_are_ordinary(make):
    model = es.NonlinearModel(f, h, Q=np.zeros((2, 2)), R=np.diag([0.0, 0.3]), dt=1)
    x, ys = np.array([0.3, -0.2]), []
    for _ in range(3):
        ys.append(np.asarray(h(x, None, None)))
        x = np.asarray(f(x, None, None))
    exact = es.estimate(make(model), es.Record(ys, dt=1), prior=es.Prior([0.3, -0.2], np.zeros((2, 2))))
    assert_allclose(exact.covariance, np.zeros((3, 2, 2)), atol=1e-15)
    assert_allclose([h(m, None, None) for m in exact.mean], ys, rtol=1e-13)


@EVERY
@pytest.mark.parametrize("engine", ["native", "xla"])
def test_engines_and_online_agree(make, engine):
    record = es.Record(Y, dt=1)
    reference = es.estimate(make(QUADRATIC), record, prior=PRIOR, engine="xla", on_failure="keep")
    result = es.estimate(make(QUADRATIC), record, prior=PRIOR, engine=engine, on_failure="keep")
    assert result.outcome == reference.outcome
    assert_allclose(result.mean, reference.mean, rtol=1e-11)
    if reference.outcome.code == 0:
        running = es.online(make(QUADRATIC), prior=PRIOR)
        for k in range(3):
            assert_allclose(running.correct(Y[k]).mean, reference.mean[k], rtol=1e-11)
            running.predict()


# continuous between samples


def pendulum(x, u, θ):
    return jnp.array([x[1], -9.81 * jnp.sin(x[0]) - 0.3 * x[1] + u[0]])


def swinging(substeps, **changes):
    settings = {"Q": np.diag([0.0, 0.2]), "R": [[0.01]], "dt": 0, "inputs": ["torque"], "substeps": substeps} | changes
    return es.NonlinearModel(pendulum, lambda x, u, θ: jnp.sin(x[:1]), **settings)


def test_the_moments_between_samples_are_those_of_the_textbook_equations():
    """Of one long step, beside SciPy's solver on Jazwinski's equations with Hessians written by hand."""
    mean, P, noise = np.array([0.6, -0.4]), np.array([[0.05, 0.01], [0.01, 0.2]]), np.diag([0.0, 0.2])

    def hessians(m):
        H = np.zeros((2, 2, 2))
        H[1, 0, 0] = 9.81 * np.sin(m[0])
        return H

    expected = moments.second_order_flow(
        lambda m: np.array([m[1], -9.81 * np.sin(m[0]) - 0.3 * m[1] + 0.5]),
        lambda m: np.array([[0, 1], [-9.81 * np.cos(m[0]), -0.3]]), hessians, noise, mean, P, 0.3,
    )  # fmt: skip
    blind = es.Record([np.nan, np.nan], [[0.5], [0.5]], dt=0.3, inputs=["torque"])
    for substeps, rtol in ((None, 1e-7), (15, 1e-6)):
        result = es.estimate(es.SecondOrderKalman(swinging(substeps)), blind, prior=es.Prior(mean, P))
        assert_allclose(result.mean[1], expected[0], rtol=rtol)
        assert_allclose(result.covariance[1], expected[1], rtol=rtol)


def by_map(model):
    return es.SecondOrderKalman(model, between="map")


def test_of_the_map_the_second_order_is_that_of_a_discrete_model_whose_step_is_the_path():
    def move(x, u, θ):
        return flow.runge_kutta(lambda t, x: pendulum(x, jnp.array([0.5]), θ), x, 0.3, 4)

    prior, blind = es.Prior([0.6, -0.4], [[0.05, 0.01], [0.01, 0.2]]), es.Record([0.5, np.nan, 0.3], 0.5 * np.ones((3, 1)),
                                                                             dt=0.3, inputs=["torque"])  # fmt: skip
    discrete = es.NonlinearModel(move, lambda x, u, θ: jnp.sin(x[:1]), Q=np.zeros((2, 2)), R=[[0.01]], dt=0.3)
    exact = es.estimate(es.SecondOrderKalman(discrete), es.Record(blind.y, dt=0.3), prior=prior)
    result = es.estimate(by_map(swinging(4, Q=np.zeros((2, 2)))), blind, prior=prior)
    assert_allclose(result.mean, exact.mean, rtol=1e-10)
    assert_allclose(result.covariance, exact.covariance, rtol=1e-9)


@pytest.mark.parametrize(
    ("make", "hold"),
    [
        (es.ExtendedKalman, "first_order"),
        (es.SecondOrderKalman, "zero_order"),
        (es.UnscentedKalman, "first_order"),
        (es.UnscentedKalman, "zero_order"),
        (by_map, "first_order"),
    ],
)
def test_a_continuous_linear_model_of_functions_is_the_discretised_one(make, hold):
    A, B = np.array([[-1.3, 1.0], [3.5, -1.1]]), np.array([[-0.15], [-24.3]])
    linear = es.StateSpace(A, B, Q=np.diag([0.1, 0.2]), R=0.01 * np.eye(2), dt=0)
    t = np.cumsum([0.02, 0.06, 0.035, 0.05, 0.025, 0.058, 0.03, 0.045])
    record = es.Record(RNG.normal(size=(8, 2)), RNG.normal(size=(8, 1)), t=t, hold=hold)
    model = es.NonlinearModel(lambda x, u, θ: A @ x + B @ u, lambda x, u, θ: x, Q=linear.Q, R=linear.R, dt=0,
                              inputs=["u1"], substeps=12)  # fmt: skip
    exact = es.estimate(es.Kalman(linear), record, prior=es.Prior([0.0, 0.0], np.eye(2)))
    result = es.estimate(make(model), record, prior=es.Prior([0.0, 0.0], np.eye(2)))
    assert_allclose(result.mean, exact.mean, rtol=1e-6, atol=1e-8)
    assert_allclose(result.covariance, exact.covariance, rtol=1e-6)


def test_runge_kutta_is_of_the_fourth_order():
    def error(steps):
        return abs(
            float(flow.runge_kutta(lambda t, y: -y * jnp.cos(t), jnp.ones(1), 2.0, steps)[0]) - np.exp(-np.sin(2.0))
        )

    assert 3.8 < np.log2(error(20) / error(40)) < 4.3


def test_a_solver_that_does_not_reach_the_next_sample_is_told():
    model = es.NonlinearModel(lambda x, u, θ: x**2, lambda x, u, θ: x, Q=[[0.0]], R=[[1.0]], dt=0)  # infinite at t = 1
    record = es.Record([1.0, 1.0, 1.0], dt=2.0)
    with pytest.raises(es.RunError, match=r"sample 1 .*integrator of a continuous model did not reach the next sample"):
        es.estimate(es.ExtendedKalman(model), record, prior=es.Prior([1.0], [[0.0]]))


# simulation


def test_drawing_from_functions_of_a_linear_model_is_drawing_from_the_model():
    c = case(9, (2, 1, 1))
    A, B, C, D = (jnp.asarray(M) for M in (c.model.A, c.model.B, c.model.C, c.model.D))
    model = es.NonlinearModel(
        lambda x, u, θ: A @ x + B @ u, lambda x, u, θ: C @ x + D @ u, Q=c.model.Q, R=c.model.R, G=c.model.G, dt=0.5,
        states=c.model.states, inputs=c.model.inputs,
    )  # fmt: skip
    linear, drawn = (es.simulate(m, c.record.u, seed=4, prior=c.prior) for m in (c.model, model))
    assert_allclose(drawn.state, linear.state, rtol=1e-12)
    assert_allclose(drawn.record.y, linear.record.y, rtol=1e-12)


def test_a_continuous_simulation_follows_the_equations_and_its_noise_has_the_right_size():
    quiet = swinging(8, Q=np.zeros((2, 2)), R=[[0.0]])
    drawn = es.simulate(quiet, np.ones((4, 1)), dt=0.1, seed=1, prior=es.Prior([0.5, 0.0], np.zeros((2, 2))))
    expected, _ = moments.second_order_flow(
        lambda m: np.array([m[1], -9.81 * np.sin(m[0]) - 0.3 * m[1] + 1.0]), lambda m: np.zeros((2, 2)),
        lambda m: np.zeros((2, 2, 2)), np.zeros((2, 2)), np.array([0.5, 0.0]), np.zeros((2, 2)), 0.3,
    )  # fmt: skip
    assert_allclose(drawn.state[3], expected, rtol=1e-5)
    still = es.NonlinearModel(lambda x, u, θ: -x, lambda x, u, θ: x, Q=[[2.0]], R=[[0.0]], dt=0, substeps=20)
    bank = es.simulate_bank(still, seed=2, runs=4000, steps=2, dt=0.5).items.state[:, 1, 0]
    assert abs(np.var(bank) / (1 - np.exp(-1.0)) - 1) < 0.12  # 5 sigma of 4,000 draws, and 1.3 % of the pieces
