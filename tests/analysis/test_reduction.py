"""Reduced models: the same innovations, the same outputs, or an error within the bound."""

import numpy as np
import pytest

from cases import case
from estimable import Kalman, Prior, Record, StateSpace, estimability, estimate, observability, reachability, reduce


def with_hidden_parts(seed=0):
    """Six states: two of them hidden as in the source's example, one unobservable, in a random basis; n, p = 6, 2."""
    rng = np.random.default_rng(seed)
    A = np.zeros((6, 6))
    A[:2, :2] = [[0.7, -0.1], [1.0, 0.0]]
    A[2:, 2:] = np.diag([0.9, -0.4, 0.6, 0.3])
    A[4, 2] = 1.0  # the fifth state only listens
    G, C = np.zeros((6, 4)), np.zeros((2, 6))
    G[0, 0] = G[2, 1] = G[3, 2] = G[5, 3] = 1
    C[0, :2], C[1, 2:4] = [1.0, -2.0], [1.0, 1.0]
    T = rng.normal(size=(6, 6))
    back = np.linalg.inv(T)
    return StateSpace(T @ A @ back, C=C @ back, G=T @ G, Q=np.eye(4), R=np.diag([0.3, 0.5]), dt=1)


def predictor(model, prior, y, u):
    """One-step predictions (T, n), innovations and their covariances: the recursion of the textbooks."""
    x, P = prior.mean, prior.covariance
    J = np.zeros((model.n, model.p)) if model.S is None else model.G @ model.S
    states, innovations, covariances = [], [], []
    for k in range(len(y)):
        e, V = y[k] - model.C @ x - model.D @ u[k], model.C @ P @ model.C.T + model.R
        K = np.linalg.solve(V, (model.A @ P @ model.C.T + J).T).T
        states.append(x)
        innovations.append(e)
        covariances.append(V)
        x, P = (
            model.A @ x + model.B @ u[k] + K @ e,
            model.A @ P @ model.A.T + model.G @ model.Q @ model.G.T - K @ V @ K.T,
        )
    return np.array(states), np.array(innovations), np.array(covariances)


@pytest.mark.parametrize(
    "build", [with_hidden_parts, lambda: case(1, (4, 1, 3), cross=True).model], ids=["hidden", "full"]
)
def test_the_reduced_filter_has_the_innovations_and_estimates_of_the_full_one(build):
    model = build()
    small = reduce(model)
    rng = np.random.default_rng(3)
    y, u = rng.normal(size=(40, model.p)), rng.normal(size=(40, model.m))
    Π = estimability(model).prior_covariance
    full = predictor(model, Prior(np.zeros(model.n), Π), y, u)
    short = predictor(small.model, small.prior, y, u)
    assert np.allclose(full[0] @ small.to.T, short[0], rtol=0, atol=1e-11)
    assert np.allclose(short[1], full[1], rtol=0, atol=1e-11)
    assert np.allclose(short[2], full[2], rtol=1e-10)


def test_the_library_filters_with_it():
    model = StateSpace([[0.7, -0.1], [1.0, 0.0]], C=[[1.0, -2.0]], G=[[1.0], [0.0]], Q=[[1.0]], R=[[0.3]], dt=1)
    small = reduce(model)
    assert small.model.n == 1
    y = np.random.default_rng(0).normal(size=(12, 1))
    result = estimate(Kalman(small.model), Record(y, dt=1), prior=small.prior, engine="xla")
    prior = Prior(np.zeros(2), estimability(model).prior_covariance)
    assert np.allclose(result.innovation, predictor(model, prior, y, np.zeros((12, 0)))[1], atol=1e-12)


def test_only_what_is_estimable_and_observable_stays():
    model = with_hidden_parts()
    small = reduce(model)
    assert small.model.n == 3
    assert observability(small.model).observable
    assert reachability(small.model, by="noise").reachable
    assert np.allclose(small.to @ small.back, np.eye(3), atol=1e-10)


def test_the_reduced_model_has_the_covariances_of_the_outputs():
    model = with_hidden_parts()
    small = reduce(model).model
    for lag in range(1, 8):
        covariance = []
        for each in (model, small):
            Π = estimability(each).prior_covariance
            J = np.zeros((each.n, each.p)) if each.S is None else each.G @ each.S
            covariance.append(each.C @ np.linalg.matrix_power(each.A, lag - 1) @ (each.A @ Π @ each.C.T + J))
        assert np.allclose(*covariance, rtol=0, atol=1e-11)


@pytest.mark.parametrize("dt", [1.0, 0.0])
def test_a_minimal_realisation_has_the_same_response(dt):
    rng = np.random.default_rng(0)
    A = np.diag([0.5, 1.3, -0.4, 0.2, 0.1])  # unstable: no matter
    B, C = rng.normal(size=(5, 1)), rng.normal(size=(2, 5))
    B[1], C[:, 2] = 0, 0  # the second is not moved, the third not seen
    T = rng.normal(size=(5, 5))
    back = np.linalg.inv(T)
    model = StateSpace(T @ A @ back, T @ B, C @ back, R=np.eye(2), dt=dt)
    small = reduce(model, method="minimal")
    assert (small.model.n, small.error_bound) == (3, 0.0)
    for s in (0.3 + 1j, 2j, 1.7):
        full = model.C @ np.linalg.solve(s * np.eye(5) - model.A, model.B)
        assert np.allclose(
            small.model.C @ np.linalg.solve(s * np.eye(3) - small.model.A, small.model.B), full, rtol=1e-9
        )


@pytest.mark.parametrize("dt", [1.0, 0.0])
def test_balanced_truncation_keeps_its_bound(dt):
    rng = np.random.default_rng(7)
    n = 6
    A = rng.normal(size=(n, n))
    A = (
        A * (0.95 / np.abs(np.linalg.eigvals(A)).max())
        if dt
        else A - (np.linalg.eigvals(A).real.max() + 0.3) * np.eye(n)
    )
    model = StateSpace(A, rng.normal(size=(n, 2)), rng.normal(size=(2, n)), Q=0.1 * np.eye(n), R=np.eye(2), dt=dt)
    small = reduce(model, method="balanced", order=3)
    M, M_small = (
        np.hstack([model.B, np.sqrt(0.1) * np.eye(n)]),
        small.to @ np.hstack([model.B, np.sqrt(0.1) * np.eye(n)]),
    )
    worst = 0.0
    for ω in np.linspace(0, np.pi if dt else 30, 200):
        s = np.exp(1j * ω) if dt else 1j * ω
        error = model.C @ np.linalg.solve(s * np.eye(n) - model.A, M)
        error = error - small.model.C @ np.linalg.solve(s * np.eye(3) - small.model.A, M_small)
        worst = max(worst, np.linalg.norm(error, 2))
    assert small.hankel_singular_values[3] <= worst <= small.error_bound
    assert small.error_bound == pytest.approx(2 * small.hankel_singular_values[3:].sum())
    whole = reduce(model, method="balanced", order=n)
    assert whole.error_bound == 0
    gramian = reachability(StateSpace(whole.model.A, whole.to @ M, dt=dt)).gramian
    assert np.allclose(gramian, np.diag(whole.hankel_singular_values), atol=1e-8 * whole.hankel_singular_values[0])


def test_names_inputs_and_operating_points_stay():
    model = StateSpace(
        [[0.5, 0.0], [0.0, 0.3]], [[1.0], [0.0]], [[1.0, 0.0]], Q=np.diag([1.0, 0.0]), R=[[1.0]], dt=1,
        inputs=["pump"], outputs=["level"], operating_point={"states": [2.0, 5.0], "inputs": [1.0]},
    )  # fmt: skip
    small = reduce(model)
    assert (small.model.inputs, small.model.outputs, small.model.n) == (("pump",), ("level",), 1)
    assert np.allclose(small.model.operating_point.outputs, [2.0])
    assert np.allclose(small.back @ small.prior.mean, [2.0, 0.0])
    assert repr(small) == "Reduction(output_process: 2 to 1 state, error bound 0)"
