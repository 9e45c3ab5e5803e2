"""A recursion that converges ends in one matrix."""

import jax
import jax.numpy as jnp
import numpy as np
from numpy.testing import assert_allclose

from estimable.kernels.small import factors, settled, traced_factors, triangularise

F, W = np.array([[0.9, 0.3], [-0.2, 0.7]]), np.array([[0.5, 0.0], [0.1, 0.3]])


def step(L):
    return triangularise(jnp.concatenate([F @ L, W], axis=1))


def test_a_recursion_settles_to_the_last_bit_and_within_rounding_of_its_limit():
    L, states = jnp.eye(2), []
    for _ in range(400):
        L = settled(step(L), L)
        states.append(np.asarray(L))
    assert np.array_equal(states[-1], states[-60])
    limit = W @ W.T
    for _ in range(400):
        limit = F @ limit @ F.T + W @ W.T
    assert_allclose(states[-1] @ states[-1].T, limit, rtol=1e-14)


def test_what_moves_by_more_than_rounding_moves():
    L = np.array([[1.0, 0.0], [1e6, 1.0]])
    moved = L + np.array([[1e-14, 0.0], [0.0, 0.0]])
    assert np.array_equal(settled(moved, L), moved)
    assert np.array_equal(settled(L * (1 + 2e-16), L), L)


def test_derivatives_are_those_of_what_was_computed():
    start = np.array([[1.0, 0.0], [0.5, 2.0]])
    slope = jax.grad(lambda scale: jnp.sum(settled(scale * start, start)))(1.0)
    assert_allclose(slope, start.sum())


def test_factors_of_known_matrices_are_those_of_traced_ones():
    Z = np.random.default_rng(0).normal(size=(2, 3, 4, 4))
    P = Z @ Z.mT
    P[0, 0], P[1, 2, 1], P[1, 2, :, 1] = 0, 0, 0  # nothing is uncertain, and one of four is not
    L = factors(P)
    assert_allclose(L, traced_factors(P), rtol=1e-13, atol=1e-12)  # a pivot of .003 amplifies rounding
    assert_allclose(L @ L.mT, P, atol=1e-13)
    assert_allclose(jax.jit(factors)(P), L, rtol=1e-13, atol=1e-12)
    assert np.array_equal(factors(np.ones((2, 2))), [[1, 0], [1, 0]])  # of rank one
