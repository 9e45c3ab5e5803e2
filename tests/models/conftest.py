"""Models and priors that fill every field, and how two things are compared to the last bit."""

import jax
import numpy as np
import pytest

from estimable import Prior, StateSpace


@pytest.fixture
def same():
    """Asserts that two things agree in class, in every leaf to the last bit, and in every static field."""

    def check(a, b):
        assert type(a) is type(b)
        assert jax.tree_util.tree_structure(a) == jax.tree_util.tree_structure(b)
        for left, right in zip(jax.tree_util.tree_leaves(a), jax.tree_util.tree_leaves(b), strict=True):
            assert np.shape(left) == np.shape(right)
            assert np.asarray(left).dtype == np.asarray(right).dtype
            assert np.asarray(left).tobytes() == np.asarray(right).tobytes()

    return check


def covariance(random, size):
    root = random.normal(size=(size, size + 1))
    return root @ root.T


@pytest.fixture
def full():
    """A model with every matrix, name and operating point: full(dt, n, m, p, q, seed)."""

    def build(dt=0.1, n=3, m=2, p=2, q=2, seed=1, **changed):
        random = np.random.default_rng(seed)
        joint = covariance(random, q + p)
        given = {
            "A": random.normal(size=(n, n)) / 3,
            "B": random.normal(size=(n, m)),
            "C": random.normal(size=(p, n)),
            "D": random.normal(size=(p, m)),
            "G": random.normal(size=(n, q)),
            "Q": joint[:q, :q],
            "R": joint[q:, q:],
            "S": joint[:q, q:] if dt else None,
            "dt": dt,
            "states": [f"state {i}" for i in range(n)],
            "inputs": [f"input {i}" for i in range(m)],
            "outputs": [f"output {i}" for i in range(p)],
            "operating_point": {"states": random.normal(size=n), "inputs": random.normal(size=m)},
        }
        return StateSpace(**(given | changed))

    return build


@pytest.fixture
def diffuse_prior():
    """A prior with diffuse directions: diffuse_prior(n, r, seed)."""

    def build(n=3, r=1, seed=2):
        random = np.random.default_rng(seed)
        return Prior(random.normal(size=n), covariance(random, n), diffuse=random.normal(size=(n, r)))

    return build
