"""The α-β tracker against the Lyapunov equation, Bass's numbers, and the Kalman filter that it is for the right target."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimable import InputError, StateSpace, alpha_beta_covariance, alpha_beta_gains, kalman_gain


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


def test_critical_damping_makes_the_poles_equal():
    α, β = alpha_beta_gains("critically_damped", alpha=0.75)
    assert_allclose((2 - α - β) ** 2, 4 * (1 - α), rtol=1e-14)
    assert_allclose(alpha_beta_gains("benedict_bordner", alpha=0.5), (0.5, 1 / 6))


def test_what_is_refused():
    with pytest.raises(InputError, match=r"stable for 0 < α < 2 and 0 < β < 2 \(2 - α\) only\. Got α = 1, β = 2\."):
        alpha_beta_covariance(1, 2, dt=1, sigma_a2=1, sigma_s2=1)
    with pytest.raises(InputError, match="`index` must be given for 'kalata'"):
        alpha_beta_gains("kalata")
    with pytest.raises(InputError, match="`alpha` has no meaning for 'least_worst'"):
        alpha_beta_gains("least_worst", alpha=0.5)
