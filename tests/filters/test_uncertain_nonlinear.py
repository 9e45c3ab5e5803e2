"""Considered parameters of the nonlinear filters: against the linear filter, against an order of parameters, and by draws."""

import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimable import (
    ChangeDetection,
    ExtendedKalman,
    Kalman,
    ModelUncertainty,
    NonlinearModel,
    Prior,
    Record,
    SecondOrderKalman,
    StateSpace,
    UnscentedKalman,
    estimate,
    estimate_bank,
    load,
    online,
    save,
    smooth,
)

LINEAR = StateSpace([[-1.0, 0.5], [2.0, -3.0]], [[0.3], [2.0]], [[1.0, 0.3], [0.0, 1.0]], Q=0.1 * np.eye(2),
                    R=[[0.1, 0.03], [0.03, 0.2]], dt=0)  # fmt: skip
PRIOR = Prior([0.3, -0.2], np.diag([0.5, 1.0]))
rng = np.random.default_rng(0)
Y, U = rng.normal(size=(25, 2)), rng.normal(size=(25, 1))
Y[rng.random(Y.shape) < 0.2] = np.nan
RECORD = Record(Y, U, t=np.cumsum(rng.choice([0.1, 0.3], size=25)), hold="first_order")
EVERY = ModelUncertainty(A=[[0.1, 0.05], [0.0, 0.2]], B=[[0.0], [0.3]], C=[[0.0, 0.2], [0.0, 0.0]])

TRUTH = {"stiffness": 4.0, "damping": 0.3, "torque": 1.0}
STEP, ROWS = 0.05, 160
START = Prior([0.0, 0.0], np.diag([0.01, 0.01]))
TORQUE = 3.0 * np.sign(np.sin(1.3 * STEP * np.arange(ROWS)))[:, None]


def pendulum(names=tuple(TRUTH), continuous=False):
    """A pendulum with its parameters in any order, continuous or by steps of Euler's method."""
    stiffness, damping, torque = (names.index(name) for name in TRUTH)

    def slope(x, u, θ):
        return jnp.array([x[1], -θ[stiffness] * jnp.sin(x[0]) - θ[damping] * x[1] + θ[torque] * u[0]])

    return NonlinearModel(
        slope if continuous else lambda x, u, θ: x + STEP * slope(x, u, θ), lambda x, u, θ: x[:1],
        Q=np.diag([0.0, 1e-3 if continuous else 1e-3 * STEP]), G=np.eye(2), R=[[1e-3]], dt=0 if continuous else STEP,
        states=["angle", "rate"], inputs=["u"], parameters={name: TRUTH[name] for name in names}, substeps=1,
    )  # fmt: skip


PENDULUM = pendulum()
CONSIDERED = ModelUncertainty(parameters={"damping": 0.09, "stiffness": 0.4})


def swing(seed, substeps=1):
    """A record of a pendulum whose parameters are drawn, with a torque of .8, and its last state."""
    rng = np.random.default_rng(seed)
    k, c = 4 * (1 + 0.1 * rng.normal()), 0.3 * (1 + 0.3 * rng.normal())
    x, y, h = 0.1 * rng.normal(size=2), np.empty(ROWS), STEP / substeps
    for row in range(ROWS):
        y[row], last = x[0] + np.sqrt(1e-3) * rng.normal(), x
        for _ in range(substeps):
            force = -k * np.sin(x[0]) - c * x[1] + 0.8 * TORQUE[row, 0]
            x = x + h * np.array([x[1], force]) + [0, np.sqrt(1e-3 * h) * rng.normal()]
    return Record(y, TORQUE, dt=STEP, inputs=["u"]), last


def assert_same(ours, theirs, rtol=1e-11):
    assert_allclose(ours.mean, theirs.mean, rtol=rtol, atol=1e-12)
    assert_allclose(ours.covariance, theirs.covariance, rtol=rtol, atol=1e-12)
    assert_allclose(ours.log_likelihood, theirs.log_likelihood, rtol=1e-11)


@pytest.mark.parametrize("treat", ["considered", "estimated"])
def test_of_a_linear_model_the_extended_filter_is_the_linear_one(treat):
    given = ModelUncertainty(EVERY.A, EVERY.B, EVERY.C, treat)
    ours, theirs = (estimate(one(LINEAR, uncertainty=given), RECORD, prior=PRIOR) for one in (ExtendedKalman, Kalman))
    assert_same(ours, theirs)


@pytest.mark.parametrize("filter", [SecondOrderKalman, UnscentedKalman])
def test_so_are_the_others_where_the_entries_multiply_the_input_only(filter):
    given = ModelUncertainty(B=EVERY.B)
    ours, theirs = (estimate(one(LINEAR, uncertainty=given), RECORD, prior=PRIOR) for one in (filter, Kalman))
    assert_same(ours, theirs)


@pytest.mark.parametrize("filter", [ExtendedKalman, UnscentedKalman])
def test_the_order_of_the_parameters_is_that_of_their_names(filter):
    record, _ = swing(0)
    found = [
        estimate(filter(model, parameters=Prior([1.0], [[0.25]]), uncertainty=CONSIDERED), record, prior=START)
        for model in (PENDULUM, pendulum(("torque", "stiffness", "damping")))
    ]
    assert_same(*found, rtol=1e-9)
    assert_allclose(found[0].gain, found[1].gain, rtol=1e-10)
    assert found[0].names.gains == ("torque",)


@pytest.mark.parametrize(
    ("filter", "continuous"), [(ExtendedKalman, True), (SecondOrderKalman, False), (UnscentedKalman, False)]
)
def test_the_errors_are_those_that_the_covariance_says(filter, continuous):
    """Stiffness off by 10 %, damping by 30 %: taken as right, the errors of the torque are 16 times sigma."""
    drawn = [swing(seed, 10 if continuous else 1) for seed in range(100 if continuous else 200)]
    algorithm = filter(pendulum(continuous=continuous), parameters=Prior([1.0], [[0.25]]), uncertainty=CONSIDERED)
    bank = estimate_bank(algorithm, [record for record, _ in drawn], prior=START)
    torque = (bank.gain[:, -1, 0] - 0.8) / np.sqrt(bank.gain_covariance[:, -1, 0, 0])
    state = (bank.mean[:, -1] - [last for _, last in drawn]) / np.sqrt(
        np.diagonal(bank.covariance[:, -1], axis1=1, axis2=2)
    )
    assert 0.8 < np.sqrt(np.mean(torque**2)) < 1.2  # three standard errors
    assert (np.sqrt(np.mean(state**2, axis=0)) < 1.2).all()
    assert bank.engine == "native"


def test_online_is_offline_and_a_file_holds_the_parameters(tmp_path):
    record, _ = swing(1)
    algorithm = UnscentedKalman(PENDULUM, uncertainty=CONSIDERED)
    whole, running = estimate(algorithm, record[:40], prior=START), online(algorithm, prior=START)
    for k in range(40):
        if k:
            running.predict(TORQUE[k - 1], dt=STEP)
        running.correct(record.y[k])
    assert_allclose(running.info.mean, whole.mean[-1], rtol=1e-12)
    assert whole.gain is None
    save(tmp_path / "a.npz", CONSIDERED)
    assert load(tmp_path / "a.npz").parameters == CONSIDERED.parameters


def test_a_detector_of_jumps_finds_them_between_the_states_and_the_gains():
    algorithm = ExtendedKalman(PENDULUM, parameters=Prior([0.8], [[0.01]]), uncertainty=CONSIDERED)
    watch = ChangeDetection(algorithm, slots=2, levels=1).init(START)
    assert algorithm.uncertain_entries == 2
    assert_allclose(watch.track.belief.mean, [0.0, 0.0, 4.0, 0.3, 0.8])
    assert_allclose(np.diagonal(watch.track.belief.covariance), [0.01, 0.01, 0.4**2, 0.09**2, 0.01])


def test_a_relative_one_is_that_of_every_parameter_other_than_zero():
    given = ModelUncertainty(relative=0.1)
    assert given.of_parameters(PENDULUM) == pytest.approx({"stiffness": 0.4, "damping": 0.03, "torque": 0.1})


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: ExtendedKalman(PENDULUM, uncertainty=ModelUncertainty(A=[[1.0]])), "`uncertainty.A` is that of a StateSpace"),
        (lambda: ExtendedKalman(LINEAR, uncertainty=CONSIDERED), "`uncertainty.parameters` names parameters of a NonlinearModel"),
        (lambda: UnscentedKalman(PENDULUM, uncertainty=ModelUncertainty(relative=0.1, treat="estimated")),
         'treat = "estimated" is that of a StateSpace'),
        (lambda: ExtendedKalman(PENDULUM, uncertainty=ModelUncertainty(parameters={"stifness": 0.1})),
         "names 'stifness', which is no parameter of the model ('stiffness', 'damping', 'torque'). Did you mean 'stiffness'?"),
        (lambda: ExtendedKalman(PENDULUM, uncertainty=ModelUncertainty(parameters={"damping": 0.0})), "names no parameter"),
        (lambda: ExtendedKalman(PENDULUM, parameters=Prior([1.0, 1.0], np.eye(2)), uncertainty=CONSIDERED),
         "`parameters` must be a prior of the model's 1 parameter ('torque'). Got 2."),
        (lambda: ExtendedKalman(PENDULUM, uncertainty=0.1), "`uncertainty` must be"),
        (lambda: ModelUncertainty(parameters=[0.1]), "`parameters` must be a mapping of names to standard deviations"),
        (lambda: ModelUncertainty(parameters={"damping": -1.0}), "`parameters['damping']` must be"),
        (lambda: smooth(SecondOrderKalman(PENDULUM, uncertainty=CONSIDERED), swing(0)[0], prior=START),
         "smooth does not support `uncertainty`"),
    ],
)  # fmt: skip
def test_each_fault_has_a_sentence(refused, make, sentence):
    assert any(sentence in one for one in refused(make))
