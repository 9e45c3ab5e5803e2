"""Elements that compose, against the textbook recursion with 60 digits."""

import numpy as np
import pytest

from estimable.kernels import canonical_correlations as correlations
from estimable.kernels import noise_free
from estimable.kernels import square_root_elements as el
from estimable.kernels.growth_frame import growth_frame
from estimable.kernels.step_factors import noise_factors, of_short_time, sources_of_short_time
from estimable.kernels.undetectable import undetectable
from oracles.many_digits import after, canonical, over_time, sigma

KINDS = ("stable", "growing", "delays", "integrators", "marginal")


def drawn(seed):
    """A, g, C and V of a model of each kind."""
    rng = np.random.default_rng(seed)
    n, p = int(rng.integers(1, 6)), int(rng.integers(1, 3))
    A, C, g = rng.normal(size=(n, n)), rng.normal(size=(p, n)), rng.normal(size=(n, int(rng.integers(1, n + 1))))
    A /= np.abs(np.linalg.eigvals(A)).max()
    match KINDS[seed % len(KINDS)]:
        case "stable":
            A *= 0.9
        case "growing":
            A *= rng.uniform(1.1, 2.0)
        case "delays":
            A, g, C = np.eye(n, k=-1), np.eye(n)[:, :1], np.eye(n)[-1:]
            A[0, 0] = 0.5
        case "integrators":
            A, g, C = np.eye(n) + 0.1 * np.eye(n, k=1), 0.01 * np.eye(n)[:, -1:], np.eye(n)[:1]
    return A, g, C, 0.1 * np.eye(len(C))


def spread_of(belief):
    return el.lengths(el.state_error(belief).F)


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("size", [0.0, 1.0, 1e7])
def test_doubled_and_sequential_elements_are_the_filter_of_sixty_digits(seed, size):
    A, g, C, V = drawn(seed)
    n, L, none = len(A), size * np.eye(len(A)), np.zeros((len(A), 0))
    L = L if size else none
    step, first = el.of_step(A, g, C, V), el.of_sample(C, V)
    start = el.then(el.of_prior(L, none), first)
    sequential, doubled = start, step
    for _ in range(16):
        sequential = el.then(sequential, step)
    for _ in range(4):
        doubled = el.then(doubled, doubled)
    *_, (P, _) = after(A, g @ g.T, C, V @ V.T, size**2 * np.eye(n), 17)
    exact = sigma(P)
    assert np.allclose(spread_of(sequential), exact, rtol=1e-11, atol=0)
    assert np.allclose(spread_of(el.then(start, doubled)), exact, rtol=1e-11, atol=0)


@pytest.mark.parametrize("seed", range(5))
def test_the_shares_of_the_sources_add_up_and_are_derivatives(seed):
    A, g, C, V = drawn(seed)
    n, none = len(A), np.zeros((len(A), 0))

    def found(scales):
        """Variances of the states, and the shares, with the variance of each source multiplied."""
        gs, Vs = [scales[0] ** 0.5 * g], [scales[1] ** 0.5 * V]
        step, parts = el.of_step(A, gs[0], C, Vs[0]), [*el.sources_of_step(gs, C, Vs), nothing(n, len(C))]
        first, of_first = el.of_sample(C, Vs[0]), [*el.sources_of_step([none], C, Vs), nothing(n, len(C))]
        belief = el.of_prior(scales[2] ** 0.5 * 2.0 * np.eye(n), none)
        own = [nothing(n, n), nothing(n, n), el.Source(np.zeros((n, n)), np.eye(n))]
        belief, own = el.sources_then(belief, own, first, of_first)
        for E in (el.sources_then(step, parts, step, parts), (step, parts)):
            belief, own = el.sources_then(belief, own, *E)
        F, _, inverse = el.state_error(belief)
        return el.lengths(F) ** 2, np.array([el.share(belief, part, inverse, np.eye(n)) for part in own])

    variance, shares = found(np.ones(3))
    assert np.allclose(shares.sum(axis=0), variance, rtol=1e-12)
    for i in range(3):
        up, down = (found(np.where(np.arange(3) == i, 1 + h, 1.0))[0] for h in (1e-4, -1e-4))
        assert np.allclose((up - down) / 2e-4, shares[i], rtol=1e-6, atol=1e-8 * variance)


def nothing(n, z):
    return el.Source(np.zeros((n, 0)), np.zeros((z, 0)))


def test_a_diffuse_direction_is_infinite_until_it_is_seen():
    A, C = np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([[1.0, 0.0]])
    belief = el.then(el.of_prior(np.zeros((2, 0)), np.eye(2)), el.of_sample(C, np.array([[0.1]])))
    F, N, _ = el.state_error(belief)
    assert np.allclose(N / N[1], [[0.0], [1.0]])
    assert np.allclose(F @ F.T, [[0.01, 0.0], [0.0, 0.0]])
    belief = el.then(belief, el.of_step(A, np.zeros((2, 0)), C, np.array([[0.1]])))
    F, N, _ = el.state_error(belief)
    assert N.shape == (2, 0)
    assert np.allclose(F @ F.T, [[0.01, 0.01], [0.01, 0.02]], rtol=1e-14)


def test_channels_without_noise_leave_exact_zeros_and_repetitions_change_nothing():
    A, g, C = np.array([[1.0, 0.1], [0.0, 0.9]]), np.array([[0.0], [0.3]]), np.array([[1.0, 0.0]])
    belief = noise_free.corrected(noise_free.of_known_prior(np.eye(2), np.zeros((2, 0))), C, np.zeros((1, 1)))
    twice = noise_free.corrected(
        noise_free.of_known_prior(np.eye(2), np.zeros((2, 0))), np.vstack([C, C]), np.zeros((2, 2))
    )
    for _ in range(12):
        belief = noise_free.corrected(noise_free.moved(belief, A, g), C, np.zeros((1, 1)))
        twice = noise_free.corrected(noise_free.moved(twice, A, g), np.vstack([C, C]), np.zeros((2, 2)))
    position, speed = spread_of(belief)
    assert position < 1e-15
    assert speed == pytest.approx(0.3, rel=1e-12)  # one step of noise, which the next position shows
    assert np.allclose(spread_of(twice), [0.0, 0.3], rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("seconds", [0.01, 1.0])
def test_continuous_steps_have_no_limit_of_stiffness(seconds):
    A = np.diag([-1e-3, -0.1, -10.0, -1e3]) + np.diag([0.01, 1.0, 50.0], k=1)
    Q, J = np.diag([0.0, 0.0, 0.0, 1.0]), np.diag([100.0, 0.0, 0.0, 0.0])
    doublings = 14
    E, h = of_short_time(A, Q, J, seconds / 2**doublings), seconds / 2**doublings
    fine, parts = sources_of_short_time(A, [np.eye(4)[:, 3:]], np.eye(4)[:1], [np.array([[0.1]])], h)
    for _ in range(doublings):
        E, (fine, parts) = el.then(E, E), el.sources_then(fine, parts, fine, parts)
    prior = el.of_prior(np.eye(4), np.zeros((4, 0)))
    exact = over_time(A, Q, J, np.eye(4), seconds)
    assert np.allclose(spread_of(el.then(prior, E)), exact, rtol=1e-11)
    own = [nothing(4, 4), nothing(4, 4), el.Source(np.zeros((4, 4)), np.eye(4))]
    belief, own = el.sources_then(prior, own, fine, [*parts, nothing(4, len(fine.Z))])
    _, _, inverse = el.state_error(belief)
    shares = sum(el.share(belief, part, inverse, np.eye(4)) for part in own)
    assert np.allclose(shares, exact**2, rtol=1e-5)


def test_the_noise_of_a_step_is_a_factor_for_fast_and_slow_modes():
    A = np.array([[-100.0, 1.0], [0.0, -1e-3]])
    Φ, (half,) = noise_factors(A, [np.eye(2)], 1.0)
    X = np.array([[1 / 200, 1 / (100.001) / (2e-3)], [0, 0]])  # of the second state: (1 - e^-2at) / 2a
    assert (half @ half.T)[1, 1] == pytest.approx(-np.expm1(-2e-3) / 2e-3, rel=1e-13)
    assert Φ[1, 1] == pytest.approx(np.exp(-1e-3), rel=1e-13)
    assert np.linalg.eigvalsh(half @ half.T).min() > 0
    assert X[0, 0] < (half @ half.T)[0, 0]


M, m, length, gravity = 1.0, 0.1, 0.5, 9.81
CART = np.array([
    [0, 1, 0, 0], [0, -0.1, -m * gravity / M, 0], [0, 0, 0, 1], [0, 0.1 / length, (M + m) * gravity / (M * length), 0],
])  # fmt: skip


@pytest.mark.parametrize("samples", [25, 300])
def test_correlations_of_a_pendulum_that_grows_to_any_size(samples):
    """Condition of Π from 8e5 to 1e25; both ρ² and 1 - ρ² to all digits but three."""
    C, V = np.array([[1.0, 0, 0, 0]]), np.array([[np.sqrt(0.005)]])
    Φ, (g,) = noise_factors(CART, [np.array([[0], [0.1], [0], [-0.2]])], 0.02)
    Q, T = growth_frame(Φ)
    assert np.allclose(Q @ T @ Q.T, Φ, atol=1e-14)
    assert np.all(np.diff(np.abs(np.diagonal(T))) <= 0)
    empty = np.zeros((4, 0))
    moments = correlations.StateFactors(empty, empty, empty)
    for k in range(samples):
        moments = correlations.moved(moments, T, Q.T @ g) if k else moments
        moments = correlations.corrected(moments, C @ Q, V)
    *_, last = after(Φ, g @ g.T, C, V @ V.T, np.zeros((4, 4)), samples, dps=90)
    squared, left = canonical(*last)
    found = correlations.pairs(moments)
    assert found.known.shape == (4, 0)
    assert np.allclose(np.sort(found.squared), squared, rtol=3e-12, atol=0)
    assert np.allclose(np.sort(found.left), left, rtol=3e-12, atol=0)


def test_the_growth_frame_orders_pairs_and_single_values():
    rng = np.random.default_rng(0)
    for n in range(1, 9):
        A = rng.normal(size=(n, n))
        Q, T = growth_frame(A)
        assert np.allclose(Q @ T @ Q.T, A)
        sizes = [np.abs(np.linalg.eigvals(T[:k, :k])).min() for k in range(1, n + 1) if k == n or T[k, k - 1] == 0]
        assert np.all(np.diff(sizes) < 1e-9)


@pytest.mark.parametrize("units", [1.0, 1e6, 1e-6])
def test_what_is_never_shown_is_split_off(units):
    """A position and a speed seen by the speed, next to a state that decays unseen."""
    A, C = np.array([[1.0, 0.1, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.5]]), np.array([[0.0, units, 0.0]])
    assert np.allclose(undetectable(A, C, continuous=False), [[1.0], [0.0], [0.0]])
    assert undetectable(A, np.array([[units, 0.0, 0.0]]), continuous=False).shape == (3, 0)
