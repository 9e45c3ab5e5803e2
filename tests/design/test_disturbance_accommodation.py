"""Three modes against their own definitions, a finite horizon that shares no equation, and loops that are flown."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import expm, solve_continuous_are

from estimable import (
    AssumptionError,
    InputError,
    Kalman,
    Prior,
    StateFeedback,
    StateSpace,
    Waveform,
    close_loop,
    disturbance_accommodation,
    kalman_gain,
    lqr_gain,
)

SPRING = StateSpace(
    [[0.0, 1.0], [-1.0, -0.4]], [[0.0], [1.0]], [[1.0, 0.0]], Q=np.diag([0.0, 1e-4]), R=[[1e-6]], dt=0, states=["place", "speed"],
    inputs=["force"], outputs=["place"],
)  # fmt: skip
SAMPLED = SPRING.discretise(0.1)
WEIGHTS = {"L": np.diag([2.0, 0.5]), "M": np.array([[0.3]])}
MODELS = pytest.mark.parametrize("model", [SPRING, SAMPLED], ids=["continuous", "discrete"])
FORMS = {
    "constant": Waveform.constant(), "ramp": Waveform.ramp(), "sinusoid": Waveform.sinusoid(1.7),
    "sum": Waveform.sinusoid(1.7) + Waveform.constant(),
}  # fmt: skip
EVERY_FORM = pytest.mark.parametrize("form", FORMS)


def design(model, form, mode, through=None, **given):
    through = model.B if through is None else through
    return disturbance_accommodation(model, FORMS[form], through=through, mode=mode, **WEIGHTS, **given)


def test_waveforms_are_what_they_are_called():
    t = np.linspace(0, 3, 7)
    assert_allclose(Waveform.polynomial(2).values(t, [1.0, 2.0, 3.0])[:, 0], 1 + 2 * t + 1.5 * t**2, rtol=1e-12)
    assert_allclose(Waveform.sinusoid(2.0).values(t, [0.0, 1.0])[:, 0], np.sin(2 * t), atol=1e-12)
    both = Waveform.each(Waveform.constant(), Waveform.sinusoid(2.0))
    assert_allclose(both.values(t, [5.0, 1.0, 0.0]), np.column_stack([np.full(7, 5.0), np.cos(2 * t)]), atol=1e-12)
    assert (FORMS["sum"].order, FORMS["sum"].channels) == (3, 1)


@MODELS
@EVERY_FORM
def test_what_is_absorbed_never_reaches_the_state(model, form):
    found = design(model, form, "absorption")
    closed = found.model.A - found.model.B @ found.feedback
    assert_allclose(closed[:2, 2:], 0, atol=1e-12)
    assert_allclose(found.steady, 0, atol=1e-9)
    assert_allclose(found.feedback[:, :2], lqr_gain(model, *WEIGHTS.values()).feedback, rtol=1e-12)
    assert not found.left.any()


@MODELS
@EVERY_FORM
@pytest.mark.parametrize("mode", ["minimisation", "utilisation"])
def test_the_steady_state_is_where_the_loop_ends(model, form, mode):
    """The composite's own motion, long after its start; disturbances enter where no input acts."""
    found = design(model, form, mode, through=[[1.0], [0.3]])
    closed = found.model.A - found.model.B @ found.feedback
    late = expm(closed * 40) if model.dt == 0 else np.linalg.matrix_power(closed, 400)
    z0 = np.linspace(1, 2, found.order)
    end = late @ np.append([0.3, -0.2], z0)
    assert_allclose(end[:2], found.steady @ end[2:], atol=1e-5 * np.abs(end).max())
    if mode == "minimisation":
        assert not found.left.any()
        assert abs(end[0]) < 1e-5 * np.abs(end).max()


def test_the_output_is_freed_by_the_regulator_equations():
    found = design(SPRING, "sinusoid", "minimisation", through=[[1.0], [0.3]])
    A, B, C, F = SPRING.A, SPRING.B, SPRING.C, np.array([[1.0], [0.3]])
    D, H = FORMS["sinusoid"].D, FORMS["sinusoid"].H
    Γ = -found.feedback[:, 2:] - found.feedback[:, :2] @ found.steady
    assert_allclose(found.steady @ D, A @ found.steady + B @ Γ + F @ H, atol=1e-12)
    assert_allclose(C @ found.steady, 0, atol=1e-12)


def test_where_not_all_can_be_freed_no_other_gain_leaves_less():
    found = design(SPRING, "constant", "minimisation", through=[[1.0], [0.3]], freed=np.eye(2))
    K, A = found.feedback[:, :2], SPRING.A - SPRING.B @ found.feedback[:, :2]

    def left(K_z):
        return np.linalg.norm(np.linalg.solve(A, np.array([[1.0], [0.3]]) - SPRING.B * K_z))

    best = np.linalg.norm(found.left)
    assert best > 0.1
    assert_allclose(left(found.feedback[0, 2]), best, rtol=1e-9)
    assert all(left(found.feedback[0, 2] + step) > best for step in (-0.1, -1e-3, 1e-3, 0.1))
    assert K.shape == (1, 2)


@EVERY_FORM
def test_use_is_that_of_a_long_horizon(form):
    """Discrete: 3000 steps of the dynamic programme of the composite, which has a limit though the composite's cost has none."""
    found = design(SAMPLED, form, "utilisation", through=[[0.1], [0.05]])
    A, B = found.model.A, found.model.B
    q = found.order
    L, M = np.zeros((2 + q, 2 + q)), WEIGHTS["M"]
    L[:2, :2] = WEIGHTS["L"]
    P = np.zeros_like(L)
    for _ in range(3000):
        gain = np.linalg.solve(M + B.T @ P @ B, B.T @ P @ A)
        P = L + A.T @ P @ A - A.T @ P @ B @ gain
    assert_allclose(found.feedback, gain, rtol=1e-8, atol=1e-8)


def test_use_in_continuous_time_is_the_limit_of_a_slow_decay():
    """With D - ε I the composite is stabilisable, and its own Riccati equation can be solved."""
    found = design(SPRING, "sinusoid", "utilisation", through=[[1.0], [0.3]])
    A, L = found.model.A.copy(), np.zeros((4, 4))
    L[:2, :2] = WEIGHTS["L"]
    A[2:, 2:] -= 1e-7 * np.eye(2)
    P = solve_continuous_are(A, found.model.B, L, WEIGHTS["M"])
    assert_allclose(found.feedback, np.linalg.solve(WEIGHTS["M"], found.model.B.T @ P), rtol=1e-4, atol=1e-5)


def test_the_gain_of_the_filter_is_that_of_the_composite():
    found = design(SAMPLED, "ramp", "absorption", walk=[0.0, 2.0])
    assert_allclose(found.filter.filter, kalman_gain(found.model).filter)
    h = 0.1  # a slope that walks: Q = 2 [h³/3, h²/2; h²/2, h]
    assert_allclose(found.model.Q[-2:, -2:], 2 * np.array([[h**3 / 3, h**2 / 2], [h**2 / 2, h]]), rtol=1e-12)


def test_a_loop_that_reckons_with_a_disturbance_and_one_that_does_not():
    """The plant is driven by an oscillation of which LQG was not told: the state's rms is ten times smaller with it."""
    found = design(SPRING, "sinusoid", "absorption", walk=0.1)
    quiet = design(SPRING, "sinusoid", "absorption", walk=1e-12).model
    law = lqr_gain(SPRING, *WEIGHTS.values()).feedback
    start = [0.0, 0.0, 1.0, 0.0]
    run = {"reference": np.zeros((1500, 0)), "seed": 0, "dt": 0.02, "start": start}
    plain = close_loop(quiet, StateFeedback(law), Kalman(SPRING), prior=Prior(np.zeros(2), 0.01 * np.eye(2)), **run)
    known = close_loop(quiet, StateFeedback(found.feedback), Kalman(found.model),
                       prior=found.prior(Prior(np.zeros(2), 0.01 * np.eye(2)), 1.0), **run)  # fmt: skip
    rms = [np.sqrt(np.mean(flown.state[750:, 0] ** 2)) for flown in (plain, known)]
    assert rms[1] < 0.1 * rms[0]
    assert abs(known.mean[-1, 2] - known.state[-1, 2]) < 4 * np.sqrt(known.covariance[-1, 2, 2])


def test_the_prior_of_the_composite():
    found = design(SPRING, "ramp", "absorption")
    of_state = Prior([1.0, 2.0], np.eye(2), diffuse=[[1.0], [0.0]])
    assert found.prior(of_state).diffuse.shape == (4, 3)
    assert found.prior(Prior([1.0, 2.0], np.eye(2)), 4.0).covariance[3, 3] == 4.0
    with pytest.raises(InputError, match="must be a prior of n = 2 states"):
        found.prior(Prior([1.0], [[1.0]]))
    with pytest.raises(InputError, match=r"`covariance` must be \(q, q\) = \(2, 2\)"):
        found.prior(of_state, np.eye(3))


def test_names_that_the_plant_has_are_left_to_it():
    taken = StateSpace(SPRING.A, SPRING.B, SPRING.C, R=SPRING.R, Q=SPRING.Q, dt=0, states=["z1", "speed"])
    assert design(taken, "constant", "absorption").model.states == ("z1", "speed", "disturbance1")


def test_units_of_the_states_decide_nothing():
    """Place in nanometres: what was outside the range of the input is so still, and what was inside too."""
    T = np.diag([1e9, 1.0])
    small = SPRING.in_basis(T)
    assert not disturbance_accommodation(small, FORMS["ramp"], through=T @ SPRING.B, **WEIGHTS).left.any()
    for model, F in ((small, T @ [[1e-9], [0.3]]), (SPRING, [[1e-9], [0.3]])):
        with pytest.raises(AssumptionError, match="cannot be absorbed"):
            disturbance_accommodation(model, FORMS["constant"], through=F, **WEIGHTS)


def test_what_cannot_be_done():
    with pytest.raises(AssumptionError, match=r"cannot be absorbed: 95\.8 % of its effect is outside the range of `B`"):
        design(SPRING, "constant", "absorption", through=[[1.0], [0.3]])
    blind = StateSpace(SPRING.A, SPRING.B, [[0.0, 1.0]], Q=SPRING.Q, R=SPRING.R, dt=0)
    with pytest.raises(AssumptionError, match="do not distinguish the disturbance from the state"):
        design(blind, "constant", "absorption")  # a constant force leaves no speed
    free = StateSpace(np.diag([0.0, -1.0]), [[1.0], [1.0]], [[0.0, 1.0]], Q=np.eye(2), R=[[1.0]], dt=0)
    with pytest.raises(AssumptionError, match="`model` is not detectable"):
        design(free, "constant", "absorption")
    with pytest.raises(AssumptionError, match="give every part of the disturbance that does not decay a `walk` > 0"):
        design(SPRING, "constant", "absorption", walk=0.0)
    single = StateSpace([[-1.0]], [[1.0]], Q=[[1.0]], R=[[1.0]], dt=0)
    pole = lqr_gain(single, [[3.0]], [[1.0]]).poles[0].real
    with pytest.raises(AssumptionError, match="a pole of the loop equals an eigenvalue of the disturbance"):
        disturbance_accommodation(single, Waveform([[pole]], [[1.0]]), through=[[1.0]], L=[[3.0]], M=[[1.0]])
    growing = Waveform([[5.0]], [[1.0]])
    with pytest.raises(AssumptionError, match="grows faster than the loop decays"):
        disturbance_accommodation(SPRING, growing, through=SPRING.B, mode="utilisation", **WEIGHTS)


WRONG = {
    "`model` must be a StateSpace": {"model": 1},
    "`disturbance` must be a Waveform. Got 'step'. For example Waveform.constant": {"disturbance": "step"},
    "`mode` must be one of .*Did you mean 'absorption'": {"mode": "absorbtion"},
    r"`through` must be \(n, d\) = \(2, 1\)": {"through": [[1.0]]},
    r"`walk` must be \(q, q\) = \(1, 1\)": {"walk": [1.0, 2.0]},
    "`walk` must be positive semidefinite": {"walk": -1.0},
    "`freed`: there is no output 'plaec'.*Did you mean 'place'": {"freed": ["plaec"]},
    "`model` has no R": {"model": StateSpace([[-1.0]], [[1.0]], dt=0)},
    "`model` has no input": {"model": StateSpace([[-1.0]], R=[[1.0]], dt=0)},
    "`M` must be positive definite": {"M": [[0.0]]},
}


@pytest.mark.parametrize("sentence", WRONG)
def test_wrong_calls(sentence):
    given = {"model": SPRING, "disturbance": Waveform.constant(), "through": SPRING.B, **WEIGHTS, **WRONG[sentence]}
    with pytest.raises(InputError, match=sentence):
        disturbance_accommodation(given.pop("model"), given.pop("disturbance"), **given)


def test_wrong_waveforms():
    with pytest.raises(InputError, match="`H` must show all of z"):
        Waveform(np.zeros((2, 2)), [[1.0, 0.0]])
    with pytest.raises(InputError, match=r"`H` must be \(d, q\) = \(d, 2\)"):
        Waveform(np.zeros((2, 2)), [[1.0]])
    with pytest.raises(InputError, match="`frequency` must be greater than 0 rad/s"):
        Waveform.sinusoid(0.0)
    with pytest.raises(InputError, match="`degree` must be an integer"):
        Waveform.polynomial(-1)
    with pytest.raises(InputError, match="did you mean `each`"):
        Waveform.constant() + Waveform.each(Waveform.constant(), Waveform.constant())
    with pytest.raises(InputError, match="both at least 1"):
        Waveform(np.zeros((0, 0)), np.zeros((1, 0)))
