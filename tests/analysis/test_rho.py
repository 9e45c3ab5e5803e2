"""Margins against perturbations: the chain of bounds, known answers, and adversaries that try to break them."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimable import AssumptionError, InputError, rho_margin, stability_radius


def stable(rng, n, dt):
    A = rng.normal(size=(n, n))
    poles = np.linalg.eigvals(A)
    if dt:
        return A * (rng.uniform(0.3, 0.95) / np.abs(poles).max())
    return A - (poles.real.max() + rng.uniform(0.1, 1)) * np.eye(n)


def tracker(dt, α=0.886553879184, β=1.41179310970):
    Φ, K = np.array([[1.0, dt], [0.0, 1.0]]), np.array([[α], [β / dt]])
    return (np.eye(2) - K @ np.array([[1.0, 0.0]])) @ Φ


@pytest.mark.parametrize("dt", [0, 1])
def test_a_normal_matrix_bears_its_distance_from_the_limit(dt):
    A = np.diag([0.5, -0.3]) if dt else -np.diag([0.5, 3.0])
    found = rho_margin(A, dt=dt)
    assert_allclose([found.margin, found.sigma, found.stability_radius], 0.5, rtol=1e-6)
    assert_allclose(stability_radius(A, dt=dt).margin, 0.5, rtol=1e-12)


@pytest.mark.parametrize("dt", [0, 1])
def test_the_chain_of_bounds_on_random_matrices(dt):
    rng = np.random.default_rng(dt)
    for _ in range(60):
        A = stable(rng, int(rng.integers(1, 6)), dt)
        found = rho_margin(A, dt=dt)
        assert found.margin <= found.sigma * (1 + 1e-9) <= found.stability_radius * (1 + 2e-9)


@pytest.mark.parametrize("dt", [0, 1])
def test_the_radius_is_the_minimum_over_a_fine_grid(dt):
    rng = np.random.default_rng(10 + dt)
    for _ in range(10):
        A = stable(rng, 4, dt)
        θ = np.linspace(0, np.pi, 20001) if dt else np.tan(np.linspace(0, np.pi / 2 - 1e-3, 20001))
        z = np.exp(1j * θ) if dt else 1j * θ
        grid = np.linalg.svd(z[:, None, None] * np.eye(4) - A, compute_uv=False)[:, -1].min()
        found = stability_radius(A, dt=dt)
        assert found.margin <= grid * (1 + 1e-12)
        assert_allclose(found.margin, grid, rtol=1e-5)


def test_the_tracker_s_margin_depends_on_the_units_of_its_state():
    assert_allclose(
        [rho_margin(tracker(0.01), dt=1).margin, rho_margin(tracker(10), dt=1).margin], [0.0018, 0.21], rtol=0.05
    )
    assert rho_margin(tracker(0.01), dt=1, scaling=[1.0, 100.0]).margin > 0.1
    assert rho_margin(tracker(0.01), dt=1, scaling="balanced").margin > 0.1


def test_a_defective_matrix_has_a_margin_though_none_at_its_spectral_radius():
    found = rho_margin([[0.5, 1.0], [0.0, 0.5]], dt=1)
    assert found.rate > 0.5
    assert 0 < found.margin < found.stability_radius


def test_what_dies_out_at_once_bears_everything_below_one():
    assert_allclose(rho_margin(np.zeros((2, 2)), dt=1).margin, 1.0)
    assert 0 < rho_margin([[0.0, 3.0], [0.0, 0.0]], dt=1).margin < 1


@pytest.mark.parametrize("share", [0.3, 0.9])
def test_no_adversary_breaks_the_bound(share):
    """At each step f and g point where the state's own next value does: the worst of their size."""
    rng = np.random.default_rng(3)
    for _ in range(15):
        A = stable(rng, 3, 1)
        found = rho_margin(A, dt=1)
        κ, δ = share * found.margin, 0.7
        bound = found.perturbed(κ, δ)
        for x in (rng.normal(size=3), np.linalg.svd(A)[2][0]):
            start = np.linalg.norm(x)
            for k in range(40):
                assert np.linalg.norm(x) <= bound.at(k, x0=start) * (1 + 1e-9)
                ahead = A @ x
                x = ahead * (1 + (κ * np.linalg.norm(x) + δ) / np.linalg.norm(ahead))


def test_no_adversary_breaks_the_bound_in_continuous_time():
    from scipy.linalg import expm

    rng = np.random.default_rng(4)
    for _ in range(15):
        A = stable(rng, 3, 0)
        found = rho_margin(A, dt=0)
        κ = 0.9 * found.margin
        bound = found.perturbed(κ)
        U, _, Vt = np.linalg.svd(expm(A * 0.7))
        t = np.linspace(0, 5, 40)
        for E in (κ * np.eye(3), κ * U @ Vt, κ * Vt.T @ U.T):
            sizes = [np.linalg.norm(expm((A + E) * s), 2) for s in t]
            assert np.all(sizes <= bound.at(t, x0=1.0) * (1 + 1e-9))


def test_the_scalar_case_of_which_the_source_s_bound_is_wrong():
    assert_allclose(rho_margin([[0.5]], dt=1).perturbed(0.4, 1.0).final, 10.0, rtol=1e-6)


def test_what_is_refused():
    with pytest.raises(AssumptionError, match=r"the largest modulus of an eigenvalue is 1\.1, not < 1"):
        rho_margin([[1.1]], dt=1)
    with pytest.raises(AssumptionError, match=r"the largest real part of an eigenvalue is 0, not < 0"):
        stability_radius([[0.0]], dt=0)
    with pytest.raises(InputError, match=r"`kappa` must be below the margin 0\.5.*Got 0\.6"):
        rho_margin([[0.5]], dt=1).perturbed(0.6)
    with pytest.raises(InputError, match="`scaling` must be sizes, greater than 0"):
        rho_margin([[0.5]], dt=1, scaling=[0.0])
    with pytest.raises(InputError, match=r"`scaling` must be .*balanced"):
        rho_margin([[0.5]], dt=1, scaling="best")
    with pytest.raises(InputError, match="`A` must be at least 1 × 1"):
        rho_margin(np.zeros((0, 0)), dt=1)
