"""How curved a model is: biases known in closed form, and the sentence that follows."""

import jax.numpy as jnp
import numpy as np
from numpy.testing import assert_allclose

import estimable as es


def measured(model, prior, rows=2, **record):
    blind = es.Record(np.full((rows, model.p), np.nan), **({"dt": 1} | record))
    return es.diagnostics.nonlinearity(model, es.estimate(es.ExtendedKalman(model), blind, prior=prior), blind)


def test_biases_are_those_of_the_second_moments():
    """x+ = x², y = x²: of x ~ N(2, .1) the mean of x+ is biased by .1, in units of sqrt(4 · 4 · .1 + 2 · .01)."""
    model = es.NonlinearModel(lambda x, u, θ: x**2, lambda x, u, θ: x**2, Q=[[0.0]], R=[[0.3]], dt=1)
    check = measured(model, es.Prior([2.0], [[0.1]]))
    m, P = 4.1, 16 * 0.1 + 2 * 0.01
    assert_allclose(check.state_bias, [[0.1 / np.sqrt(P)]])
    assert_allclose(check.output_bias, [[P / np.sqrt(4 * m**2 * P + 2 * P**2 + 0.3)]])
    assert_allclose(check.third_order, [[0.0]], atol=1e-12)


def test_between_samples_the_bias_is_that_of_the_moment_equations():
    """dx/dt = x²: d(m₂ - m₁)/dt = P at the start, over a short step."""
    model = es.NonlinearModel(lambda x, u, θ: x**2, lambda x, u, θ: x, Q=[[0.0]], R=[[1.0]], dt=0, substeps=2)
    check = measured(model, es.Prior([1.0], [[0.01]]), dt=1e-4)
    assert_allclose(check.state_bias, [[1e-4 * 0.01 / 0.1]], rtol=1e-3)


def test_the_sentence_follows_the_size():
    def about(h, variance):
        return measured(
            es.NonlinearModel(lambda x, u, θ: x, h, Q=[[0.0]], R=[[0.01]], dt=1), es.Prior([1.0], [[variance]])
        )

    assert about(lambda x, u, θ: x + 1e-3 * x**2, 0.1).sentence.endswith("ExtendedKalman is sufficient.")
    assert "use SecondOrderKalman or UnscentedKalman." in about(lambda x, u, θ: x**2, 0.1).sentence
    strong = about(lambda x, u, θ: jnp.sin(3 * x), 0.5)
    assert strong.third_order.max() > 0.3
    assert "the second order is not sufficient either" in strong.sentence
