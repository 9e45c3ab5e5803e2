"""The nonlinear F-16: trimmed, linearised as it was before, and its elevator fails as it is told to."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

import estimable as es
from estimable.plants import f16, f16_in_jsbsim, jsbsim_f16

pytest.importorskip("jsbsim", reason="needs the extra flight (jsbsim)")
SHARED = Path(__file__).parents[2] / ".." / "shared" / "data" / "f16-model.toml"


@pytest.fixture(scope="module")
def aircraft():
    return jsbsim_f16.JsbsimF16(0.5, failure_time=0.0, sigma_alpha=1e-9, sigma_q=1e-9)


def test_level_flight_stays_level(aircraft):
    flight = aircraft.begin(0.01)
    for _ in range(100):
        flight.move(np.zeros(1), np.zeros(2))
    assert_allclose(flight.state, 0.0, atol=2e-3)
    assert_allclose(flight.input, 0.0, atol=1e-12)


def test_the_linear_model_is_that_of_the_recorded_flight(aircraft):
    if not SHARED.exists():
        pytest.skip("needs ../shared/data")
    recorded = es.read_model(SHARED)
    assert_allclose(aircraft.model.A, recorded.model.A, rtol=1e-3)
    assert_allclose(aircraft.model.B, recorded.model.B, rtol=2e-3)
    assert_allclose(aircraft.trim["elevator_deg"], recorded.model.operating_point.inputs[0], atol=2e-3)
    assert_allclose(aircraft.trim["alpha_deg"], recorded.model.operating_point.states[0], atol=2e-3)


def test_a_known_loss_about_the_trim_is_made_good_exactly(aircraft):
    """What the air sees is then what it sees of the healthy aircraft, nonlinear as it is."""
    model = aircraft.model
    healthy = jsbsim_f16.JsbsimF16(sigma_alpha=1e-9, sigma_q=1e-9)
    law = es.StateFeedback([[0.4, -0.9]], reference_gain=[[-1.2]])
    t = np.arange(60) / 100
    given = {
        "reference": 4 * f16.pitch_command(t),
        "seed": 1,
        "prior": es.Prior([0.0, 0.0], np.zeros((2, 2))),
        "dt": 0.01,
    }
    known = {K: es.UnknownGain(model, es.Prior([K], [[0.0]])) for K in (1.0, 0.5)}
    flown = es.close_loop(healthy, law, known[1.0], **given)
    made_good = es.close_loop(aircraft, es.GainReconfiguration(law), known[0.5], **given)
    failed = es.close_loop(aircraft, law, known[1.0], **given)
    assert flown.engine == "python"
    assert flown.state[-1, 1] > 2
    assert_allclose(made_good.state, flown.state, atol=1e-5)
    assert_allclose(made_good.input, 2 * flown.input, atol=1e-5)
    assert np.abs(failed.state - flown.state).max() > 0.5


def test_a_loss_of_the_whole_deflection_upsets_the_trim():
    lost = jsbsim_f16.JsbsimF16(0.5, failure_time=0.0, about="zero")
    flight = lost.begin(0.01)
    for _ in range(50):
        flight.move(np.zeros(1), np.zeros(2))
    elevator = 0.5 * -lost.trim["elevator_deg"]  # the missing half of the trim
    linear = es.StateSpace(lost.model.A, lost.model.B, dt=0).discretise(0.5)
    assert_allclose(flight.state, linear.B[:, 0] * elevator, rtol=0.1)
    assert flight.state[1] < -2


def test_the_upset_is_taken_back_by_the_law():
    model = jsbsim_f16.JsbsimF16().model
    law = f16_in_jsbsim.law(model)
    _, u, _ = law.act((), es.results.Info(mean=np.array([0.0, 0.0, 0.7])), np.zeros(1))
    assert_allclose(u, -0.7)
    closed = model.A - model.B @ law.feedback[:, :2]
    q = np.linalg.solve(-closed, model.B @ law.reference_gain)[1, 0]
    assert_allclose(q, 1.0)


@pytest.mark.parametrize(("given", "sentence"), [
    ({"about": "nose"}, "`about` must be one of 'trim', 'zero'"),
    ({"mach": -1.0}, "`mach` must be greater than 0"),
    ({"mach": 9.0}, "cannot be trimmed in level flight at Mach 9"),
])  # fmt: skip
def test_a_wrong_flight_is_refused(given, sentence):
    with pytest.raises(es.InputError, match=sentence):
        jsbsim_f16.JsbsimF16(**given)


def test_without_jsbsim_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "jsbsim", None)
    with pytest.raises(es.InputError, match=r"pip install 'estimable\[flight\]'"):
        jsbsim_f16.JsbsimF16()


def fly(events, about="trim", T=40):
    """Both worlds under the same commands: the linear model, and the simulator about its trim."""
    aircraft = jsbsim_f16.JsbsimF16(sigma_alpha=1e-9, sigma_q=1e-9, about=about, events=events)
    open_loop = es.StateFeedback(np.zeros((1, 2)), reference_gain=[[1.0]])
    noisy = es.StateSpace(aircraft.model.A, aircraft.model.B, R=np.eye(2), dt=0, states=f16.STATES, inputs=f16.INPUTS,
                          outputs=f16.OUTPUTS)  # fmt: skip
    given = {"reference": np.where(np.arange(T) < 20, 0.5, -0.5), "seed": 1, "dt": 0.01,
             "prior": es.Prior([0.0, 0.0], np.eye(2))}  # fmt: skip
    quiet = es.StateSpace(
        noisy.A, noisy.B, R=np.zeros((2, 2)), dt=0, states=f16.STATES, inputs=f16.INPUTS, outputs=f16.OUTPUTS
    )
    plant = es.ControlledPlant(quiet, actuator=aircraft.linear.actuator, events=aircraft.linear.events)
    return (es.close_loop(plant, open_loop, es.Kalman(noisy), **given) for plant in (plant, aircraft))


@pytest.mark.parametrize("events", [
    [es.Stuck(0.1, "elevator_deg"), es.Upset(0.05, {"pitch_rate": 8.0}, 0.2)],
    [es.ActuatorChange(0.05, "elevator_deg", rate=4.0, delay=0.026), es.Offset(0.1, "elevator_deg", 0.2)],
    [es.HardOver(0.1, "elevator_deg", 1.0), es.Gust(0.05, 0.4, 0.3), es.SensorFault(0.3, "alpha_deg", "bias", 1.0)],
    [es.Stuck(0.1, "elevator_deg", 0.3), es.Failure(0.2, 0.5)],
], ids=["stuck, upset", "change, offset", "hard-over, gust", "stuck at, failure"])  # fmt: skip
def test_the_simulator_takes_the_events_of_the_linear_model(events):
    """The elevators are those of the linear plant exactly, and the motion is that near the trim."""
    linear, simulated = fly(events)
    assert_allclose(simulated.input, linear.input, atol=1e-9)
    assert [type(event) for event in simulated.events] == [type(event) for event in linear.events]
    apart = np.abs(simulated.state - linear.state).max(axis=0) / np.abs(linear.state).max(axis=0)
    assert np.all(apart < 0.1), apart
    assert_allclose(simulated.output - simulated.state, linear.output - linear.state, atol=1e-6)


def test_events_that_the_simulator_cannot_take_are_refused_together():
    model = es.StateSpace(f16.A, f16.B, dt=0)
    with pytest.raises(es.InputError, match=r"cannot take a Change(.|\n)*acts on 'pitch_rate' only"):
        jsbsim_f16.JsbsimF16(events=[es.Change(1.0, model), es.Upset(1.0, [1.0, 0.0])])


def test_the_air_is_still_unless_turbulence_moves_it(aircraft):
    flight = aircraft.begin(0.01)
    for _ in range(20):
        flight.move(np.array([0.3]), np.ones(2))
    fdm = flight.simulator.fdm
    over_ground = np.degrees(np.arctan2(fdm["velocities/w-fps"], fdm["velocities/u-fps"]))
    assert_allclose(fdm["aero/alpha-deg"], over_ground, atol=1e-12)
    assert abs(fdm["atmosphere/total-wind-down-fps"]) < 1e-9


def test_the_simulator_flies_in_the_turbulence_of_the_linear_model():
    """The same seed gives the same gusts; the motion is that of the linear model near the trim, and the vane feels the air."""
    air = es.Turbulence(es.Dryden.at(6096.0, 275.0, severity="light"), {"alpha": "alpha"}, angle="deg")
    quiet = {"sigma_alpha": 1e-9, "sigma_q": 1e-9, "Q": np.zeros((2, 2))}
    rough = jsbsim_f16.JsbsimF16(**quiet, turbulence=air, events=[es.Offset(0.5, "elevator_deg", 0.2)])
    still = es.StateFeedback(np.zeros((1, 2)))
    known = es.StateSpace(rough.model.A, rough.model.B, R=np.eye(2), dt=0, inputs=f16.INPUTS, outputs=f16.OUTPUTS)
    given = {"reference": np.zeros((100, 0)), "seed": 3, "dt": 0.01, "prior": es.Prior([0.0, 0.0], np.eye(2))}
    linear, simulated = (es.close_loop(one, still, es.Kalman(known), **given) for one in (rough.linear, rough))
    assert_allclose(simulated.state[:, 2:], linear.state[:, 2:], atol=1e-12)
    apart = np.abs(simulated.state - linear.state).max(axis=0)[:2] / np.abs(linear.state).max(axis=0)[:2]
    assert np.all(apart < 0.1), apart
    vane = simulated.output[:, 0] - simulated.state[:, 0]
    assert_allclose(vane, np.degrees(simulated.state[:, 3] / 275.0), atol=1e-6)
    assert np.ptp(vane) > 0.02
    entry = {"pitch_rate": "q"}
    with pytest.raises(es.InputError, match="`turbulence` of the simulator must enter 'alpha' only"):
        jsbsim_f16.JsbsimF16(turbulence=es.Turbulence(air.dryden, entry, angle="deg"))
