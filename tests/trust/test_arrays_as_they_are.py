"""Arrays as people have them: covariances in float32, records on their side."""

import logging

import numpy as np
import pytest
from numpy.testing import assert_allclose

import estimable as es


@pytest.fixture
def said(caplog):
    caplog.set_level(logging.WARNING, "estimable.checks")
    return lambda: [record.getMessage() for record in caplog.records if record.name == "estimable.checks"]


def rounded(seed, n=6, rank=2):
    """A covariance of low rank, and the same in float32, which is not quite definite or symmetric."""
    M = np.random.default_rng(seed).normal(size=(n, rank))
    P = M @ M.T
    single = P.astype(np.float32)
    single[0, 1] = np.nextafter(single[0, 1], np.float32(9))
    return P, single


@pytest.mark.parametrize("seed", range(20))
def test_a_covariance_in_float32_is_taken_at_its_own_rounding(seed, said):
    P, single = rounded(seed)
    prior = es.Prior(np.zeros(6), single)
    assert_allclose(prior.covariance, P, atol=1e-6 * np.abs(P).max())
    assert np.linalg.eigvalsh(prior.covariance)[0] > -1e-14 * np.abs(P).max()
    assert said() in (
        [],
        ["`covariance` is float32, and indefinite by its rounding: eigenvalues below 0 were set to 0."],
    )
    with pytest.raises(es.InputError, match=r"must be (symmetric|positive semidefinite)"):
        es.Prior(np.zeros(6), single.astype(float))


def test_a_definite_one_is_not_touched(said):
    single = np.eye(3, dtype=np.float32) + np.float32(0.1)
    assert np.array_equal(es.Prior(np.zeros(3), single).covariance, single.astype(float))
    assert said() == []


def test_what_is_wrong_beyond_rounding_is_refused_in_float32_too():
    with pytest.raises(es.InputError, match="must be positive semidefinite"):
        es.Prior([0.0, 0.0], np.array([[1.0, 2.0], [2.0, 1.0]], np.float32))


@pytest.mark.parametrize("named", [False, True])
def test_a_record_on_its_side_gets_a_hint(named):
    names = ["a", "b"] if named else None
    model = es.StateSpace(0.9 * np.eye(2), C=np.eye(2), Q=np.eye(2), R=np.eye(2), dt=1, outputs=names)
    with pytest.raises(es.InputError, match=r"`y` of the record has 2 rows and 50 columns: did you mean `y\.T`\?"):
        es.estimate(es.Kalman(model), es.Record(np.zeros((2, 50)), dt=1), prior=es.Prior([0.0, 0.0], np.eye(2)))
