"""The loop is what its blocks make it: the same estimate as offline, the plant's own motion, links and limits as they say."""

import jax
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.linalg import expm

import estimable as es
from estimable.plants import f16

NAMES = {"states": ["x", "v"], "inputs": ["force"], "outputs": ["place", "speed"]}
MODEL = es.StateSpace(
    [[0.9, 0.2], [-0.1, 0.8]], [[0.5], [1.0]], Q=0.01 * np.eye(2), R=np.diag([0.1, 0.2]), dt=0.5, **NAMES
)
LAW = es.StateFeedback([[0.2, 0.3]], reference_gain=[[0.4]])
PRIOR = es.Prior([0.0, 0.0], np.eye(2))
REFERENCE = np.sin(0.3 * np.arange(40.0))


def run(plant=MODEL, controller=LAW, estimator=None, **given):
    estimator = estimator or es.Kalman(MODEL)
    return es.close_loop(plant, controller, estimator, **{"reference": REFERENCE, "seed": 3, "prior": PRIOR, **given})


def offline(closed, estimator, hold="zero_order", prior=PRIOR):
    names = estimator.names
    record = es.Record(closed.output, closed.input, t=closed.t, hold=hold, inputs=names.inputs, outputs=names.outputs)
    return es.estimate(estimator, record, prior=prior)


@pytest.mark.parametrize("links", [{}, {"output_link": es.BernoulliLink([0.7, 0.5])},
                                   {"input_link": es.GilbertElliottLink.of_rate(0.7, burst=2), "lost": "hold"},
                                   {"input_link": es.DelayLink([0.5, 0.3], late="use"), "output_link": es.BernoulliLink(0.5)}],
                         ids=["none", "sensors", "actuators", "both"])  # fmt: skip
def test_the_estimate_is_the_one_offline_from_what_arrived(links):
    closed = run(**links)
    told = offline(closed, es.Kalman(MODEL))
    assert_allclose(closed.mean, told.mean, rtol=1e-12, atol=1e-12)
    assert_allclose(closed.info.covariance, told.covariance, rtol=1e-12)
    assert_allclose(closed.info.innovation, told.innovation, rtol=1e-12, atol=1e-12)


def test_the_command_is_the_law_of_the_estimate_and_the_plant_follows_it():
    quiet = es.StateSpace(MODEL.A, MODEL.B, R=MODEL.R, dt=0.5, **NAMES)
    closed = run(quiet, start=[1.0, -1.0])
    assert_allclose(closed.command[:, 0], 0.4 * REFERENCE - closed.mean @ [0.2, 0.3], rtol=1e-12)
    assert_array_equal(closed.applied, closed.command)
    assert_allclose(closed.state[0], [1.0, -1.0])
    assert_allclose(closed.state[1:], closed.state[:-1] @ MODEL.A.T + closed.applied[:-1] @ MODEL.B.T, atol=1e-12)


def test_an_actuator_moves_together_with_its_plant():
    plant = f16.controlled(0.4)
    closed = es.close_loop(plant, f16.law(), es.UnknownGain(f16.short_period(), es.Prior([1.0], [[1.0]])), prior=PRIOR,
                           reference=np.full(60, 5.0), seed=1, dt=0.1)  # fmt: skip
    now = np.concatenate([closed.state, closed.input], axis=1)
    for k in (3, 44, 45, 58):
        K = 1.0 if k < 45 else 0.4
        M = np.zeros((4, 4))
        M[:2, :2], M[:2, 2], M[2, 2], M[2, 3] = f16.A, K * f16.B[:, 0], -20.0, 20.0
        assert_allclose(now[k + 1], (expm(0.1 * M) @ np.append(now[k], closed.applied[k]))[:3], rtol=1e-11)
    demanded = f16.COMMAND * 5.0 + closed.mean @ f16.FEEDBACK[:2] + f16.FEEDBACK[2] * closed.input[:, 0]
    assert_allclose(closed.command[:, 0], demanded, rtol=1e-12)


def test_a_held_elevator_flies_as_the_flight_of_the_plant_does():
    """The same states fed back, noise left out: `f16.flight` is written without any of this."""
    plant = f16.controlled(0.5, simulation="held_elevator", sigma_alpha=1e-9, sigma_q=1e-9)
    estimator = es.Kalman(f16.short_period(sigma_alpha=1e-9, sigma_q=1e-9, Q=np.eye(2)))
    closed = es.close_loop(plant, f16.law(integral=True), estimator, prior=PRIOR, seed=1, dt=0.01,
                           reference=f16.pitch_command(np.arange(600) / 100))  # fmt: skip
    flown = f16.flight(0.5, seed=0, simulation="held_elevator")
    assert_allclose(closed.state, flown.state[:600], atol=2e-3)


@pytest.mark.parametrize("lost", ["zero", "hold"])
def test_what_is_lost_leaves_the_actuator_at_zero_or_where_it_was(lost):
    closed = run(input_link=es.BernoulliLink(0.6), lost=lost)
    arrived = closed.arrived[:, 0]
    assert 0.2 < np.mean(arrived) < 0.95
    assert_array_equal(closed.applied[arrived], closed.command[arrived])
    gone = np.flatnonzero(~arrived & (np.arange(len(arrived)) > 0))
    assert_array_equal(closed.applied[gone], closed.applied[gone - 1] if lost == "hold" else 0 * closed.applied[gone])


def test_actuators_stay_within_their_limits_and_rates():
    free = run()
    closed = run(es.ControlledPlant(MODEL, limits=(-0.1, 0.15), rate=0.2))
    assert np.max(np.abs(free.applied)) > 0.2
    assert closed.applied.min() >= -0.1
    assert closed.applied.max() <= 0.15
    steps = np.abs(np.diff(np.append(0.0, closed.applied[:, 0])))
    assert 0.099 < steps.max() <= 0.1 + 1e-12
    told = offline(closed, es.Kalman(MODEL))
    assert_allclose(closed.mean, told.mean, atol=1e-12)


def test_commands_and_outputs_are_rounded_to_what_can_be_told_apart():
    closed = run(es.ControlledPlant(MODEL, quantum=0.05, resolution=[0.1, 0.25]))
    assert_allclose(closed.applied / 0.05, np.round(closed.command / 0.05), atol=1e-9)
    assert_allclose(closed.output / [0.1, 0.25], np.round(closed.output / [0.1, 0.25]), atol=1e-9)
    assert len(np.unique(closed.applied)) > 3
    assert_allclose(closed.mean, offline(closed, es.Kalman(MODEL)).mean, atol=1e-12)


def test_events_follow_one_another():
    other = es.StateSpace(0.5 * MODEL.A, MODEL.B, Q=MODEL.Q, R=MODEL.R, dt=0.5, **NAMES)
    plant = es.ControlledPlant(MODEL, events=[es.Failure(12.0, 0.0), es.Change(5.0, other), es.Failure(8.0, 0.5)])
    phases = plant.phases()
    assert_allclose([phase.A[0, 0] for phase in phases], [0.9, 0.45, 0.45, 0.45])
    assert_allclose([phase.B[1, 0] for phase in phases], [1.0, 1.0, 0.5, 0.0])
    assert_array_equal(plant.phase_rows(np.array([0.0, 4.9, 5.0, 8.0, 11.9, 12.0])), [0, 0, 1, 2, 2, 3])


def test_a_run_does_not_depend_on_how_many_there_are():
    given = {"reference": REFERENCE, "seed": 3, "prior": PRIOR, "output_link": es.BernoulliLink(0.7)}
    few, many = (es.close_loop_bank(MODEL, LAW, es.Kalman(MODEL), runs=runs, **given) for runs in (2, 5))
    assert_allclose(many[1].state, few[1].state, rtol=1e-12)
    assert_allclose(few[0].state, run(output_link=es.BernoulliLink(0.7)).state, rtol=1e-12)
    assert np.abs(few[0].state - few[1].state).max() > 0.1
    assert (len(many), len(few[0])) == (5, 40)


def test_the_engines_agree():
    closed = {engine: run(es.ControlledPlant(MODEL, limits=(-0.1, 0.1)), engine=engine) for engine in ("native", "xla")}
    for leaf, other in zip(*(jax.tree_util.tree_leaves(c) for c in closed.values()), strict=True):
        assert_allclose(leaf, other, rtol=1e-10, atol=1e-12)


def test_one_sample_and_nothing_seen_are_ordinary():
    assert run(reference=[1.0]).command.shape == (1, 1)
    blind = run(output_link=es.BernoulliLink(0.0))
    assert np.isnan(blind.output).all()
    assert np.isfinite(blind.state).all()


def test_what_was_run_can_be_saved(tmp_path):
    closed = run()
    es.save(tmp_path / "run.npz", closed)
    assert_array_equal(es.load(tmp_path / "run.npz").state, closed.state)


@pytest.mark.parametrize(("given", "sentence"), [
    ({"reference": np.zeros((4, 2))}, r"`reference` must be \(T, r\) = \(T, 1\): the controller follows 1 reference"),
    ({"reference": []}, "`reference` must have at least one row"),
    ({"controller": es.StateFeedback([[1.0]], reference_gain=[[1.0]])}, "feeds back 1 states, but the estimator has 2 states"),
    ({"controller": es.GainReconfiguration(LAW)}, "needs an estimated gain, but the estimator has none"),
    ({"controller": es.StateFeedback}, "`controller` must be a controller"),
    ({"controller": es.StateFeedback(np.ones((2, 2)), reference_gain=np.ones((2, 1)))}, "has 2 inputs, but the plant has 1"),
    ({"plant": es.StateSpace(MODEL.A, MODEL.B, np.eye(2), [[1.0], [0.0]], R=MODEL.R, dt=0.5, **NAMES)}, "an algebraic loop"),
    ({"plant": 1.0}, "`plant` must be a ControlledPlant"),
    ({"input_link": es.BernoulliLink(0.5, acknowledged=False)}, "never acknowledges"),
    ({"dt": 0.1}, "must have the same step"),
    ({"plant": es.StateSpace(MODEL.A, MODEL.B, R=MODEL.R, dt=0.5, inputs=["force"])}, "needs the output 'place'"),
    ({"estimator": es.Kalman(es.StateSpace(MODEL.A, MODEL.B, R=MODEL.R, dt=0.5, outputs=NAMES["outputs"], inputs=["thrust"]))},
     r"must have the plant's inputs, 'force'\. It has 'thrust'"),
    ({"seed": -1}, "`seed` must be an integer"),
    ({"start": [1.0]}, r"`start` must be \(n,\) = \(2,\): the plant has 2 states"),
    ({"engine": "quick"}, "`engine` must be one of"),
])  # fmt: skip
def test_a_wrong_call_is_refused_in_one_sentence(given, sentence):
    with pytest.raises(es.InputError, match=sentence):
        run(**given)


def test_a_continuous_plant_needs_a_step():
    plant = es.ControlledPlant(f16.short_period(), actuator=20.0)
    with pytest.raises(es.InputError, match="`dt` must be given"):
        es.close_loop(plant, f16.law(), es.Kalman(f16.short_period()), reference=[1.0], seed=0, prior=PRIOR)


@pytest.mark.parametrize(("given", "sentence"), [
    ({"actuator": -1.0}, "`actuator` must be greater than 0"),
    ({"actuator": 20.0}, r"`model` must be continuous \(dt = 0\), because `actuator` moves"),
    ({"limits": (1.0, -1.0)}, "the first below the second"),
    ({"rate": 0.0}, "`rate` must be greater than 0"),
    ({"quantum": 0.0}, "`quantum` must be greater than 0"),
    ({"resolution": [0.1]}, r"`resolution` must be \(p,\) = \(2,\): the model has 2 outputs"),
    ({"events": [3.0]}, "`events` must be a list of Failure"),
    ({"events": [es.Failure(1.0, [0.5, 0.5])]}, "a Failure has 2 gains"),
    ({"events": [es.Change(1.0, es.StateSpace([[1.0]], [[1.0]], dt=0.5))]}, "as many states"),
    ({"model": es.StateSpace(MODEL.A, R=MODEL.R, dt=0.5)}, "must have an input"),
    ({"model": es.StateSpace(MODEL.A, MODEL.B, dt=0.5)}, "must have R"),
])  # fmt: skip
def test_a_plant_that_cannot_be_controlled_is_refused(given, sentence):
    with pytest.raises(es.InputError, match=sentence):
        es.ControlledPlant(**{"model": MODEL, **given})


def test_about_an_operating_point_every_signal_is_moved_by_it():
    x0, u0, y0 = np.array([3.0, -2.0]), np.array([1.5]), np.array([10.0, 20.0])
    point = {"states": x0, "inputs": u0, "outputs": y0}
    model = es.StateSpace(
        [[-0.2, 0.4], [-0.3, -0.5]], [[0.5], [1.0]], Q=0.01 * np.eye(2), R=np.diag([0.1, 0.2]), dt=0, **NAMES
    )
    absolute = es.StateSpace(model.A, model.B, Q=model.Q, R=model.R, dt=0, operating_point=point, **NAMES)
    law = {"feedback": [[0.2, 0.3]], "reference_gain": [[0.4]], "input_feedback": [[0.1]]}
    given = {"seed": 3, "dt": 0.5, "output_link": es.BernoulliLink(0.8)}
    side = es.Actuator(4.0, limits=(-0.25, 0.3), rate=0.5)
    about = run(es.ControlledPlant(model, actuator=side), es.StateFeedback(**law), es.Kalman(model), **given)
    side = es.Actuator(4.0, limits=(1.25, 1.8), rate=0.5)
    there = es.StateFeedback(**law, operating_point={"states": x0, "inputs": u0, "references": [7.0]})
    moved = run(es.ControlledPlant(absolute, actuator=side), there, es.Kalman(absolute), reference=REFERENCE + 7.0,
                start=x0, prior=es.Prior(x0, np.eye(2)), **given)  # fmt: skip
    for name, origin in (("state", x0), ("mean", x0), ("input", u0), ("command", u0), ("output", y0)):
        assert_allclose(getattr(moved, name) - origin, getattr(about, name), atol=1e-11, err_msg=name)
    assert about.applied.min() == -0.25


def test_about_an_operating_point_a_failure_takes_its_share_of_the_whole_position():
    model = es.StateSpace([[0.0]], [[1.0]], R=[[1.0]], dt=0, operating_point={"states": [5.0], "inputs": [2.0]})
    hold = es.StateFeedback([[0.0]], operating_point={"inputs": [2.0]})
    plant = es.ControlledPlant(model, actuator=50.0, events=[es.Failure(1.0, 0.8)])
    closed = es.close_loop(plant, hold, es.Kalman(model), reference=np.zeros((31, 0)), seed=1, dt=0.1, start=[5.0],
                           prior=es.Prior([5.0], [[1.0]]))  # fmt: skip
    assert_allclose(closed.state[:, 0], 5.0 - 0.4 * np.maximum(closed.t - 1.0, 0.0), atol=1e-12)
    deviations = es.StateSpace([[0.0]], [[1.0]], R=[[1.0]], dt=0)
    side = es.Actuator(50.0, operating_point=2.0, limits=(0.0, 2.1))
    plant = es.ControlledPlant(deviations, actuator=side, events=[es.Failure(1.0, 0.8), es.HardOver(2.0, "u1", 9.0)])
    same = es.close_loop(plant, es.StateFeedback([[0.0]]), es.Kalman(deviations), reference=np.zeros((31, 0)), seed=1,
                         dt=0.1, prior=es.Prior([0.0], [[1.0]]))  # fmt: skip
    assert_allclose(same.state[:21] + 5.0, closed.state[:21], atol=1e-12)
    assert_allclose(same.input[-1], 0.1, atol=1e-12)


def test_a_noisy_position_is_what_the_estimator_and_the_controller_receive():
    model = es.StateSpace([[-0.2]], [[1.0]], Q=[[0.01]], R=[[0.04]], dt=0)
    law = es.StateFeedback([[0.5]], reference_gain=[[1.0]], input_feedback=[[0.2]])
    given = {"reference": np.sin(0.05 * np.arange(400)), "seed": 1, "dt": 0.1, "prior": es.Prior([0.0], [[0.0]])}
    loops = {
        sigma: es.close_loop_bank(
            es.ControlledPlant(model, actuator=5.0, position_sigma=sigma), law, es.Kalman(model), runs=20, **given
        )
        for sigma in (None, 0.5)
    }
    closed = loops[0.5].runs
    noise = (closed.known_input - closed.input)[:, :, 0]
    assert abs(noise.std() - 0.5) < 0.02
    assert abs(np.mean(noise[:, 1:] * noise[:, :-1])) < 0.02
    read = given["reference"] - 0.5 * closed.info.mean[..., 0] - 0.2 * closed.known_input[..., 0]
    assert_allclose(closed.command[..., 0], read, atol=1e-12)
    for sigma, bank in loops.items():
        error, variance = (bank.runs.info.mean - bank.runs.state)[..., 0], bank.runs.info.covariance[..., 0, 0]
        assert 0.9 < np.mean(error[:, 50:] ** 2 / variance[:, 50:]) < 1.15, sigma


WINDOWED = es.StateSpace([[-0.2]], [[1.0]], Q=[[0.01]], R=[[0.04]], dt=0)
GAIN = es.UnknownGain(WINDOWED, es.Prior([1.0], [[4.0]]))


@pytest.mark.parametrize("estimator", [
    es.Kalman(WINDOWED), es.MovingWindow(es.Kalman(WINDOWED), 10), es.MovingWindow(GAIN, 20), es.Bounded(GAIN, -9.0, 9.0),
    es.ChangeDetection(GAIN, slots=4, levels=2, seconds_between_false_alarms=1e6),
], ids=["Kalman", "window", "window of a gain", "bounded gain", "detector"])  # fmt: skip
def test_the_noise_of_the_positions_is_counted_inside_wrappers(estimator):
    law = es.StateFeedback([[0.5]], reference_gain=[[1.0]])
    plant = es.ControlledPlant(WINDOWED, actuator=5.0, position_sigma=0.5)
    closed = es.close_loop_bank(
        plant,
        law,
        estimator,
        runs=40,
        reference=3 * np.sin(0.2 * np.arange(200)),
        seed=1,
        dt=0.1,
        prior=es.Prior([0.0], [[0.0]]),
    ).runs
    error, variance = (closed.info.mean - closed.state)[..., 0], closed.info.covariance[..., 0, 0]
    assert 0.85 < np.mean(error[:, 50::10] ** 2 / variance[:, 50::10]) < 1.2
    if closed.info.gain is not None:
        z = (closed.info.gain[:, 50::10, 0] - 1) / np.sqrt(closed.info.gain_covariance[:, 50::10, 0, 0])
        assert 0.8 < np.sqrt(np.mean(z**2)) < 1.25


def test_the_noise_of_a_position_that_enters_y_is_refused():
    model = es.StateSpace([[-0.2]], [[1.0]], [[1.0]], [[0.5]], Q=[[0.01]], R=[[0.04]], dt=0)
    plant = es.ControlledPlant(model, actuator=5.0, position_sigma=0.5)
    with pytest.raises(es.InputError, match=r"`position_sigma`: the input enters .* in y and in the state at once"):
        es.close_loop(plant, es.StateFeedback([[0.5]]), es.Kalman(model), reference=np.zeros((5, 0)), seed=1, dt=0.1,
                      prior=es.Prior([0.0], [[0.0]]))  # fmt: skip
