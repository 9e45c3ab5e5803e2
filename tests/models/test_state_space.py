"""The model record: what is filled in, what varies in time, and the same model in other states."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from estimable import OperatingPoint, StateSpace


def test_what_is_not_given_is_filled_in():
    model = StateSpace([[0.5, 0.1], [0.0, 0.2]], dt=0.5)
    np.testing.assert_array_equal(model.B, np.zeros((2, 0)))
    np.testing.assert_array_equal(model.C, np.eye(2))
    np.testing.assert_array_equal(model.D, np.zeros((2, 0)))
    np.testing.assert_array_equal(model.G, np.eye(2))
    np.testing.assert_array_equal(model.Q, np.zeros((2, 2)))
    assert (model.R, model.S, model.B_end, model.operating_point) == (None, None, None, None)
    assert (model.n, model.m, model.p) == (2, 0, 2)
    assert (model.states, model.inputs, model.outputs) == (("x1", "x2"), (), ("y1", "y2"))
    assert (model.steps, model.varying, model.is_continuous) == (None, (), False)


@pytest.mark.parametrize(("given", "inputs"), [("B", (2, 3)), ("D", (1, 3)), ("B_end", (2, 3))])
def test_the_number_of_inputs_comes_from_whichever_is_given(given, inputs):
    model = StateSpace(np.eye(2), C=[[1.0, 0.0]], dt=1, **{given: np.ones(inputs)})
    assert model.m == 3
    assert (model.B.shape, model.D.shape) == ((2, 3), (1, 3))
    assert model.inputs == ("u1", "u2", "u3")
    for name in {"B", "D"} - {given}:
        assert not getattr(model, name).any()


def test_the_number_of_noises_comes_from_G():
    model = StateSpace(np.eye(3), G=np.ones((3, 2)), dt=1)
    np.testing.assert_array_equal(model.Q, np.zeros((2, 2)))


def test_a_model_of_dt_zero_is_continuous():
    assert StateSpace([[1.0]], dt=0).is_continuous
    assert StateSpace([[1.0]], dt=0.0).dt == 0.0


@pytest.mark.parametrize("name", ["A", "B", "C", "D", "Q", "R", "G", "S"])
def test_any_matrix_may_have_a_leading_time_axis(full, name):
    constant = full()
    matrix = getattr(constant, name)
    point = {"states": np.zeros(3), "inputs": np.zeros(2), "outputs": np.zeros(2)}
    model = full(operating_point=point, **{name: np.stack([matrix] * 4)})
    assert model.varying == (name,)
    assert model.steps == 4
    assert (model.n, model.m, model.p) == (constant.n, constant.m, constant.p)


def test_several_matrices_may_vary_over_the_same_rows():
    model = StateSpace(np.ones((5, 2, 2)), C=np.ones((5, 1, 2)), R=np.ones((5, 1, 1)), dt=1)
    assert model.varying == ("A", "C", "R")
    assert model.steps == 5


def test_one_row_of_time_is_not_a_constant():
    assert StateSpace(np.ones((1, 2, 2)), dt=1).steps == 1


def test_outputs_of_the_operating_point_are_those_of_the_model_there(full):
    model = full()
    point = model.operating_point
    np.testing.assert_array_equal(point.outputs, model.C @ point.states + model.D @ point.inputs)


def test_parts_of_the_operating_point_that_are_not_given_are_zero():
    model = StateSpace(np.eye(2), [[1.0], [0.0]], D=[[3.0], [0.0]], dt=1, operating_point={"inputs": [2.0]})
    np.testing.assert_array_equal(model.operating_point.states, [0.0, 0.0])
    np.testing.assert_array_equal(model.operating_point.outputs, [6.0, 0.0])


def test_outputs_of_the_operating_point_may_be_given(full):
    given = OperatingPoint(np.ones(3), np.ones(2), [7.0, 8.0])
    np.testing.assert_array_equal(full(operating_point=given).operating_point.outputs, [7.0, 8.0])


@pytest.mark.parametrize("seed", range(3))
def test_the_same_model_in_other_states_has_the_same_behaviour(full, seed):
    random = np.random.default_rng(seed)
    model, T = full(seed=seed), random.normal(size=(3, 3))
    turned = model.in_basis(T)
    back = np.linalg.inv(T)
    close = {"rtol": 1e-12, "atol": 1e-12 * np.linalg.cond(T)}
    np.testing.assert_allclose(turned.A, T @ model.A @ back, **close)
    np.testing.assert_allclose(turned.B, T @ model.B, **close)
    np.testing.assert_allclose(turned.C, model.C @ back, **close)
    np.testing.assert_allclose(turned.G @ turned.Q @ turned.G.T, T @ model.G @ model.Q @ model.G.T @ T.T, **close)
    np.testing.assert_allclose(turned.G @ turned.S, T @ model.G @ model.S, **close)
    for same in ("D", "R", "Q", "S"):
        np.testing.assert_array_equal(getattr(turned, same), getattr(model, same))
    # what the outside sees: Markov parameters, from the inputs and from the noise
    for B, B_turned in ((model.B, turned.B), (model.G, turned.G)):
        for k in range(4):
            there = turned.C @ np.linalg.matrix_power(turned.A, k) @ B_turned
            np.testing.assert_allclose(there, model.C @ np.linalg.matrix_power(model.A, k) @ B, **close)
    np.testing.assert_allclose(turned.operating_point.states, T @ model.operating_point.states, **close)
    np.testing.assert_array_equal(turned.operating_point.outputs, model.operating_point.outputs)
    assert turned.states == ("x1", "x2", "x3")
    assert (turned.inputs, turned.outputs, turned.dt) == (model.inputs, model.outputs, model.dt)


def test_a_model_over_time_turns_row_by_row(full):
    T = np.array([[2.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]])
    A = np.random.default_rng(5).normal(size=(4, 3, 3))
    turned = full(A=A).in_basis(T)
    assert turned.varying == ("A",)
    for k in range(4):
        np.testing.assert_allclose(turned.A[k], T @ A[k] @ np.linalg.inv(T), rtol=1e-13, atol=1e-13)


def test_the_effect_of_the_end_of_an_input_turns_too(full):
    model = full(dt=0.0).discretise(0.1, hold="first_order")
    T = np.diag([2.0, 3.0, 4.0])
    np.testing.assert_allclose(model.in_basis(T).B_end, T @ model.B_end, rtol=1e-15)


@pytest.mark.parametrize("size", [1e-12, 1e12])
def test_a_change_of_units_is_not_singular(full, size):
    model = full()
    T = np.diag([size, 1.0, 1 / size])
    back = model.in_basis(T).in_basis(np.linalg.inv(T))
    np.testing.assert_allclose(back.A, model.A, rtol=1e-14)


def test_a_model_may_be_built_of_what_jax_is_tracing():
    def top(a):
        model = StateSpace(a * jnp.eye(2), jnp.ones((2, 1)), Q=a * jnp.eye(2), R=np.eye(2), dt=1, inputs=["u"])
        assert (model.n, model.m, model.p, model.states) == (2, 1, 2, ("x1", "x2"))
        return jnp.sum(model.A @ model.Q)

    assert float(jax.grad(top)(3.0)) == 12.0
    assert float(jax.jit(top)(3.0)) == 18.0
