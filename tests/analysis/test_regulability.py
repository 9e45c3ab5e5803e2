"""Regulability: duality with estimability, and costs computed without it."""

import numpy as np
import pytest

from cases import case, covariance
from estimable import Prior, StateSpace, estimability, lqr_gain, regulability


def problem(seed, n=3, m=2, *, varying=0):
    rng = np.random.default_rng(seed)
    lead = (varying,) if varying else ()
    A, B = rng.normal(size=(*lead, n, n)), rng.normal(size=(*lead, n, m))
    A = A * (0.9 / np.abs(np.linalg.eigvals(A)).max(-1))[..., None, None]
    return A, B, covariance(rng, n), covariance(rng, m), covariance(rng, n)


def quadratic_costs(A, B, L, M, terminal, steps):
    """The cost of x0 with no input, and the least cost: one least-squares problem over all inputs at once."""
    n, m = B.shape[-2:]

    def at(X, k):
        return X if X.ndim == 2 else X[k]

    x = np.hstack([np.eye(n), np.zeros((n, steps * m))])
    H = np.zeros((n + steps * m, n + steps * m))
    for k in range(steps):
        H += x.T @ at(L, k) @ x
        u = slice(n + k * m, n + (k + 1) * m)
        H[u, u] += at(M, k)
        x = at(A, k) @ x
        x[:, u] += at(B, k)
    H += x.T @ terminal @ x
    least = H[:n, :n] - H[:n, n:] @ np.linalg.solve(H[n:, n:], H[n:, :n])
    return H[:n, :n], least


@pytest.mark.parametrize("varying", [0, 7])
def test_costs_are_those_of_all_inputs_at_once(varying):
    A, B, L, M, terminal = problem(1, varying=varying)
    found = regulability(StateSpace(A, B, dt=1), L, M, horizon=7, terminal=terminal)
    idle, least = quadratic_costs(A, B, L, M, terminal, 7)
    assert np.allclose(found.prior_covariance, idle, rtol=1e-10)
    assert np.allclose(found.covariance, least, rtol=1e-10)
    assert found.regulable


@pytest.mark.parametrize("horizon", [None, 5])
def test_duality(horizon):
    """Transposed, with L for Q and M for R, estimability is regulability."""
    A, B, L, M, terminal = problem(2)
    found = regulability(StateSpace(A, B, dt=1), L, M, horizon=horizon, terminal=None if horizon is None else terminal)
    prior = None if horizon is None else Prior(np.zeros(3), terminal)
    dual = estimability(StateSpace(A.T, C=B.T, Q=L, R=M, dt=1), horizon=horizon, prior=prior)
    for field in ("singular_values", "squared_correlations", "variance_reduction", "covariance", "prior_covariance"):
        assert np.allclose(getattr(found, field), getattr(dual, field), rtol=1e-12), field
    assert found.distance == dual.distance


def test_the_gramian_of_theorem_3_1_for_a_model_that_varies():
    steps = 6
    A, B, L, M, terminal = problem(3, varying=steps)
    Ψ, columns = terminal, []
    for k in range(steps - 1, -1, -1):
        Φ = np.linalg.multi_dot([*A[k::-1], np.eye(3)]) if k else A[0]
        columns.append(Φ.T @ Ψ @ B[k])  # Φ(k+1, 0)' Ψ[k] G[k]
        Ψ = A[k].T @ Ψ @ A[k] + L
    found = regulability(StateSpace(A, B, dt=1), L, M, terminal=terminal)
    assert np.allclose(found.singular_values, np.linalg.svd(np.hstack(columns), compute_uv=False), rtol=1e-10)


def test_steady_state_is_the_regulator():
    A, B, L, M, _ = problem(4)
    found = regulability(StateSpace(A, B, dt=1), L, M)
    assert np.allclose(found.covariance, lqr_gain(StateSpace(A, B, dt=1), L, M).cost, rtol=1e-10)
    S = found.prior_covariance @ B
    blocks = [np.linalg.matrix_power(A.T, k) @ S for k in (1, 2, 3)]
    assert np.allclose(found.singular_values, np.linalg.svd(np.hstack(blocks), compute_uv=False), rtol=1e-10)


def test_without_a_terminal_weight_an_unstable_model_ends_with_that_of_the_way():
    A, B, L, M, _ = problem(6)
    model = StateSpace(2 * A, B, dt=1)
    found, given = regulability(model, L, M, horizon=5), regulability(model, L, M, horizon=5, terminal=L)
    assert np.array_equal(found.covariance, given.covariance)
    stable = StateSpace(A, B, dt=1)
    assert np.allclose(
        regulability(stable, L, M, horizon=5).prior_covariance, regulability(stable, L, M).prior_covariance
    )


def test_continuous_time():
    A = case(2, (4, 1, 3)).model.A - 1.2 * np.eye(4)
    B, L, M = np.eye(4)[:, :1], np.eye(4), np.eye(1)
    model = StateSpace(A, B, dt=0)
    found, long = regulability(model, L, M), regulability(model, L, M, horizon=40.0)
    assert np.allclose(found.covariance, lqr_gain(model, L, M).cost, rtol=1e-10)
    assert np.allclose(long.covariance, found.covariance, rtol=1e-7)
    assert found.regulable


def test_a_state_that_is_gone_before_control_can_act():
    """F = 0, G = L = M = 1: (F', S) is reachable, and yet nothing can be gained."""
    found = regulability(StateSpace([[0.0]], [[1.0]], dt=1, states=["level"], inputs=["pump"]), [[1.0]], [[1.0]])
    assert (found.regulable, found.filter_verdict) == (False, "yes")
    assert found.sentences == ("From x0 along level, pump cannot lower the cost.",)


def test_an_unregulable_start_costs_the_same_with_control():
    A, B, L, M, terminal = problem(5)
    A[2], A[:, 2], B[2], L[2], L[:, 2] = 0, 0, 0, 0, 0
    A[2, 2], L[2, 2] = 0.5, 1.0  # a state apart, that no input reaches
    found = regulability(StateSpace(A, B, dt=1), L, M)
    assert np.allclose(found.directions, [[0, 0, 1]], atol=1e-12)
    x0 = found.directions[0]
    assert x0 @ found.covariance @ x0 == pytest.approx(x0 @ found.prior_covariance @ x0, rel=1e-12)
    L[2, 2] = 0
    free = regulability(StateSpace(A, B, dt=1), L, M)
    assert free.sentences == ("x3 costs nothing to begin with.",)
    assert terminal.shape == (3, 3)
