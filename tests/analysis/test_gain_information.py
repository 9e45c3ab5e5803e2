"""The bound of a gain: against the filter that reaches it, the joint Gaussian, closed forms; dither; what is not told."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimable import AssumptionError, InputError, Prior, Record, StateSpace, UnknownGain, estimate, gain_information
from oracles import dense

I2 = np.eye(2)
NAMES = {"inputs": ["left", "right"]}


def plant(q=0.001, **more):
    A, B = [[0.9, 0.1], [-0.2, 0.8]], [[0.5, 0.4], [0.1, -0.6]]
    return StateSpace(A, B, Q=q * I2, R=[[0.01, 0.002], [0.002, 0.03]], dt=0.1, **NAMES, **more)


def inputs(T=40, seed=0):
    return np.random.default_rng(seed).normal(size=(T, 2))


def diffuse(p):
    return Prior(np.zeros(p), np.zeros((p, p)), diffuse=np.eye(p))


def filtered(model, record, p, state, gain=None, **settings):
    return estimate(UnknownGain(model, gain or diffuse(p), **settings), record, prior=state).gain_covariance[-1]


@pytest.mark.parametrize("q", [0.0, 0.001])
@pytest.mark.parametrize("state", [Prior(np.zeros(2), I2), Prior(np.zeros(2), 0 * I2), diffuse(2)])
def test_the_filter_reaches_the_bound(q, state):
    model, u = plant(q), inputs()
    found = gain_information(model, u, directions="per_input", state=state)
    record = Record(np.zeros((40, 2)), u, dt=0.1, inputs=model.inputs)
    assert_allclose(found.covariance, filtered(model, record, 2, state, directions="per_input"), rtol=1e-9)
    assert_allclose(found.sigma, np.sqrt(np.diagonal(found.covariance)), rtol=1e-14)


def test_with_a_prior_of_the_gain_and_missing_outputs():
    model, u, state = plant(), inputs(), Prior(np.zeros(2), 2 * I2)
    gain = Prior([1.0, 1.0], [[0.3, 0.1], [0.1, 0.0333333333333333333]])
    y = np.where(np.random.default_rng(1).random((40, 2)) < 0.4, np.nan, 0.0)
    record = Record(y, u, dt=0.1, inputs=model.inputs)
    found = gain_information(model, record, directions="per_input", state=state, gain=gain)
    expected = filtered(model, record, 2, state, gain, directions="per_input")
    assert_allclose(found.covariance, expected, rtol=1e-9, atol=1e-15)


def test_it_is_the_joint_gaussian_s_information():
    """With x[0] and θ unknown: I = H' S^-1 H, S the covariance that the noises alone give to the whole record."""
    model, u, T = plant(0.02), inputs(6), 6
    still = Prior(np.zeros(2), 0 * I2)
    base, _, _, Y, cov = dense.joint(model, still, 0 * u, T)[2], *dense.joint(model, still, 0 * u, T)[1:]
    columns = [Y.reshape(12, -1)[:, :2]]
    for i in range(2):
        moved = dense.joint(model, still, u * (np.arange(2) == i), T)[2]
        columns.append((moved - base).reshape(12, 1))
    H, rows = np.hstack(columns), Y.reshape(12, -1)
    expected = H.T @ np.linalg.solve(rows @ cov @ rows.T, H)
    assert_allclose(gain_information(model, u, directions="per_input").information, expected, rtol=1e-10, atol=1e-9)


def test_continuous_models_steps_that_vary_feedthrough_and_cross_noise():
    continuous = StateSpace([[-1.0]], [[2.0]], [[1.0]], [[0.5]], Q=[[0.1]], R=[[0.04]], dt=0)
    t = np.cumsum([0.0, 0.1, 0.3, 0.1, 0.2, 0.1, 0.3])
    u, state = np.sin(3 * t)[:, None], Prior([0.0], [[1.0]])
    for hold in ("zero_order", "first_order"):
        record = Record(np.zeros((7, 1)), u, t=t, hold=hold)
        found = gain_information(continuous, record, state=state, feedthrough="scaled")
        assert_allclose(found.covariance, filtered(continuous, record, 1, state, feedthrough="scaled"), rtol=1e-9)
    crossed = StateSpace([[0.8]], [[1.0]], [[1.0]], Q=[[1.0]], R=[[0.5]], S=[[0.3]], dt=1)
    record = Record(np.zeros((7, 1)), u, dt=1)
    found = gain_information(crossed, u, state=state)
    assert_allclose(found.covariance, filtered(crossed, record, 1, state), rtol=1e-9)


def test_a_model_that_varies_and_directions_as_matrices():
    A = np.stack([plant().A * s for s in np.linspace(0.8, 1.0, 12)])
    model, u, state = StateSpace(A, plant().B, Q=0.01 * I2, R=I2, dt=1), inputs(12), Prior(np.zeros(2), I2)
    directions = np.array([[[1.0, 0.0], [0.0, 0.0]], [[0.0, 0.0], [0.5, 1.0]], [[0.0, 1.0], [0.0, 0.0]]])
    found = gain_information(model, u, directions=directions, state=state)
    expected = filtered(model, Record(np.zeros((12, 2)), u, dt=1), 3, state, directions=directions)
    assert_allclose(found.covariance, expected, rtol=1e-8)
    assert found.gains == ("gain1", "gain2", "gain3")


def test_inputs_that_move_together_tell_their_sum_only():
    u = inputs()[:, [0, 0]]
    same = StateSpace([[0.5]], [[1.0, 1.0]], [[1.0]], Q=[[0.01]], R=[[0.1]], dt=1, **NAMES)
    found = gain_information(same, u, directions="per_input")
    assert_allclose(found.directions, [[0.5**0.5, -(0.5**0.5)]], atol=1e-9)
    assert np.isinf(found.sigma).all()
    assert "The input carries no information about 0.71 gain_left - 0.71 gain_right." in found.sentences
    told = gain_information(same, u, directions="per_input", gain=Prior([1.0, 1.0], I2))
    difference = np.array([1.0, -1.0])
    assert_allclose(difference @ told.covariance @ difference, 2.0, rtol=1e-9)
    assert len(told.directions) == 1


def test_ordinary_emptiness():
    quiet = gain_information(plant(), np.zeros((5, 2)))
    assert (quiet.sigma[0], quiet.sentences) == (np.inf, ("The input carries no information about gain.",))
    one = gain_information(plant(), np.ones((1, 2)), gain=Prior([1.0], [[0.25]]))
    assert_allclose(one.covariance, [[0.25]], rtol=1e-12)
    blind = gain_information(
        plant(outputs=["y1", "y2"]), Record(np.full((4, 2), np.nan), np.ones((4, 2)), dt=0.1, **NAMES)
    )
    assert np.isinf(blind.sigma).all()
    assert not blind.information.any()
    silent = gain_information(plant(), inputs() * [1, 0], directions="per_input")
    assert np.isfinite(silent.sigma[0])
    assert np.isinf(silent.sigma[1])
    assert silent.covariance[0, 1] == 0


def test_a_dither_of_a_given_size_and_the_size_that_is_enough():
    model, u, d = plant(), inputs(seed=1), inputs(seed=2)
    found = gain_information(model, u, directions="per_input", dither=d)
    for amplitude in (0.0, 0.7, -2.0):
        direct = gain_information(model, u + amplitude * d, directions="per_input")
        assert_allclose(found.at(amplitude).covariance, direct.covariance, rtol=1e-9)
        assert_allclose(found.at(amplitude).information, direct.information, rtol=1e-9, atol=1e-9)
    wanted = found.sigma / [3.0, 5.0]
    amplitude = found.amplitude_for(wanted)
    assert_allclose(np.max(found.at(amplitude).sigma / wanted), 1.0, rtol=1e-9)
    assert np.all(found.at(1.2 * amplitude).sigma < wanted)
    assert found.amplitude_for(2 * found.sigma.max()) == 0.0
    still = gain_information(model, 0 * u, directions="per_input", dither=d)
    assert_allclose(still.at(4.0).sigma, still.at(1.0).sigma / 4, rtol=1e-9)
    assert "With 4 times the dither, gain_left can be known to" in still.at(4.0).sentences[0]


def test_a_dither_that_first_cancels_the_input():
    """θ is told by (1 - a) u: at a = 1 by nothing, so what is enough lies beyond."""
    model, u = plant(), inputs()
    found = gain_information(model, u, dither=-u)
    assert np.isinf(found.at(1.0).sigma[0])
    assert_allclose(found.amplitude_for(1.001 * found.sigma), 1 + 1 / 1.001, rtol=1e-9)


def test_no_amplitude_is_enough():
    one_sided = gain_information(plant(), inputs() * [1, 0], directions="per_input", dither=inputs() * [1, 0])
    with pytest.raises(
        AssumptionError, match=r"no amplitude of this dither is enough: it carries no information about gain_right\."
    ):
        one_sided.amplitude_for(0.1)


def test_what_is_said_of_wrong_calls():
    wrong = {
        "`model` must be a StateSpace": lambda: gain_information(1, [[1.0]]),
        "the model has no input": lambda: gain_information(StateSpace([[0.5]], Q=[[1.0]], R=[[1.0]], dt=1), [[1.0]]),
        "`u` must be": lambda: gain_information(plant(), np.ones((3, 3))),
        "`u` must have at least one row": lambda: gain_information(plant(), np.ones((0, 2))),
        "`gain` must be a prior of 2 gains. Got 1": lambda: gain_information(
            plant(), inputs(), directions="per_input", gain=Prior([1.0], [[1.0]])
        ),
        "`state` must be a prior of 2 states. Got 1": lambda: gain_information(
            plant(), inputs(), state=Prior([1.0], [[1.0]])
        ),
        "`dt` must be the model's own step, 0.1 s. Got 1": lambda: gain_information(plant(), inputs(), dt=1.0),
        "`dt` is needed": lambda: gain_information(StateSpace([[-1.0]], [[1.0]], Q=[[1.0]], R=[[1.0]], dt=0), [[1.0]]),
        "`dt` is for inputs without times": lambda: gain_information(
            plant(), Record(np.zeros((40, 2)), inputs(), dt=0.1), dt=0.1
        ),
        "the record's step is 1 s, the model's dt = 0.1 s": lambda: gain_information(
            plant(), Record(np.zeros((40, 2)), inputs(), dt=1)
        ),
        "`dither` must be": lambda: gain_information(plant(), inputs(), dither=np.ones((3, 2))),
        "no dither was given": lambda: gain_information(plant(), inputs()).at(1.0),
        "`sigma` must be greater than 0. Got -1": lambda: gain_information(
            plant(), inputs(), dither=inputs()
        ).amplitude_for(-1.0),
    }
    for sentence, call in wrong.items():
        with pytest.raises(InputError) as refusal:
            call()
        assert sentence in str(refusal.value)
    with pytest.raises(AssumptionError, match="an output has no noise"):
        gain_information(StateSpace([[0.5]], [[1.0]], Q=[[1.0]], R=[[0.0]], dt=1), [[1.0]])
