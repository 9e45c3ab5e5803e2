"""Variances near the ends of double precision give the right answer, or are refused; never a small sigma about nothing."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import estimable as es

ONE = {"A": [[0.9]], "C": [[1.0]], "Q": [[0.1]], "R": [[1.0]], "dt": 1}
TWO = {"A": [[1.0, 0.1], [0.0, 1.0]], "C": [[1.0, 0.0]], "Q": 0.01 * np.eye(2), "R": [[1.0]], "dt": 1}
RECORD = es.Record([1.0, 1.1, 0.9], dt=1)
LARGEST = float(np.finfo(float).max)


@pytest.mark.parametrize("name", ["Q", "R", "covariance"])
@pytest.mark.parametrize("size", [1.1e150, 1e300, LARGEST])
def test_variances_whose_squares_overflow_are_refused(name, size):
    with pytest.raises(es.InputError, match=rf"`{name}` must have entries of at most 1e\+150"):
        es.Prior([0.0], [[size]]) if name == "covariance" else es.StateSpace(**{**ONE, name: [[size]]})


@pytest.mark.parametrize("model", [ONE, TWO], ids=["one state", "two states"])
@pytest.mark.parametrize("engine", ["xla", "native"])
def test_a_wide_prior_is_as_good_as_a_diffuse_one_or_refused(model, engine):
    model = es.StateSpace(**model)
    n, algorithm = model.n, es.Kalman(model)
    exact = es.estimate(
        algorithm, RECORD, prior=es.Prior(np.zeros(n), np.zeros((n, n)), diffuse=np.eye(n)), engine=engine
    )
    refused = []
    for power in range(8, 150):
        prior = es.Prior(np.zeros(n), 10.0**power * np.eye(n))
        try:
            wide = es.estimate(algorithm, RECORD, prior=prior, engine=engine)
        except es.InputError:
            refused.append(power)
            continue
        assert_allclose(wide.mean[-1], exact.mean[-1], rtol=1e-4)
        assert_allclose(wide.covariance[-1], exact.covariance[-1], rtol=1e-4)
    assert refused == list(range(refused[0], 150))
    assert refused[0] in (28, 29)


def test_the_sentence_says_how_much_is_too_much():
    with pytest.raises(es.InputError) as raised:
        es.online(es.Kalman(es.StateSpace(**ONE)), prior=es.Prior([0.0], [[1e40]]))
    assert str(raised.value) == (
        "`prior` is too wide for double precision: it makes the variance of 'y1' 1e+40 times its noise, and 1e+28 times is the "
        "most. Give the unknown directions of the state as `diffuse=`, which is exact."
    )


def test_without_noise_any_prior_is_taken():
    exact = es.StateSpace(**{**ONE, "R": [[0.0]]})
    assert es.estimate(es.Kalman(exact), RECORD, prior=es.Prior([0.0], [[1e40]])).mean[-1] == 0.9
