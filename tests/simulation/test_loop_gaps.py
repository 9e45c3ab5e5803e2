"""Closed loops in which a position, or an acknowledgement, is missing for a time: the estimator does what `online` does."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import estimable as es

DT, T = 0.1, 60
MODEL = es.StateSpace([[-0.2, 1.0], [-1.0, -0.5]], [[0.0], [2.0]], Q=1e-3 * np.eye(2), R=0.05 * np.eye(2), dt=0,
                      states=["angle", "rate"], inputs=["rudder"], outputs=["vane", "gyro"])  # fmt: skip
MOVED = es.ControlledPlant(MODEL, actuator=4.0, events=[es.SensorFault(2.0, "rudder", "dropout", until=4.0)])
HELD = es.ControlledPlant(MODEL.discretise(DT), events=MOVED.events)
LAW = es.StateFeedback([[0.3, 0.4]], reference_gain=[[0.6]])
PRIOR = es.Prior([0.0, 0.0], np.eye(2))
BRIDGE, BREAK, AUTO = (es.Gaps(how, diffusion=[2.0], spread=[1.0]) for how in ("bridge", "break", "auto"))
REFERENCE = np.sign(np.sin(1.3 * DT * np.arange(T)))


def estimator_of(plant, gain=False):
    model = plant.model if plant is HELD else MODEL
    return es.UnknownGain(model, es.Prior([1.0], [[0.1]])) if gain else es.Kalman(model)


def flown(plant, gaps, gain=False, runs=None, **given):
    given = {"reference": REFERENCE, "seed": 2, "prior": PRIOR, "gaps": gaps} | given
    given |= {} if plant is HELD else {"dt": DT}
    if runs is None:
        return es.close_loop(plant, LAW, estimator_of(plant, gain), **given)
    return es.close_loop_bank(plant, LAW, estimator_of(plant, gain), runs=runs, **given)


@pytest.mark.parametrize("plant", [MOVED, HELD], ids=["position", "acknowledgement"])
@pytest.mark.parametrize(
    ("gaps", "gain"), [(BRIDGE, True), (BREAK, True), (AUTO, False)], ids=["bridge", "break", "auto"]
)
def test_the_estimate_is_that_of_online(plant, gaps, gain):
    """From what the estimator received, sample by sample: NaN where it was told nothing."""
    closed, moving = flown(plant, gaps, gain), plant is MOVED
    lost = np.isnan(closed.known_input[:, 0])
    assert lost.sum() == 20
    assert_allclose(closed.known_input[~lost], closed.input[~lost], rtol=1e-12)
    running = es.online(
        estimator_of(plant, gain), prior=PRIOR, hold="first_order" if moving else "zero_order", gaps=gaps
    )
    for k in range(T):
        info = running.correct(closed.output[k])
        assert_allclose(info.mean, closed.mean[k], rtol=0, atol=1e-9)
        assert_allclose(info.covariance, closed.info.covariance[k], rtol=0, atol=1e-9)
        if k + 1 < T:
            end = {"u_end": closed.known_input[k + 1]} if moving else {}
            running.predict(closed.known_input[k], **end, dt=DT)


def test_the_errors_are_as_large_as_said_while_nothing_is_known():
    """Held over, the last position makes them far larger than said."""
    rows = slice(24, 41)
    bridged = flown(MOVED, BRIDGE, runs=60)
    error = bridged.runs.mean[:, rows] - bridged.runs.state[:, rows]
    P = bridged.runs.info.covariance[:, rows]
    nees = np.einsum("rki,rkij,rkj->rk", error, np.linalg.inv(P), error)
    assert 0.5 < nees.mean() / 2 < 1.3
    whole = flown(es.ControlledPlant(MODEL, actuator=4.0), BRIDGE, runs=60)
    assert np.all(P[:, -5:, 1, 1] > whole.runs.info.covariance[:, rows][:, -5:, 1, 1])
    assert np.all(P[:, -5:, 1, 1] < 0.05)  # the gyro is seen


def test_without_a_variance_the_state_restarts():
    closed = flown(MOVED, "auto")
    assert np.all(closed.info.covariance[25:38, 1, 1] > 0.045)  # of one sample of the gyro
    assert closed.info.covariance[-1, 1, 1] < 0.03


@pytest.mark.parametrize(("plant", "given", "sentence"), [
    (MOVED, {"gaps": "refuse"}, 'an input is not measured for a time (SensorFault): give gaps = "bridge", "break" or "auto".'),
    (MOVED, {"gaps": "bridge"}, "a bridge online needs the variance of the inputs per second"),
    (MOVED, {"gaps": es.Gaps("bridge", diffusion=[1.0, 2.0])}, "`diffusion` of the gaps must have 1 entry, one for each input."),
    (MOVED, {"gaps": BRIDGE, "output_link": es.DelayLink([0.5, 0.5], late="use")}, 'give late="drop".'),
])  # fmt: skip
def test_refusals(plant, given, sentence):
    with pytest.raises(es.InputError) as raised:
        flown(plant, **{"gaps": BRIDGE} | given)
    assert sentence in str(raised.value)


def test_only_a_dropout_of_an_input_is_possible():
    with pytest.raises(es.InputError, match="rudder"):
        es.ControlledPlant(MODEL, events=[es.SensorFault(2.0, "rudder", "bias", 1.0)])
