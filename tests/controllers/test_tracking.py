"""Tracking: the printed law, what it is where it does not apply, and the published loops."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import estimable as es
from estimable.kernels import tracking_law as kernel

PARAMETERS = np.array([-0.3, 0.6, 0.5, 0.2, 0.34])  # Fang (2009), §4.5
NOISE = 0.05**2
PRIOR = es.Prior(np.ones(5), np.eye(5))
JOINT = es.JointOutputError(2, 2, noise_variance=NOISE, prior=PRIOR)
ROWS = 3001


def square(rows, half=500):
    return (-1.0) ** (np.arange(rows) // half + 1)


def fang(factor=1.0):
    return es.OutputError(factor * PARAMETERS[:2], factor * PARAMETERS[2:], noise_variance=NOISE, dt=1)


def loops(arrival, tracking=None, **given):
    plant = es.ControlledPlant(fang(), events=[es.Change(2500.0, fang(1.5))])
    return es.close_loop_bank(
        plant, tracking or es.Tracking(2, 2), JOINT, reference=square(ROWS), seed=1, runs=40, prior=None,
        output_link=es.BernoulliLink(arrival), **given,
    )  # fmt: skip


def rms(bank, first, last):
    """Of y - r with the noise of y, over all runs, whether y arrived or not."""
    error = bank.runs.state[:, first + 1 : last + 1, 0] - square(ROWS)[first:last]
    return np.sqrt(np.mean(error**2) + NOISE)


def follow(plant, tracking, identifier, reference, **given):
    flown = es.close_loop(plant, tracking, identifier, reference=reference, seed=3, prior=None, **given)
    return flown, flown.state[1:, 0]


def told(a, b, past_outputs, past_inputs, **extra):
    """What an identifier that is sure says before a sample."""
    extra = {"completed": np.zeros(1), "seen": np.zeros(1), **extra}
    extra = {"past_outputs": np.array([past_outputs]), "past_inputs": np.array([past_inputs]), **extra}
    return es.results.Info(mean=np.append(a, b), covariance=np.zeros((len(a) + len(b),) * 2), extra=extra)


@pytest.mark.parametrize("law", ["mirrored", "inverse"])
def test_it_is_the_printed_law(law):
    a, b, x, u, r = [-0.3, 0.6], [0.5, 0.2, 0.34], [0.7, -0.4], [1.1, 0.3], 0.8
    tracking = es.Tracking(2, 2, law=law, reach=100.0)
    command = tracking.act(tracking.init(), told(a, b, x, u), np.array([r]))[1]
    assert_allclose(command, [(r + np.dot(a, x) - np.dot(b[1:], u)) / b[0]])  # (4.15)


def test_measured_feedback_takes_the_outputs_that_came():
    tracking = es.Tracking(1, 0, feedback="measured")
    known = told([-0.5], [2.0], [9.0], [], completed=np.array([0.3]), seen=np.ones(1))
    assert_allclose(tracking.act(tracking.init(), known, np.array([1.0]))[1], [(1.0 - 0.5 * 0.3) / 2.0])


def test_zeros_outside_are_mirrored_and_the_static_gain_stays():
    for b in ([0.5, 0.8, 0.0], [1.0, -3.0, 2.5], [0.0, 1.0, 0.2], [1.0, 0.2, -0.1]):
        found = kernel.mirrored(np.array(b), np.zeros((3, 3)))
        used = np.asarray(found.coefficients)
        assert np.all(np.abs(np.roots(used)) < 1)
        assert_allclose(used.sum(), np.sum(b), rtol=1e-12)
        inside = bool(b[0] != 0 and np.all(np.abs(np.roots(b)) < 1))
        assert bool(found.minimum_phase) == inside
        assert not inside or np.all(used == b)


def test_a_divisor_is_not_nearer_to_zero_than_what_is_known_of_it():
    b = np.array([0.01, 0.0])
    assert_allclose([kernel.guarded(x, 0.04, b, 0.0) for x in (0.01, -0.01, 0.5)], [0.1, -0.1, 0.5])
    assert_allclose(kernel.guarded(0.01, 0.0, b, 0.2), 0.2)


def test_the_estimate_is_the_one_offline_from_what_arrived():
    links = {"input_link": es.BernoulliLink(0.8), "output_link": es.BernoulliLink(0.7)}
    flown, _ = follow(fang(), es.Tracking(2, 2), JOINT, square(120, 40), **links)
    record = es.Record(flown.output, flown.applied, dt=1)
    path = es.identify(JOINT, record).path
    assert_allclose(flown.info.mean, path.mean, rtol=1e-9, atol=1e-9)
    assert np.all(flown.applied[flown.arrived[:, 0] == 0] == 0)


def test_before_and_after_a_jump_it_reaches_what_is_possible():
    bank = loops(0.65)
    assert rms(bank, 1500, 2500) < 0.0515
    assert rms(bank, 2600, 3000) < 0.053
    assert np.abs(bank.runs.state[:, :, 0]).max() < 10


def test_with_few_outputs_no_draw_is_lost():
    bank = loops(0.3)
    assert rms(bank, 1500, 2500) < 0.07
    assert rms(bank, 2600, 3000) < 0.07
    assert np.abs(bank.runs.state[:, :, 0]).max() < 10


def test_measured_feedback_has_the_variance_of_the_law_as_printed():
    """sqrt(r_v (1 + γ Σ a_i²)) in the place of sqrt(r_v)."""
    bank = loops(0.85, es.Tracking(2, 2, feedback="measured"))
    assert_allclose(rms(bank, 1500, 2500), np.sqrt(NOISE * (1 + 0.85 * np.sum(PARAMETERS[:2] ** 2))), rtol=0.02)


def test_a_disturbance_is_rejected_by_filtered_feedback_and_not_by_the_models():
    a, b = -0.6, 1.0
    model = es.StateSpace([[-a]], [[1.0]], [[-a * b]], [[b]], Q=[[0.05**2]], R=[[1e-4]], dt=1)
    identifier = es.JointOutputError(1, 0, noise_variance=1e-4, prior=es.Prior([a, b], np.zeros((2, 2))), alarm=1e9)
    told = {}
    for feedback in ("model", "filtered"):
        law = es.Tracking(1, 0, feedback=feedback, noise_ratio=20.0)
        flown = es.close_loop(model, law, identifier, reference=np.zeros(400), seed=1, prior=None)
        told[feedback] = np.std(flown.output)
    assert told["filtered"] < 0.85 * told["model"]


def test_a_plant_with_a_zero_outside_is_followed_by_the_mirrored_law_only():
    plant = es.OutputError([-0.8, 0.15], [0.5, 0.8], noise_variance=1e-4, dt=1)
    identifier = es.JointOutputError(2, 1, noise_variance=1e-4)
    flown, x = follow(plant, es.Tracking(2, 1), identifier, square(600, 100))
    assert np.all(np.abs(x[[90, 190, 290, 390, 490]] - square(600, 100)[[90, 190, 290, 390, 490]]) < 0.02)
    assert not flown.control["minimum_phase"][-1, 0]
    with pytest.raises(es.InputError, match=r'"inverse" cancels the zeros of the plant, but one lies at -1.6'):
        follow(plant, es.Tracking(2, 1, law="inverse"), identifier, square(600, 100))


def test_with_a_delay_the_reference_is_reached_so_much_later():
    plant = es.OutputError([-0.8, 0.15], [0.5, 0.2], delay=2, noise_variance=1e-6, dt=1)
    _, x = follow(
        plant, es.Tracking(2, 1, delay=2), es.JointOutputError(2, 1, delay=2, noise_variance=1e-6), square(600, 100)
    )
    assert np.abs(x[302:] - square(600, 100)[300:-3]).max() < 0.02


def test_two_inputs_bring_two_outputs_to_two_references():
    plant = es.OutputError([[-0.6], [-0.5]], [[[1.0], [0.2]], [[-0.3], [0.8]]], noise_variance=[1e-6, 1e-6], dt=1)
    prior = es.Prior([0.0, 1.0, 0.0, 0.0, 0.0, 1.0], np.eye(6))
    identifier = es.JointOutputError(1, 0, noise_variance=[1e-6, 1e-6], prior=prior, inputs=["u1", "u2"])
    reference = np.stack([np.sin(0.1 * np.arange(300)), square(300, 60)], axis=1)
    flown, _ = follow(plant, es.Tracking(1, 0, size=2, law="inverse"), identifier, reference,
                      output_link=es.BernoulliLink([0.7, 0.8]))  # fmt: skip
    assert np.abs(flown.state[101:] - reference[100:-1]).max() < 0.01


def test_nobody_tells_what_arrived_and_the_reference_is_followed_all_the_same():
    plant = es.OutputError([-0.6], [1.0], noise_variance=1e-4, dt=1)
    identifier = es.JointOutputError(1, 0, noise_variance=1e-4, prior=es.Prior([0.0, 1.0], np.eye(2)), arrival=0.8)
    link = es.BernoulliLink(0.8, acknowledged=False)
    flown, x = follow(plant, es.Tracking(1, 0), identifier, np.ones(300), input_link=link)
    came = flown.arrived[100:-1, 0] == 1
    assert np.median(np.abs(x[100:] - 1)[came]) < 0.1
    assert np.all(np.abs(flown.info.mean[-1] - plant.parameters) < 4 * np.sqrt(np.diagonal(flown.info.covariance[-1])))
    with pytest.raises(es.InputError, match="never acknowledges"):
        follow(plant, es.Tracking(1, 0), es.JointOutputError(1, 0, noise_variance=1e-4), np.ones(30), input_link=link)


def test_limits_are_kept_and_learnt_from():
    plant = es.OutputError([-0.6], [1.0], noise_variance=1e-4, dt=1)
    identifier = es.JointOutputError(1, 0, noise_variance=1e-4, prior=es.Prior([0.0, 1.0], np.eye(2)))
    flown, x = follow(plant, es.Tracking(1, 0, limits=(-0.5, 0.5)), identifier, square(200, 50))
    assert np.abs(flown.command).max() <= 0.5
    assert_allclose(x[[45, 95]], [-1.0, 1.0], atol=0.05)


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"feedback": "x"}, "`feedback` must be"),
        ({"law": "lq"}, "`law` must be"),
        ({"size": 2}, "is for one input and one output"),
        ({"reach": 0.0}, "`reach` must be"),
        ({"limits": (1.0, -1.0)}, "`limits` must be"),
    ],
)
def test_wrong_settings_are_refused(given, sentence):
    with pytest.raises(es.InputError, match=sentence):
        es.Tracking(2, 2, **given)


def test_what_does_not_fit_together_is_refused():
    with pytest.raises(es.InputError, match="na = 1, nb = 2, size = 1: 4 parameters for 1 output"):
        follow(fang(), es.Tracking(1, 2), JOINT, square(50))
    model = es.StateSpace([[0.5]], [[1.0]], Q=[[0.0]], R=[[0.1]], dt=1)
    with pytest.raises(es.InputError, match="acts on a prediction, but the estimator does not report one"):
        es.close_loop(
            model, es.Tracking(1, 0), es.Kalman(model), reference=np.ones(5), seed=1, prior=es.Prior([0.0], [[1.0]])
        )
