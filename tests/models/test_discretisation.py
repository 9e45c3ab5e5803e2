"""Continuous to discrete time against the integrals that define it, by quadrature."""

from math import factorial

import numpy as np
import pytest
from scipy.integrate import quad_vec
from scipy.linalg import expm

from estimable import StateSpace

HOLDS = ("zero_order", "first_order")


def by_quadrature(model, h, hold):
    """Phi, B, B_end and Q by quadrature of x(h) = e^{Ah} x + int_0^h e^{A(h-s)} (B u(s) + G w(s)) ds."""
    A, B, noise, m = model.A, model.B, model.G @ model.Q @ model.G.T, model.m

    def integrand(s):
        Φ = expm(A * (h - s))
        return np.hstack([Φ @ B, Φ @ B * s / h, Φ @ noise @ Φ.T])

    integral, error = quad_vec(integrand, 0.0, h, epsabs=1e-13, epsrel=1e-12, norm="max")
    assert error <= 1e-11 * np.abs(integral).max()
    B_all, B_end, Q = integral[:, :m], integral[:, m : 2 * m], integral[:, 2 * m :]
    if hold == "zero_order":
        return expm(A * h), B_all, None, Q
    return expm(A * h), B_all - B_end, B_end, Q


def continuous(seed, n=3):
    random = np.random.default_rng(seed)
    A = random.normal(size=(n, n))
    if seed == 0:
        A[:, -1] = 0.0  # an integrator: A is singular
    root = random.normal(size=(2, 2))
    return StateSpace(A, random.normal(size=(n, 2)), G=random.normal(size=(n, 2)), Q=root @ root.T, R=np.eye(n), dt=0)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("h", [0.01, 1.0, 3.0])
@pytest.mark.parametrize("hold", HOLDS)
def test_agrees_with_the_integrals_that_define_it(seed, h, hold):
    model = continuous(seed)
    discrete = model.discretise(h, hold=hold)
    Φ, B, B_end, Q = by_quadrature(model, h, hold)
    for found, exact in ((discrete.A, Φ), (discrete.B, B), (discrete.G @ discrete.Q @ discrete.G.T, Q)):
        np.testing.assert_allclose(found, exact, rtol=1e-10, atol=1e-11 * np.abs(exact).max())
    if B_end is None:
        assert discrete.B_end is None
    else:
        np.testing.assert_allclose(discrete.B_end, B_end, rtol=1e-10, atol=1e-11 * np.abs(B_end).max())


@pytest.mark.parametrize("h", [1e-6, 1e-3, 0.5, 1e3])
def test_the_double_integrator_in_closed_form(h):
    model = StateSpace([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], G=[[0.0], [1.0]], Q=[[3.0]], dt=0)
    zero, first = model.discretise(h), model.discretise(h, hold="first_order")
    np.testing.assert_allclose(zero.A, [[1.0, h], [0.0, 1.0]], rtol=1e-14)
    np.testing.assert_allclose(zero.B, [[h**2 / 2], [h]], rtol=1e-14)
    np.testing.assert_allclose(first.B, [[h**2 / 3], [h / 2]], rtol=1e-13)
    np.testing.assert_allclose(first.B_end, [[h**2 / 6], [h / 2]], rtol=1e-13)
    Q = 3.0 * np.array([[h**3 / 3, h**2 / 2], [h**2 / 2, h]])
    np.testing.assert_allclose(zero.G @ zero.Q @ zero.G.T, Q, rtol=1e-13)
    np.testing.assert_array_equal(zero.Q, first.Q)


@pytest.mark.parametrize(("a", "h"), [(-1e4, 1.0), (-1e-9, 1e-3), (-1.0, 1e-9), (-50.0, 100.0), (2.0, 3.0)])
def test_one_state_in_closed_form_however_fast(a, h):
    model = StateSpace([[a]], [[2.0]], Q=[[3.0]], dt=0)
    zero, first = model.discretise(h), model.discretise(h, hold="first_order")
    gained = np.expm1(a * h) / a
    np.testing.assert_allclose(zero.A, [[np.exp(a * h)]], rtol=1e-12, atol=1e-300)
    np.testing.assert_allclose(zero.B, [[2.0 * gained]], rtol=1e-12)
    np.testing.assert_allclose(zero.Q, [[3.0 * np.expm1(2 * a * h) / (2 * a)]], rtol=1e-12)
    np.testing.assert_allclose(first.B + first.B_end, zero.B, rtol=1e-12)
    if abs(a * h) > 1e-3:  # below, the closed form of the ramp is rounding
        np.testing.assert_allclose(first.B_end, [[2.0 * (gained - h) / (a * h)]], rtol=1e-10)
    else:
        np.testing.assert_allclose(first.B_end, [[h]], rtol=1e-3)


def test_a_stiff_stable_model_over_a_long_step_reaches_its_steady_state():
    A = np.array([[-1e4, 1.0], [0.0, -0.1]])
    discrete = StateSpace(A, np.eye(2), Q=np.eye(2), dt=0).discretise(1e3)
    P = discrete.G @ discrete.Q @ discrete.G.T
    assert np.all(np.isfinite(P))
    np.testing.assert_allclose(A @ P + P @ A.T, -np.eye(2), atol=1e-10)
    np.testing.assert_allclose(discrete.B, -np.linalg.inv(A), rtol=1e-10, atol=1e-18)
    assert np.abs(discrete.A).max() < 1e-40


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("hold", HOLDS)
def test_two_steps_are_one_of_twice_the_length(seed, hold):
    model, h = continuous(seed), 0.3
    once, twice = model.discretise(2 * h, hold=hold), model.discretise(h, hold=hold)
    noise = twice.G @ twice.Q @ twice.G.T
    close = {"rtol": 1e-12, "atol": 1e-12}
    np.testing.assert_allclose(once.A, twice.A @ twice.A, **close)
    np.testing.assert_allclose(once.G @ once.Q @ once.G.T, noise + twice.A @ noise @ twice.A.T, **close)
    start, end = np.array([1.0, -2.0]), np.array([0.5, 3.0])
    if hold == "zero_order":
        np.testing.assert_allclose(once.B @ start, twice.A @ twice.B @ start + twice.B @ start, **close)
    else:
        middle = (start + end) / 2
        first = twice.B @ start + twice.B_end @ middle
        second = twice.A @ first + twice.B @ middle + twice.B_end @ end
        np.testing.assert_allclose(once.B @ start + once.B_end @ end, second, **close)


def test_steps_of_several_lengths_are_discretised_each_on_its_own():
    model, steps = continuous(1), np.array([0.1, 0.5, 0.1, 2.0])
    varying = model.discretise(steps)
    assert varying.steps == 4
    assert varying.dt == np.mean(steps)
    for k, h in enumerate(steps):
        alone = model.discretise(h)
        np.testing.assert_allclose(varying.A[k], alone.A, rtol=1e-14, atol=1e-14)
        np.testing.assert_allclose(varying.B[k], alone.B, rtol=1e-14, atol=1e-14)
        np.testing.assert_allclose(varying.Q[k], alone.G @ alone.Q @ alone.G.T, rtol=1e-12, atol=1e-13)


def test_a_model_over_time_is_discretised_row_by_row():
    A = np.random.default_rng(3).normal(size=(3, 2, 2))
    varying = StateSpace(A, [[1.0], [0.0]], Q=np.eye(2), dt=0).discretise(0.2)
    for k in range(3):
        alone = StateSpace(A[k], [[1.0], [0.0]], Q=np.eye(2), dt=0).discretise(0.2)
        np.testing.assert_allclose(varying.A[k], alone.A, rtol=1e-14)
        np.testing.assert_allclose(varying.Q[k], alone.Q, rtol=1e-13)


def test_what_discretisation_does_not_change_stays(full):
    model = full(dt=0.0)
    discrete = model.discretise(0.1)
    for name in ("C", "D", "R"):
        np.testing.assert_array_equal(getattr(discrete, name), getattr(model, name))
    assert (discrete.states, discrete.inputs, discrete.outputs) == (model.states, model.inputs, model.outputs)
    np.testing.assert_array_equal(discrete.operating_point.outputs, model.operating_point.outputs)
    assert discrete.dt == 0.1


def chain(n, h):
    """n integrators in a row, driven at the last one: discretised, and Q, B and B_end in closed form."""
    A, last = np.diag(np.ones(n - 1), 1), np.eye(n)[:, n - 1 :]
    discrete = StateSpace(A, last, G=last, Q=[[1.0]], dt=0).discretise(h, hold="first_order")
    k = range(n - 1, -1, -1)
    Q = [[h ** (a + b + 1) / ((a + b + 1) * factorial(a) * factorial(b)) for b in k] for a in k]
    B_end = [[h ** (a + 1) / factorial(a + 2)] for a in k]
    B = [[h ** (a + 1) / factorial(a + 1) - h ** (a + 1) / factorial(a + 2)] for a in k]
    return discrete, np.array(Q), np.array(B), np.array(B_end)


@pytest.mark.parametrize(
    ("n", "h"),
    [(2, 1e-4), (3, 1e-4), (3, 1.0), (4, 0.1), (4, 1e-3), (6, 1e-2)],
)
def test_every_entry_of_a_chain_of_integrators_is_accurate(n, h):
    discrete, Q, B, B_end = chain(n, h)
    np.testing.assert_allclose(discrete.Q, Q, rtol=1e-12)
    np.testing.assert_allclose(discrete.B, B, rtol=1e-12)
    np.testing.assert_allclose(discrete.B_end, B_end, rtol=1e-12)


@pytest.mark.parametrize(("n", "h"), [(3, 1e-3), (4, 1e-3)])
def test_the_noise_of_a_chain_of_integrators_is_positive_definite_in_its_own_units(n, h):
    discrete, exact, _, _ = chain(n, h)
    Q = discrete.G @ discrete.Q @ discrete.G.T
    np.testing.assert_array_equal(Q, Q.T)
    scale = np.sqrt(np.diagonal(exact))
    smallest = np.linalg.eigvalsh(exact / np.outer(scale, scale)).min()
    assert np.linalg.eigvalsh(Q / np.outer(scale, scale)).min() > smallest / 2


@pytest.mark.parametrize("scale", [1e-9, 1e-3, 1e6, 1e12])
@pytest.mark.parametrize("hold", HOLDS)
def test_the_unit_of_time_changes_no_digit(scale, hold):
    model = continuous(1)
    slow = StateSpace(model.A / scale, model.B / scale, G=model.G, Q=model.Q / scale, R=np.eye(3), dt=0)
    reference, found = model.discretise(0.1, hold=hold), slow.discretise(0.1 * scale, hold=hold)
    for name in ("A", "B", "B_end", "Q"):
        if getattr(reference, name) is not None:
            np.testing.assert_allclose(getattr(found, name), getattr(reference, name), rtol=1e-12, atol=0)


@pytest.mark.parametrize("units", [[1e-9, 1.0, 1e6], [1e8, 1e-8, 1.0]])
def test_the_units_of_the_states_change_no_digit(units):
    model, T = continuous(1), np.array(units)
    turned = StateSpace(
        T[:, None] * model.A / T, T[:, None] * model.B, G=T[:, None] * model.G, Q=model.Q, R=np.eye(3), dt=0
    )
    reference, found = model.discretise(3.0), turned.discretise(3.0)
    np.testing.assert_allclose(found.A * T / T[:, None], reference.A, rtol=1e-12)
    sd = np.sqrt(np.diag(reference.Q))
    np.testing.assert_allclose(found.Q / np.outer(sd * T, sd * T), reference.Q / np.outer(sd, sd), atol=1e-13)


def test_a_large_entry_that_couples_nothing_back_costs_no_digit():
    model = StateSpace([[-1.0, 1e12], [0.0, -2.0]], Q=np.zeros((2, 2)), dt=0)
    exact = [[np.exp(-1.0), 1e12 * (np.exp(-1.0) - np.exp(-2.0))], [0.0, np.exp(-2.0)]]
    np.testing.assert_allclose(model.discretise(1.0).A, exact, rtol=1e-13)
