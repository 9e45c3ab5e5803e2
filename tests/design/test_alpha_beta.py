"""The α-β tracker against the Lyapunov equation, Bass's numbers, and the Kalman filter that it is for the right target."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimable import (
    InputError,
    StateSpace,
    alpha_beta_choices,
    alpha_beta_covariance,
    alpha_beta_gains,
    alpha_beta_gamma_gains,
    kalman_gain,
)


def error_system(α, β, T):
    K, H, Φ = np.array([[α], [β / T]]), np.array([[1.0, 0.0]]), np.array([[1.0, T], [0.0, 1.0]])
    return (np.eye(2) - K @ H), K, Φ


def noise(T):
    return np.array([[T**3 / 3, T**2 / 2], [T**2 / 2, T]])


def lyapunov(α, β, T, a, s):
    J, K, Φ = error_system(α, β, T)
    Ψ, Q = J @ Φ, J @ (a * noise(T)) @ J.T + s / T * K @ K.T
    return np.linalg.solve(np.eye(4) - np.kron(Ψ, Ψ), Q.ravel()).reshape(2, 2)


def test_the_closed_form_solves_the_lyapunov_equation_over_the_whole_region():
    for α in np.linspace(0.05, 1.95, 20):
        for share in np.linspace(0.05, 0.95, 10):
            β = share * 2 * (2 - α)
            for T in (0.01, 1.0, 10.0):
                P = alpha_beta_covariance(α, β, dt=T, sigma_a2=0.7, sigma_s2=1.3)
                D = np.diag([1.0, T])  # one unit for both, in which the solve is well conditioned
                assert_allclose(D @ P @ D, D @ lyapunov(α, β, T, 0.7, 1.3) @ D, rtol=1e-10, atol=1e-12 * P[0, 0])
                J, K, Φ = error_system(α, β, T)
                again = J @ (Φ @ P @ Φ.T + 0.7 * noise(T)) @ J.T + 1.3 / T * K @ K.T
                assert_allclose(D @ again @ D, D @ P @ D, rtol=1e-12, atol=1e-12 * P[0, 0] * max(1, 1 / α))


def test_to_twelve_digits_up_to_the_edge_of_the_region():
    from mpmath import lu_solve, matrix, mp, mpf

    mp.dps = 60  # the Lyapunov equation is nearly singular at the edge
    for α in (1e-3, 0.3, 1.0, 1.7, 1.999):
        for share in (1e-4, 0.5, 0.9999):
            β, T, a, s = share * 2 * (2 - α), 0.3, 0.7, 1.3
            A, B, h = mpf(α), mpf(β), mpf(T)
            J = matrix([[1 - A, 0], [-B / h, 1]])
            Ψ = J * matrix([[1, h], [0, 1]])
            Q = J * mpf(a) * matrix([[h**3 / 3, h**2 / 2], [h**2 / 2, h]]) * J.T
            K = matrix([A, B / h])
            Q += mpf(s) / h * K * K.T
            rows = [[Ψ[i, k] * Ψ[j, m] for k in (0, 1) for m in (0, 1)] for i in (0, 1) for j in (0, 1)]
            P = lu_solve(mp.eye(4) - matrix(rows), matrix([Q[i, j] for i in (0, 1) for j in (0, 1)]))
            ours = alpha_beta_covariance(α, β, dt=T, sigma_a2=a, sigma_s2=s)
            size = np.sqrt(float(P[0]) * float(P[3]))  # of a covariance whose sign may change
            assert_allclose([ours[0, 0], ours[1, 1]], [float(P[0]), float(P[3])], rtol=1e-12)
            assert_allclose(ours[0, 1], float(P[1]), atol=1e-12 * size)


def test_the_least_worst_gains_to_the_last_digit():
    from mpmath import diff, findroot, mp, mpf

    mp.dps = 40

    def φ(α, β):
        return ((1 - α) ** 2 / α) * (3 * (2 - α) - β) / (β * (2 * (2 - α) - β))

    def ψ(α, β):
        return (2 * α**2 + (2 - 3 * α) * β) / (α * (2 * (2 - α) - β))

    root = findroot(lambda α, β: (diff(φ, (α, β), (0, 1)), ψ(α, β) - α), (mpf("0.9"), mpf("1.4")))
    assert_allclose(alpha_beta_gains("least_worst"), [float(x) for x in root], rtol=4e-16)


def test_the_least_worst_tracker_of_bass():
    α, β = alpha_beta_gains("least_worst")
    assert_allclose([α, β], [0.886553879184, 1.41179310970], rtol=1e-11)
    assert_allclose(alpha_beta_covariance(α, β, dt=1, sigma_a2=3, sigma_s2=0)[0, 0], 0.0243289, rtol=3e-6)
    assert_allclose(alpha_beta_covariance(α, β, dt=1, sigma_a2=0, sigma_s2=1)[0, 0], α, rtol=1e-13)
    J, _, Φ = error_system(α, β, 1.0)
    assert_allclose(np.abs(np.linalg.eigvals(J @ Φ)), 0.336818, atol=1e-6)
    φ = [alpha_beta_covariance(α, β + h, dt=1, sigma_a2=3, sigma_s2=0)[0, 0] for h in (-1e-3, 0, 1e-3)]
    assert φ[1] < min(φ[0], φ[2])


@pytest.mark.parametrize(
    ("ratio", "worse"), [(0.01, 2.46), (0.1, 1.62), (1, 1.18), (10, 1.054), (100, 1.72), (1e4, 82)]
)
def test_it_is_worse_than_the_kalman_filter_when_the_variances_are_right(ratio, worse):
    model = StateSpace([[1.0, 1.0], [0.0, 1.0]], C=[[1.0, 0.0]], Q=ratio * noise(1.0), R=[[1.0]], dt=1)
    optimal = kalman_gain(model)
    ours = alpha_beta_covariance(*alpha_beta_gains("least_worst"), dt=1, sigma_a2=ratio, sigma_s2=1)
    assert_allclose(ours[0, 0] / optimal.covariance[0, 0], worse, rtol=6e-3)
    best = alpha_beta_covariance(*optimal.filter[:, 0], dt=1, sigma_a2=ratio, sigma_s2=1)
    assert_allclose(best, optimal.covariance, rtol=1e-9)


def test_kalata_s_gains_are_the_kalman_filter_of_a_piecewise_constant_acceleration():
    G = np.array([[0.5], [1.0]])
    model = StateSpace([[1.0, 1.0], [0.0, 1.0]], C=[[1.0, 0.0]], G=G, Q=[[0.3**2]], R=[[1.0]], dt=1)
    assert_allclose(alpha_beta_gains("kalata", index=0.3), kalman_gain(model).filter[:, 0], rtol=1e-10)


@pytest.mark.parametrize("index", [1e-6, 0.01, 0.3, 1.0, 20.0, 1e5])
def test_kalata_s_three_gains_are_the_kalman_filter_of_an_acceleration_that_steps(index):
    model = StateSpace(
        [[1.0, 1.0, 0.5], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]], C=[[1.0, 0.0, 0.0]], G=[[0.5], [1.0], [1.0]], Q=[[index**2]],
        R=[[1.0]], dt=1,
    )  # fmt: skip
    α, β, γ = alpha_beta_gamma_gains("kalata", index=index)
    assert_allclose([α, β, γ], kalman_gain(model).filter[:, 0], rtol=1e-10)
    assert_allclose([β, γ], [2 * (2 - α) - 4 * np.sqrt(1 - α), β**2 / (2 * α)], rtol=1e-7)


def test_the_usual_choices_side_by_side():
    table = alpha_beta_choices(dt=0.5, sigma_a2=2.0, sigma_s2=0.3)
    assert table.names == ("kalman", "kalata", "benedict_bordner", "critically_damped", "least_worst")
    T = np.diag([1.0, 0.5])
    model = StateSpace([[1.0, 0.5], [0.0, 1.0]], C=[[1.0, 0.0]], Q=2.0 * noise(0.5), R=[[0.6]], dt=0.5)
    assert_allclose([table.alpha[0], table.beta[0]], (T @ kalman_gain(model).filter)[:, 0], rtol=1e-9)
    assert_allclose(table.covariance[0], kalman_gain(model).covariance, rtol=1e-9)
    assert np.all(table.price >= 1 - 1e-12)
    assert_allclose(table.price[1:, 0].min(), 1, atol=1e-2)
    for row, family in ((2, "benedict_bordner"), (3, "critically_damped")):
        near = [alpha_beta_gains(family, alpha=table.alpha[row] + h) for h in (-1e-3, 1e-3)]
        others = [alpha_beta_covariance(*gains, dt=0.5, sigma_a2=2.0, sigma_s2=0.3)[0, 0] for gains in near]
        assert table.covariance[row, 0, 0] < min(others)
    J, _, Φ = error_system(table.alpha[3], table.beta[3], 0.5)
    assert_allclose(table.radius[3], np.abs(np.linalg.eigvals(J @ Φ)).max(), rtol=1e-6)
    assert list(table.to_pandas().index) == list(table.names)


def test_three_gains_with_all_poles_equal():
    α, β, γ = alpha_beta_gamma_gains("critically_damped", alpha=1 - 0.6**3)
    Φ = np.array([[1.0, 1.0, 0.5], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]])
    error = Φ - np.outer([α, β, γ], Φ[0])
    assert_allclose(np.linalg.matrix_power(error - 0.6 * np.eye(3), 3), 0, atol=1e-14)  # Cayley and Hamilton


def test_critical_damping_makes_the_poles_equal():
    α, β = alpha_beta_gains("critically_damped", alpha=0.75)
    assert_allclose((2 - α - β) ** 2, 4 * (1 - α), rtol=1e-14)
    assert_allclose(alpha_beta_gains("benedict_bordner", alpha=0.5), (0.5, 1 / 6))


def test_what_is_refused():
    with pytest.raises(InputError, match=r"stable for 0 < α < 2 and 0 < β < 2 \(2 - α\) only\. Got α = 1, β = 2\."):
        alpha_beta_covariance(1, 2, dt=1, sigma_a2=1, sigma_s2=1)
    with pytest.raises(InputError, match="`index` must be given for 'kalata'"):
        alpha_beta_gains("kalata")
    with pytest.raises(InputError, match="`alpha` is not used by 'least_worst'"):
        alpha_beta_gains("least_worst", alpha=0.5)
    with pytest.raises(InputError, match="`choice` must be one of 'kalata', 'critically_damped'"):
        alpha_beta_gamma_gains("least_worst")
    with pytest.raises(InputError, match=r"`sigma_a2` must be greater than 0\. Got 0\."):
        alpha_beta_choices(dt=1, sigma_a2=0, sigma_s2=1)
