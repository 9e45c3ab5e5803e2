"""Each plant linearises, simulates in open and closed loop, and runs as machine code; its physics is checked independently."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import estimable as es
from estimable.frozen import replace
from estimable.models.schedule import last_known
from estimable.plants import multirotors, tanks

LINEAR = {"dc_motor": 0.05, "quarter_car": 0.005, "f16_lateral": 0.02, "multirotor": 0.004}


@pytest.mark.parametrize("name", LINEAR)
def test_a_linear_plant_is_simulated_and_estimated_as_machine_code(name):
    model, dt = getattr(es.plants, name)(), LINEAR[name]
    u = np.tile([] if model.operating_point is None else model.operating_point.inputs, (200, 1))
    u = u if u.size else np.sign(np.sin(np.arange(200)[:, None] / np.arange(7, 7 + model.m)))
    drawn = es.simulate(model, u, seed=1, dt=dt)
    prior = es.Prior(np.zeros(model.n), 1e-12 * np.eye(model.n))
    found = es.estimate(es.Kalman(model), drawn.record, prior=prior)
    assert found.engine == "native"
    nis = es.diagnostics.nis(found.innovation, found.innovation_covariance)
    assert nis.consistent


FOLLOWING = {  # the tracked states, the cost of the inputs, and the goal
    "f16_lateral": ([0, 1], 1.0, [1.0, 2.0]),
    "dc_motor": ([1], 0.01, [1.0]),
    "quarter_car": ([0], 1e-9, [0.2]),
}


@pytest.mark.parametrize("name", FOLLOWING)
def test_a_linear_plant_follows_in_a_closed_loop(name):
    model, dt = getattr(es.plants, name)(), LINEAR[name]
    tracked, cost, goal = FOLLOWING[name]
    weights = np.diag([10.0 if i in tracked else 0.01 for i in range(model.n)])
    F = es.lqr_gain(model, weights, cost * np.eye(model.m)).feedback
    M = np.eye(model.n)[tracked]
    N = np.linalg.inv(M @ np.linalg.solve(model.B @ F - model.A, model.B))
    law = es.StateFeedback(F, reference_gain=N)
    plant = es.ControlledPlant(model, actuator=50.0)
    prior = es.Prior(np.zeros(model.n), 1e-9 * np.eye(model.n))
    flown = es.close_loop(plant, law, es.Kalman(model), reference=np.tile(goal, (400, 1)), seed=1, prior=prior, dt=dt)
    assert np.allclose(flown.state[-1, tracked], goal, atol=0.15 * np.max(goal) / len(goal))
    assert flown.engine == "native"


def test_an_active_suspension_calms_the_body_on_a_rough_road():
    """The body velocity is fed back, as a damper between the body and the sky."""
    car = es.plants.quarter_car()
    given = {"reference": np.zeros((2000, 0)), "seed": 1, "dt": 0.005, "prior": es.Prior(np.zeros(4), 1e-9 * np.eye(4))}
    plant, watch = es.ControlledPlant(car, actuator=100.0), es.Kalman(car)
    passive, active = (
        es.close_loop(plant, es.StateFeedback([[0.0, damper, 0.0, 0.0]]), watch, **given) for damper in (0.0, 4000.0)
    )
    assert active.state[:, 1].std() < 0.5 * passive.state[:, 1].std()


def loop_of(plant, weights, cost, reference, tracked, dt, seed=1):
    """A plant of the tests under its linear-quadratic law."""
    model = plant.linear.model
    F = es.lqr_gain(model, np.diag(weights), cost * np.eye(model.m)).feedback
    M = np.eye(model.n)[tracked]
    N = np.linalg.pinv(M @ np.linalg.solve(model.B @ F - model.A, model.B))
    prior = es.Prior(np.zeros(model.n), 1e-9 * np.eye(model.n))
    law = es.StateFeedback(F, reference_gain=N)
    return es.close_loop(plant, law, es.Kalman(model), reference=reference, seed=seed, prior=prior, dt=dt)


def test_the_pendulum_is_held_upright_while_the_cart_moves():
    plant = es.plants.NonlinearPlant(es.plants.pendulum(), np.zeros(4), [0.0], actuator=50.0)
    flown = loop_of(plant, [100.0, 1.0, 100.0, 1.0], 0.1, np.full((600, 1), 0.2), [0], 0.01)
    assert abs(flown.state[-1, 0] - 0.2) < 0.02
    assert np.abs(flown.state[:, 2]).max() < 0.3


def test_without_friction_and_force_the_pendulum_keeps_its_energy():
    model = es.plants.pendulum(friction=0.0, force_density=0.0, substeps=2)
    start = es.Prior([0.0, 0.0, 2.0, 0.0], np.zeros((4, 4)))
    x = es.simulate(model, np.zeros((1500, 1)), seed=1, dt=0.001, prior=start).state
    M, m, reach, own, g = 0.5, 0.2, 0.3, 0.006, 9.81
    kinetic = (M + m) * x[:, 1] ** 2 / 2 - m * reach * x[:, 1] * x[:, 3] * np.cos(x[:, 2])
    energy = kinetic + (own + m * reach**2) * x[:, 3] ** 2 / 2 + m * g * reach * np.cos(x[:, 2])
    assert np.ptp(x[:, 2]) > 1.0
    assert np.ptp(energy) < 1e-9


def test_the_tanks_keep_the_mass():
    """The water in the tanks changes by what flows in less what flows out, integrated with the levels."""
    import jax.numpy as jnp

    def f(x, u, θ):
        into, _, out, leak1, leak2 = tanks.flows(x, u, θ)
        return jnp.concatenate([tanks.levels_change(x, u, θ), jnp.stack([into - out - leak1 - leak2])])

    sick = es.plants.two_tanks(leak1=1.0, leak2=0.5, blockage=0.8, pump=0.7, valve=0.9)
    model = es.NonlinearModel(
        f, lambda x, u, θ: x, Q=np.zeros((3, 3)), R=np.eye(3), dt=0, states=["h1", "h2", "net"], inputs=["pump", "valve"],
        parameters=dict(zip(sick.parameter_names, sick.parameters.tolist(), strict=True)), substeps=2,
    )  # fmt: skip
    levels, inputs = tanks.equilibrium()
    u = np.tile(inputs, (900, 1)) * (1 + 0.3 * np.sign(np.sin(np.arange(900)[:, None] / [30, 47])))
    x = es.simulate(model, u, seed=1, dt=2.0, prior=es.Prior([*levels, 0.0], np.zeros((3, 3)))).state
    water = x[:, :2] @ tanks.AREAS
    assert np.ptp(water) > 100
    assert np.abs(water - water[0] - x[:, 2]).max() < 1e-9


def test_a_tank_drains_as_torricelli_says():
    model = es.plants.two_tanks(flow_density=0.0, substeps=2)
    t = np.arange(400) * 0.1
    x = es.simulate(model, np.zeros((400, 2)), seed=1, dt=0.1, prior=es.Prior([8.0, 0.0], np.zeros((2, 2)))).state
    exact = (np.sqrt(8.0) - tanks.HOLES[0] * np.sqrt(2 * tanks.GRAVITY) * t / (2 * tanks.AREAS[0])) ** 2
    assert np.abs(x[:, 0] - exact).max() < 1e-9
    empty = es.simulate(model, np.zeros((400, 2)), seed=1, dt=2.0, prior=es.Prior([1.0, 1.0], np.zeros((2, 2)))).state
    assert np.all(np.isfinite(empty))
    assert np.abs(empty[-1, 0]) < 0.01


def test_the_tanks_follow_their_set_point_and_a_leak_lowers_them():
    levels, inputs = tanks.equilibrium()
    reference = np.tile([1.0], (300, 1))
    ends = {}
    for name, changes in (("healthy", ()), ("leak", [(300.0, {"leak2": 5.0})])):
        plant = es.plants.NonlinearPlant(
            es.plants.two_tanks(), levels, inputs, actuator=1.0, limits=[[0.0, 0.5], [30.0, 1.0]], changes=changes
        )
        ends[name] = loop_of(plant, [0.1, 10.0], 1.0, reference, [1], 2.0).state[-1, 1]
    assert abs(ends["healthy"] - 1.0) < 0.1
    assert ends["leak"] < ends["healthy"] - 0.2


def test_in_a_loop_with_a_simulator_an_estimator_follows_a_measured_output_or_a_given_course():
    """As over the record: also where the channel is lost, and with the course in place of the measurement."""
    levels, inputs = tanks.equilibrium()
    plant = es.plants.NonlinearPlant(
        es.plants.two_tanks(), levels, inputs, actuator=1.0, limits=[[0.0, 0.5], [30.0, 1.0]], noisy=True
    )
    near, channel = plant.linear.model, plant.linear.model.outputs[1]

    def at(level):
        return {"A": near.A * (1 - 0.1 * level)}

    model = replace(near, schedule=es.StateSpace(near.A, dt=0, R=near.R, schedule={channel: at}).schedule)
    F = es.lqr_gain(near, np.diag([0.1, 10.0]), np.eye(2)).feedback
    law, prior = es.StateFeedback(F, reference_gain=F[:, 1:]), es.Prior(np.zeros(2), 0.01 * np.eye(2))
    given = {"reference": np.ones((40, 1)), "seed": 1, "prior": prior, "dt": 2.0, "output_link": es.BernoulliLink(0.7)}
    flown = es.close_loop(plant, law, es.Kalman(model), **given)
    record = es.Record(
        flown.output, flown.known_input, dt=2.0, hold="first_order", inputs=near.inputs, outputs=near.outputs
    )
    offline = es.estimate(es.Kalman(model), record, prior=prior)
    assert 5 < np.isnan(flown.output[:, 1]).sum() < 20
    assert np.allclose(flown.mean, offline.mean, atol=1e-10)
    assert np.abs(flown.mean - es.estimate(es.Kalman(near), record, prior=prior).mean).max() > 1e-3
    course = {channel: last_known(flown.output[:, 1])}
    assert np.allclose(
        es.close_loop(plant, law, es.Kalman(model), schedule=course, **given).mean, flown.mean, atol=1e-10
    )
    bank = es.close_loop_bank(plant, law, es.Kalman(near), runs=2, **given)
    assert np.array_equal(bank[0].state, es.close_loop(plant, law, es.Kalman(near), **given).state)
    assert np.abs(bank[1].state - bank[0].state).max() > 0.01  # each run has its own noise
    with pytest.raises(es.InputError, match="must not be a list of simulators"):
        es.close_loop_bank([plant, plant], law, es.Kalman(near), **given)


def test_nonlinear_plants_are_filtered_as_machine_code():
    levels, inputs = tanks.equilibrium()
    for model, x, u, dt in (
        (es.plants.two_tanks(), levels, inputs, 2.0),
        (es.plants.pendulum(), [0, 0, np.pi, 0], [0.0], 0.01),
    ):
        drawn = es.simulate(model, np.tile(u, (100, 1)), seed=1, dt=dt, prior=es.Prior(x, np.zeros((len(x), len(x)))))
        prior = es.Prior(x, 1e-12 * np.eye(len(x)))
        found = es.estimate(es.ExtendedKalman(model), drawn.record, prior=prior, engine="native")
        assert np.abs(found.mean - drawn.state).max() < 1.0


@pytest.mark.parametrize("rotors", [4, 6, 8])
def test_at_hover_the_flight_of_a_multirotor_is_its_linear_model(rotors):
    own = multirotors.frame(rotors)
    assert np.allclose(own.mixer @ own.hover, [0, 0, 0, 2.0 * 9.81], atol=1e-12)
    near = multirotors.flight(rotors).linearised(np.zeros(12), own.hover)
    model = es.plants.multirotor(rotors, attitude=True)
    for name in "ABCD":
        assert np.allclose(getattr(near, name), getattr(model, name), atol=1e-12), name
    assert np.allclose(near.operating_point.outputs, model.operating_point.outputs)
    assert np.linalg.matrix_rank(own.mixer) == 4


def test_the_vibration_is_a_line_at_the_speed_of_the_rotors():
    model, hover = multirotors.flight(4, vibration=True), multirotors.frame(4).hover
    turning = np.asarray(model.f(np.zeros(16), hover, np.ones(4)))[12:]
    assert np.allclose(turning, 757.0, rtol=0.001)
    start = np.zeros(16)
    forces = [
        float(model.h(start + np.r_[np.zeros(12), turning * t], hover, np.ones(4))[3]) for t in np.arange(300) / 7001
    ]
    assert np.var(forces) == pytest.approx((4 * 0.4) ** 2 / 2, rel=0.05)  # four lines of .4 m/s², in phase


def test_in_free_fall_a_multirotor_keeps_its_angular_momentum_and_its_energy():
    model = replace(multirotors.flight(6, inertia=(0.02, 0.03, 0.04)), Q=np.zeros((4, 4)))
    start = np.zeros(12)
    start[:3] = 1.0, 0.3, -0.5
    x = es.simulate(model, np.zeros((600, 6)), seed=1, dt=0.001, prior=es.Prior(start, np.zeros((12, 12)))).state
    turned = [Rotation.from_euler("ZYX", [yaw, pitch, roll]) for roll, pitch, yaw in x[:, 3:6]]
    momentum = np.array([one.apply([0.02, 0.03, 0.04] * ω) for one, ω in zip(turned, x[:, :3], strict=True)])
    assert np.ptp(x[:, 3]) > 0.3
    assert np.abs(momentum - momentum[0]).max() < 1e-9
    assert np.ptp(x[:, :3] ** 2 @ [0.02, 0.03, 0.04]) < 1e-9
    height, rise = (x[:, model.states.index(name)] for name in ("height", "vertical_speed"))
    assert np.ptp(rise**2 / 2 + 9.81 * height) < 1e-9


def hexarotor(changes=(), noisy=False):
    """A hexarotor in flight, its law, and the model of its estimator, without the accelerometer."""
    own, model = multirotors.frame(6), es.plants.multirotor(6, attitude=True)
    seen = [0, 1, 2, 4, 5, 6, 7]
    known = es.StateSpace(
        model.A, model.B, model.C[seen], G=model.G, Q=model.Q, R=model.R[np.ix_(seen, seen)], dt=0, states=model.states,
        inputs=model.inputs, outputs=[model.outputs[i] for i in seen],
    )  # fmt: skip
    weights = np.diag([1.0, 1, 1, 100, 100, 20, 5, 20, 0, 0, 0, 0])
    F = es.lqr_gain(model, weights, 0.5 * np.eye(6)).feedback
    law = es.StateFeedback(F, reference_gain=F[:, [3, 4, 5, 7]])
    plant = es.plants.NonlinearPlant(
        multirotors.flight(6), np.zeros(12), own.hover, actuator=1 / multirotors.TIME_CONSTANT, limits=[0.0, 8.55],
        changes=changes, noisy=noisy,
    )  # fmt: skip
    return plant, law, es.Kalman(known), es.Prior(np.zeros(12), 1e-6 * np.eye(12))


def test_the_hexarotor_hovers_tracks_attitude_and_loses_a_motor():
    reference = np.zeros((500, 4))
    reference[200:, 0] = 0.2
    plant, law, estimator, prior = hexarotor(noisy=True)
    flown = es.close_loop(plant, law, estimator, reference=reference, seed=1, prior=prior, dt=0.005)
    roll, pitch, height = (flown.state[:, plant.model.states.index(name)] for name in ("roll", "pitch", "height"))
    assert np.abs(height[:200]).max() < 0.1
    assert np.abs(np.stack([roll, pitch])[:, :200]).max() < 0.05
    assert abs(roll[-100:].mean() - 0.2) < 0.02
    lost, *_ = hexarotor(changes=[(1.0, {"motor3": 0.0})])
    fallen = es.close_loop(lost, law, estimator, reference=np.zeros((300, 4)), seed=1, prior=prior, dt=0.005)
    assert np.abs(fallen.state[:200, :2]).max() < 0.2 < np.abs(fallen.state[200:, :2]).max()
    assert fallen.input[-1, 5] < -2.0  # the law stops the motor opposite to the lost one
    assert np.abs(fallen.state[:, 3:5]).max() < 0.5


WRONG_PLANTS = {
    "`rotors` must be 4, 6 or 8. Got 5": lambda: es.plants.multirotor(5),
    "it cannot hover": lambda: es.plants.multirotor(4, mass=10.0),
    "`layout` must be one of": lambda: es.plants.multirotor(layout="y"),
    "`inertia` must be positive": lambda: es.plants.multirotor(inertia=(0.0, 1.0, 1.0)),
    "`arm` must be greater than 0": lambda: multirotors.flight(arm=0.0),
    "`leak1` must be at least 0": lambda: es.plants.two_tanks(leak1=-1.0),
    "`level` must be greater than 0 cm": lambda: tanks.equilibrium(0.0),
    "`valve` must be at most 1": lambda: tanks.equilibrium(valve=2.0),
    "`resistance` must be greater than 0": lambda: es.plants.dc_motor(resistance=0.0),
    "`length` must be greater than 0": lambda: es.plants.pendulum(length=0.0),
    "`speed` must be greater than 0": lambda: es.plants.quarter_car(speed=0.0),
    "`road` must be one of": lambda: es.plants.quarter_car(road="E"),
    "`sigma` must be at least 0": lambda: es.plants.f16_lateral(sigma=-1.0),
    "must be an equilibrium": lambda: es.plants.NonlinearPlant(es.plants.pendulum(), [0, 0, 1, 0], [0.0], actuator=1.0),
    "no parameter 'leak'": lambda: es.plants.NonlinearPlant(
        es.plants.two_tanks(), *tanks.equilibrium(), actuator=1.0, changes=[(1.0, {"leak": 1.0})]
    ),
}


@pytest.mark.parametrize("words", WRONG_PLANTS)
def test_a_wrong_plant_is_one_sentence(words):
    with pytest.raises(es.InputError) as error:
        WRONG_PLANTS[words]()
    assert words in str(error.value)
