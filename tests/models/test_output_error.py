"""The output-error model: against its state space, its polynomials, and what is refused."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimable import InputError, OutputError

TWO = OutputError(
    [[0.5, 0.2], [0.1, 0.3]], np.random.default_rng(0).normal(size=(2, 2, 4)), delay=1, noise_variance=[0.1, 0.2], dt=1
)


def test_the_state_space_answers_like_the_polynomials():
    u = np.random.default_rng(1).normal(size=(40, 2))
    model, x, y = TWO.to_state_space(), 0.0, []
    x = np.zeros(model.n)
    for row in u:
        y.append(model.C @ x + model.D @ row)
        x = model.A @ x + model.B @ row
    assert_allclose(TWO.response(u), y, atol=1e-13)


def test_the_response_solves_the_difference_equation():
    plant = OutputError([0.523, 0.349], [0.440, 0.762], noise_variance=0.1, dt=1)
    u = np.random.default_rng(2).normal(size=30)
    x = plant.response(u)[:, 0]
    for k in range(2, 30):
        assert_allclose(x[k], -0.523 * x[k - 1] - 0.349 * x[k - 2] + 0.44 * u[k] + 0.762 * u[k - 1], atol=1e-13)


def test_parameters_there_and_back():
    back = OutputError.of_parameters(
        TWO.parameters, na=2, nb=3, delay=1, noise_variance=[0.1, 0.2], dt=1, inputs=TWO.inputs, outputs=TWO.outputs
    )
    assert_allclose(back.a, TWO.a)
    assert_allclose(back.b, TWO.b)
    assert len(TWO.parameter_names) == len(TWO.parameters) == 20


def test_no_denominator_is_a_finite_impulse_response():
    assert OutputError([], [1.0, 2.0], delay=1, noise_variance=0.1, dt=1).response([1.0, 0, 0]).ravel().tolist() == [
        0,
        1,
        2,
    ]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"b": [[1.0]]}, "`b` must be (p, m, lags)"),
        ({"noise_variance": -0.1}, "`noise_variance` must be at least 0"),
        ({"dt": 0.0}, "`dt` must be greater than 0"),
        ({"delay": -1}, "`delay` must be an integer"),
        ({"a": [np.nan]}, "`a` must not hold NaN"),
        ({"noise_variance": [0.1, 0.2]}, "`noise_variance` must be (p,) = (1,)"),
    ],
)
def test_what_is_wrong_is_said(arguments, sentence):
    with pytest.raises(InputError) as caught:
        OutputError(**({"a": [0.5], "b": [1.0], "noise_variance": 0.1, "dt": 1.0} | arguments))
    assert sentence in str(caught.value)
