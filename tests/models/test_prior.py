"""What is believed before the first sample."""

import numpy as np
import pytest

from estimable import Prior


def test_a_prior_may_be_exact_proper_or_diffuse():
    assert Prior([1.0], [[0.0]]).covariance == 0.0
    assert Prior([1.0, 2.0], np.eye(2)).size == 2
    np.testing.assert_array_equal(Prior([0.0, 0.0], np.zeros((2, 2)), diffuse=[[0], [1]]).diffuse, [[0.0], [1.0]])


def test_no_diffuse_direction_is_a_proper_prior():
    assert Prior([0.0, 0.0], np.eye(2), diffuse=np.zeros((2, 0))).diffuse is None


@pytest.mark.parametrize("size", [1e-200, 1e-20, 1e20])
def test_diffuse_directions_are_independent_in_any_units(size):
    assert Prior([0.0, 0.0], np.eye(2), diffuse=np.diag([1.0, size])).diffuse.shape == (2, 2)


@pytest.mark.parametrize("seed", range(3))
def test_a_prior_in_another_basis_is_the_belief_about_T_x(diffuse_prior, seed):
    prior, T = diffuse_prior(seed=seed), np.random.default_rng(seed + 10).normal(size=(3, 3))
    turned = prior.in_basis(T)
    np.testing.assert_allclose(turned.mean, T @ prior.mean, rtol=1e-14)
    np.testing.assert_allclose(turned.covariance, T @ prior.covariance @ T.T, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(turned.diffuse, T @ prior.diffuse, rtol=1e-14)
    back = turned.in_basis(np.linalg.inv(T))
    np.testing.assert_allclose(back.covariance, prior.covariance, rtol=1e-10, atol=1e-10)


def test_some_of_the_states_may_be_looked_at():
    prior = Prior([1.0, 2.0], [[1.0, 0.5], [0.5, 4.0]])
    part = prior.in_basis([[0.0, 1.0]])
    assert (part.mean, part.covariance) == ([2.0], [[4.0]])


def test_a_proper_prior_stays_proper():
    assert Prior([1.0], [[1.0]]).in_basis([[2.0]]).diffuse is None
