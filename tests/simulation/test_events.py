"""Every event against a simulation of its own: a few lines of Runge-Kutta, cut where the motion changes its law."""

from itertools import pairwise

import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import solve_ivp

import estimable as es
from estimable.frozen import replace

DT, T = 0.1, 36
MODEL = es.StateSpace(
    [[-0.8, 1.0], [-2.0, -1.1]], [[0.3, 1.0], [2.0, -0.5]], [[1.0, 0.0], [0.5, 1.0]], [[0.0, 0.0], [0.2, 0.1]],
    Q=np.zeros((2, 2)), R=np.zeros((2, 2)), dt=0, states=["angle", "speed"], inputs=["left", "right"],
    outputs=["vane", "gyro"],
)  # fmt: skip
LAW = es.StateFeedback(np.zeros((2, 2)), reference_gain=np.eye(2))
PRIOR = es.Prior([0.0, 0.0], np.eye(2))
TIMES = DT * np.arange(T)
COMMANDS = np.stack([np.sign(np.sin(3.0 * TIMES + 0.1)), 0.8 * np.sin(2.0 * TIMES)], axis=1)
SIDES = {"left": es.Actuator(8.0, limits=(-0.9, 0.7), rate=3.0), "right": es.Actuator(5.0, delay=0.13)}


def fly(model=MODEL, events=(), actuator=SIDES, **given):
    noisy = es.StateSpace(model.A, model.B, model.C, R=np.eye(2), dt=0, states=model.states, inputs=model.inputs,
                          outputs=model.outputs)  # fmt: skip
    plant = es.ControlledPlant(model, actuator=actuator, events=events)
    given = {"engine": "native"} | given
    return es.close_loop(plant, LAW, es.Kalman(noisy), reference=COMMANDS, seed=1, dt=DT, prior=PRIOR, **given)


class World:
    """x' = A x + B e + push(t); p' = clip(b (c - p), -r, r), both by Runge-Kutta; the attributes are changed by hand."""

    def __init__(self, model=MODEL, actuators=SIDES):
        self.A, self.B, self.C, self.D = model.A, model.B, model.C, model.D
        sides = [actuators[name] for name in model.inputs]
        self.b = np.array([side.bandwidth for side in sides])
        self.r = np.array([np.inf if side.rate is None else side.rate for side in sides])
        self.limits = np.array([(-np.inf, np.inf) if side.limits is None else side.limits for side in sides]).T
        self.delay = np.array([side.delay for side in sides])
        self.gain, self.offset, self.about = np.ones(2), np.zeros(2), np.zeros(2)
        self.forced, self.x, self.p = [None, None], np.zeros(2), np.zeros(2)
        self.push, self.cuts = lambda t: np.zeros(2), ()

    def effect(self, p):
        return self.gain * (p + self.offset + self.about) - self.about

    def command(self, t):
        """What drives each actuator just after t."""
        rows = np.floor((t - self.delay) / DT + 1e-6).astype(int)
        c = [COMMANDS[row, i] if row >= 0 else 0.0 for i, row in enumerate(rows)]
        c = np.clip(c, *self.limits)
        return np.array([value if own is None else own for own, value in zip(self.forced, c, strict=True)])

    def rates(self, t, z, c):
        speed = np.clip(np.where(c == z[2:], 0.0, self.b) * (c - z[2:]), -self.r, self.r)
        speed[self.arrived] = 0.0
        return np.concatenate([self.A @ z[:2] + self.B @ self.effect(z[2:]) + self.push(t), speed])

    def advance(self, start, end):
        """To `end`, cut where a delayed command arrives and where an actuator leaves its rate limit."""
        arrivals = {start + f for f in np.mod(self.delay, DT) if 1e-9 < f < DT - 1e-9}
        cuts = [start, *sorted(arrivals | {cut for cut in self.cuts if start < cut < end}), end]
        z = np.concatenate([self.x, self.p])
        for a, b in pairwise(cuts):
            c = self.command(a)
            while a < b - 1e-13:
                self.arrived = np.isinf(self.b) & (np.abs(c - z[2:]) < 1e-12)
                limited = (np.abs(c - z[2:]) > self.r / self.b * (1 + 1e-10)) & ~self.arrived
                leaves = [a + abs(c[i] - z[2 + i]) / self.r[i] - 1 / self.b[i] for i in np.flatnonzero(limited)]
                stop = min([b, *leaves])
                ran = solve_ivp(self.rates, (a, stop), z, "DOP853", rtol=1e-13, atol=1e-14, args=(c,))
                a, z = stop, ran.y[:, -1]
        self.x, self.p = z[:2], z[2:]


def simulated(happens=(), world=None):
    """States, acting positions and outputs, with {row: what is done to the world}."""
    world, happens = world or World(), dict(happens)
    rows = []
    for k, t in enumerate(TIMES):
        happens.get(k, lambda world: None)(world)
        y = world.C @ world.x + world.D @ world.effect(world.p)
        rows.append((world.x, world.p + world.offset, y))
        world.advance(t, t + DT)
    return (np.array(part) for part in zip(*rows, strict=True))


def stuck(world):
    world.forced[0], world.b[0] = world.p[0], 1.0


def stuck_at(world):
    world.p = np.array([0.4, world.p[1]])
    world.forced[0], world.b[0] = 0.4, 1.0


def floating(world):
    world.forced[1], world.b[1], world.r[1] = 0.25, 1 / 0.3, np.inf


def hard_over(world):
    world.forced[0], world.b[0] = 0.7, np.inf


def changed(world):
    world.limits, world.b = np.array([[-0.3, -np.inf], [0.35, np.inf]]), np.array([8.0, 2.0])
    world.r[0], world.delay = 1.2, np.array([0.04, 0.2])


def failed(world):
    world.gain = np.array([0.4, 1.0])


def moved(world):
    world.offset = np.array([0.15, 0.0])


CASES = {
    "healthy": ([], {}),
    "stuck": ([es.Stuck(1.05, "left")], {11: stuck}),
    "stuck at": ([es.Stuck(1.1, "left", 0.4)], {11: stuck_at}),
    "two at once": ([es.Floating(1.3, "right", 0.25, 0.3), es.Failure(0.7, 0.4, "left")], {13: floating, 7: failed}),
    "hard-over": ([es.HardOver(1.1, "left", 5.0)], {11: hard_over}),
    "change": ([es.ActuatorChange(0.9, "left", limits=(-0.3, 0.35), rate=1.2, delay=0.04), es.Offset(0.3, "left", 0.15),
                es.ActuatorChange(0.9, "right", bandwidth=2.0, delay=0.2)], {9: changed, 3: moved}),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_an_actuator_event_is_what_an_integrator_makes_of_it(name):
    events, happens = CASES[name]
    closed = fly(events=events)
    x, p, y = simulated(happens)
    assert_allclose(closed.input, p, atol=1e-9)
    assert_allclose(closed.state, x, atol=1e-9)
    assert_allclose(closed.output, y, atol=1e-9)
    assert [type(event) for event in closed.events] == [type(event) for event in sorted(events, key=lambda e: e.time)]


def test_a_nonlinear_plant_takes_the_events_of_the_linear_one():
    """Its positions are exact; its state has the error of Runge-Kutta's steps. About inputs that are not zero."""
    rest = np.array([0.1, -0.2])
    A, B, C, D = (jnp.asarray(getattr(MODEL, name)) for name in "ABCD")
    world = es.NonlinearModel(
        lambda x, u, θ: A @ x + B @ (u - rest), lambda x, u, θ: C @ x + D @ (u - rest), Q=np.zeros((2, 2)), R=np.zeros((2, 2)),
        dt=0, states=MODEL.states, inputs=MODEL.inputs, outputs=MODEL.outputs, substeps=10,
    )  # fmt: skip
    events = [es.Failure(0.7, 0.4, "left"), es.Offset(0.3, "right", 0.15), es.ActuatorChange(0.9, "left", rate=1.2, delay=0.04),
              es.Upset(1.0, {"speed": 1.5}, until=1.3), es.HardOver(1.5, "left", 5.0), es.Floating(2.0, "right", 0.25, 0.3),
              es.Stuck(2.5, "left", 0.4), es.SensorFault(2.6, "vane", "bias", 0.3)]  # fmt: skip
    about = {name: replace(one, operating_point=rest[i]) for i, (name, one) in enumerate(SIDES.items())}
    plant = es.plants.NonlinearPlant(world, [0.0, 0.0], rest, actuator=SIDES, events=events)
    noisy = es.StateSpace(MODEL.A, MODEL.B, MODEL.C, R=np.eye(2), dt=0, inputs=MODEL.inputs, outputs=MODEL.outputs)
    linear = fly(events=events, actuator=about)
    closed = es.close_loop(plant, LAW, es.Kalman(noisy), reference=COMMANDS, seed=1, dt=DT, prior=PRIOR)
    assert closed.engine == "python"
    assert_allclose(closed.input, linear.input, atol=1e-9)
    assert_allclose(closed.state, linear.state, atol=1e-4)
    assert_allclose(closed.output, linear.output, atol=1e-4)
    with pytest.raises(es.InputError, match="takes no Change: give `changes`"):
        es.plants.NonlinearPlant(world, [0.0, 0.0], rest, actuator=SIDES, events=[es.Change(1.0, MODEL)])
    with pytest.raises(es.InputError, match="`limits` are those of the Actuator"):
        es.plants.NonlinearPlant(world, [0.0, 0.0], rest, actuator=SIDES, limits=(-1.0, 1.0))


def gust(t):
    return 0.6 * (1 - np.cos(2 * np.pi * (t - 1.05) / 0.83)) / 2 if 1.05 <= t < 1.88 else 0.0


def test_disturbances_are_what_an_integrator_makes_of_them():
    """An upset at a sample, and a gust that begins and ends between samples; the vane feels it, the gyro does not."""
    events = [es.Upset(0.7, {"speed": 1.5}, until=1.3), es.Upset(2.0, [0.2, 0.0]),
              es.Gust(1.05, 0.6, 0.83, state="speed", vanes=["vane"])]  # fmt: skip
    model = es.StateSpace(MODEL.A, MODEL.B, [[1.0, 0.7], [0.5, 1.0]], R=np.zeros((2, 2)), dt=0, states=MODEL.states,
                          inputs=MODEL.inputs, outputs=MODEL.outputs)  # fmt: skip
    world, steady = World(model), np.zeros(2)

    def push(t):
        return steady + world.A[:, 1] * gust(t)

    def upset(*by):
        def happen(world):
            steady[:] = by

        return happen

    world.push, world.cuts = push, (1.05, 1.88)
    x, p, y = simulated({7: upset(0.0, 1.5), 13: upset(0.0, 0.0), 20: upset(0.2, 0.0)}, world)
    closed = fly(model, events)
    y[:, 0] += [0.7 * gust(t) for t in TIMES]
    assert_allclose(closed.state, x, atol=1e-9)
    assert_allclose(closed.output, y, atol=1e-9)


def matrices(speed):
    """Those of `MODEL` at a speed, at which the vane also feels the speed."""
    own = {name: getattr(MODEL, name) for name in "ABCD"}
    return {
        "A": own["A"] * [[speed, 1.0], [speed**2, speed]],
        "B": own["B"] * speed**2,
        "C": own["C"] + [[0.0, speed], [0.0, 0.0]],
        "D": own["D"],
    }


COURSE = {"speed": 1 + 0.5 * np.sin(TIMES)}
FOLLOWING = es.StateSpace(
    **matrices(1.0), Q=np.zeros((2, 2)), R=np.zeros((2, 2)), dt=0, states=MODEL.states, inputs=MODEL.inputs,
    outputs=MODEL.outputs, schedule={"speed": matrices},
)  # fmt: skip


def test_a_scheduled_plant_is_what_an_integrator_makes_of_it():
    """With actuators at their rate limits and late, a failure, a gust, and another model from 2 s on: the same at half speed."""
    half = {"speed": {"at": [0.0, 2.0], **{name: [matrices(0.0)[name], matrices(1.0)[name]] for name in "BC"}}}
    after = es.StateSpace(**matrices(1.0), R=np.zeros((2, 2)), dt=0, states=MODEL.states, schedule=half)
    events = [
        es.Failure(0.7, 0.4, "left"),
        es.Gust(1.05, 0.6, 0.83, state="speed", vanes=["vane"]),
        es.Change(2.0, after),
    ]

    def at(k):
        def happen(world):
            now = after if k >= 20 else FOLLOWING
            now = now.along({"speed": float(COURSE["speed"][k])})
            world.A, world.B, world.C, world.D = now.A, now.B, now.C, now.D
            world.gain = np.array([0.4 if 7 <= k < 20 else 1.0, 1.0])

        return happen

    world = World(FOLLOWING)
    world.push, world.cuts = lambda t: world.A[:, 1] * gust(t), (1.05, 1.88)
    x, p, y = simulated({k: at(k) for k in range(T)}, world)
    y[:, 0] += [COURSE["speed"][k] * gust(t) for k, t in enumerate(TIMES)]
    for engine in ("native", "xla"):
        closed = fly(FOLLOWING, events, schedule=COURSE, engine=engine)
        assert_allclose(closed.input, p, atol=1e-9)
        assert_allclose(closed.state, x, atol=1e-9)
        assert_allclose(closed.output, y, atol=1e-9)
        assert closed.engine == engine
        assert_array_equal(closed.schedule["speed"], COURSE["speed"])


def test_sensors_read_what_their_faults_make_of_the_outputs():
    events = [es.SensorFault(0.5, "vane", "bias", 0.3, 1.5), es.SensorFault(1.0, "vane", "scale", 2.0, 2.0),
              es.SensorFault(2.05, "vane", "drift", -0.4, 2.5), es.SensorFault(2.7, "vane", "frozen"),
              es.SensorFault(0.3, "gyro", "dropout", until=0.6), es.SensorFault(0.9, "gyro", "dropout", 5.0, 1.2),
              es.SensorFault(1.4, "gyro", "noise", 0.2, 3.0)]  # fmt: skip
    closed, (_, _, y) = fly(events=events), simulated()
    vane = y[:, 0].copy()
    vane[5:15] += 0.3
    vane[10:20] *= 2.0
    vane[21:25] += -0.4 * (TIMES[21:25] - 2.05)
    vane[27:] = vane[26]
    assert_allclose(closed.output[:, 0], vane, atol=1e-9)
    gyro, quiet = closed.output[:, 1], np.r_[0:3, 6:9, 12:14, 30:T]
    assert np.isnan(gyro[3:6]).all()
    assert_array_equal(gyro[9:12], 5.0)
    assert_allclose(gyro[quiet], y[quiet, 1], atol=1e-9)
    assert 0.1 < np.std(gyro[14:30] - y[14:30, 1]) < 0.3
    record = es.Record(
        closed.output, closed.input, dt=DT, hold="first_order", inputs=MODEL.inputs, outputs=MODEL.outputs
    )
    noisy = es.StateSpace(MODEL.A, MODEL.B, MODEL.C, R=np.eye(2), dt=0, inputs=MODEL.inputs, outputs=MODEL.outputs)
    assert_allclose(closed.mean, es.estimate(es.Kalman(noisy), record, prior=PRIOR).mean, atol=1e-11)


def test_without_an_actuator_events_act_on_the_commands():
    """The position is held over each sample: stuck, floating and offset as sums over the samples."""
    model = es.StateSpace([[0.8]], [[0.5]], R=[[0.0]], dt=0.1, inputs=["pump"])
    law = es.StateFeedback([[0.0]], reference_gain=[[1.0]])
    noisy = es.Kalman(es.StateSpace([[0.8]], [[0.5]], R=[[1.0]], dt=0.1, inputs=["pump"]))
    events = [
        es.Stuck(0.5, "pump"),
        es.Floating(1.0, "pump", 0.2, 0.3),
        es.Offset(1.5, "pump", 0.1),
        es.Failure(1.5, 0.5),
    ]
    closed = es.close_loop(es.ControlledPlant(model, events=events), law, noisy, reference=COMMANDS[:20, 0], seed=1,
                           prior=es.Prior([0.0], [[1.0]]))  # fmt: skip
    p = COMMANDS[:20, 0].copy()
    p[5:10] = p[4]
    for k in range(10, 20):
        p[k] = 0.2 + (p[k - 1] - 0.2) * np.exp(-0.1 / 0.3)
    p[15:] += 0.1
    x = [0.0]
    for k in range(19):
        x.append(0.8 * x[-1] + 0.5 * p[k] * (0.5 if k >= 15 else 1.0))
    assert_allclose(closed.input[:, 0], p, atol=1e-12)
    assert_allclose(closed.state[:, 0], x, atol=1e-12)
    assert_array_equal(closed.known_input, closed.command)


NAMED = r"names the input 'lft', but the inputs are 'left', 'right'\. Did you mean 'left'\?"


@pytest.mark.parametrize(("wrong", "sentence"), [
    (lambda: es.Actuator(5.0, limits=(1.0, -1.0), rate=0.0), "the first below the second.*`rate` must be greater than 0"),
    (lambda: es.Actuator(0.0), "`bandwidth` must be greater than 0"),
    (lambda: es.Actuator(5.0, delay=-1.0), "`delay` must be at least 0 seconds"),
    (lambda: es.Stuck(-1.0, "left"), "`time` must be at least 0 seconds"),
    (lambda: es.ActuatorChange(1.0, "left"), "must change something"),
    (lambda: es.ActuatorChange(1.0, "left", rate=0.0), "`rate` must be greater than 0"),
    (lambda: es.ActuatorChange(1.0, "left", limits=(1.0, -1.0)), "the first below the second"),
    (lambda: es.ControlledPlant(MODEL, actuator=5.0, limits=(1.0, -1.0), rate=0.0), "`rate` must be .*the first below"),
    (lambda: es.SensorFault(1.0, "vane", "bias"), '`value` must be given for the kind "bias"'),
    (lambda: es.SensorFault(1.0, "vane", "broken", 1.0, until=0.5), "`until` must be after.*`kind` must be one of"),
    (lambda: es.Gust(1.0, 0.5, 0.0), "`seconds` must be greater than 0"),
    (lambda: fly(events=[es.Stuck(1.0, "lft"), es.SensorFault(1.0, "van", "frozen")]), NAMED + "(.|\n)*output 'van'"),
    (lambda: fly(events=[es.Upset(1.0, {"sped": 1.0})]), "names the state 'sped'"),
    (lambda: fly(events=[es.Gust(1.0, 0.5, 1.0, state="sped", vanes=["van"])]), "state 'sped'.*output 'van'"),
    (lambda: fly(events=[es.Upset(1.0, [1.0])]), r"`by` of an Upset must be \(n,\) = \(2,\)"),
    (lambda: fly(events=[es.Failure(1.0, 0.5, "lft")]), NAMED),
    (lambda: fly(actuator={"lft": es.Actuator(5.0)}), NAMED),
    (lambda: fly(actuator={"left": 5.0}), "must hold an Actuator for 'left'"),
    (lambda: es.ControlledPlant(MODEL, actuator=SIDES, rate=1.0), "are those of the Actuator"),
    (lambda: es.ControlledPlant(MODEL, position_sigma=0.1), "needs an `actuator`"),
    (lambda: fly(FOLLOWING), r"follow 'speed': give its course, schedule=\{'speed': values\}, one for each row of `reference`"),
    (lambda: fly(FOLLOWING, schedule=3), "`schedule` must be a mapping of channels"),
    (lambda: fly(FOLLOWING, schedule={"sped": 1.0}), "give its course.*has 'sped', but the loop follows 'speed'.*Did you mean"),
    (lambda: fly(schedule={"speed": 1.0}), "has 'speed', but the loop follows no channel"),
    (lambda: fly(FOLLOWING, schedule={"speed": [1.0, 2.0]}), r"`schedule of 'speed'` must be \(T,\) = \(36,\)"),
    (lambda: fly(FOLLOWING.along({"speed": [1.0, 2.0]})), "plant varies over 2 rows of time, but `reference` has 36 rows"),
])  # fmt: skip
def test_wrong_events_and_actuators_are_refused_in_a_sentence_each(wrong, sentence):
    with pytest.raises(es.InputError, match=f"(?s){sentence}"):
        wrong()


def test_a_filter_of_commands_moves_the_healthy_actuators_as_the_plant_does():
    """In the loop, over the record of commands, and over the record of their mean positions; delays, limits and rates known."""
    model = es.StateSpace(MODEL.A, MODEL.B, MODEL.C, MODEL.D, Q=0.1 * np.eye(2), R=0.01 * np.eye(2), dt=0, states=MODEL.states,
                          inputs=MODEL.inputs, outputs=MODEL.outputs)  # fmt: skip
    plant, direct = es.ControlledPlant(model, actuator=SIDES), es.StateSpace(
        model.A, model.B, model.C, Q=model.Q, R=model.R, dt=0, inputs=model.inputs, outputs=model.outputs)  # fmt: skip
    given = {"reference": COMMANDS, "seed": 1, "dt": DT, "prior": PRIOR}
    closed = es.close_loop(plant, LAW, es.Actuated(es.Kalman(model), SIDES), **given)
    assert_allclose(closed.extra["position"], closed.input, atol=1e-11)
    record = es.Record(closed.output, closed.command, dt=DT, inputs=MODEL.inputs, outputs=MODEL.outputs)
    offline = es.estimate(es.Actuated(es.Kalman(model), SIDES, start=[0.0, 0.0]), record, prior=PRIOR)
    assert_allclose(offline.mean, closed.mean, atol=1e-11)
    mean = es.through_actuators(record, SIDES, start=[0.0, 0.0])
    both = [es.estimate(es.Kalman(direct), mean, prior=PRIOR),
            es.estimate(es.Actuated(es.Kalman(direct), SIDES, start=[0.0, 0.0]), record, prior=PRIOR)]  # fmt: skip
    assert_allclose(both[0].mean, both[1].mean, atol=1e-12)
    z = (closed.mean - closed.state) / np.sqrt(np.diagonal(closed.info.covariance, axis1=1, axis2=2))
    assert np.sqrt(np.mean(z**2)) < 1.3


def test_banks_equal_single_runs_bit_for_bit_also_of_plants_with_different_events():
    model = es.StateSpace(MODEL.A, MODEL.B, MODEL.C, Q=0.1 * np.eye(2), R=0.01 * np.eye(2), dt=0, states=MODEL.states,
                          inputs=MODEL.inputs, outputs=MODEL.outputs)  # fmt: skip
    law = es.StateFeedback([[0.3, 0.1], [0.1, 0.2]], reference_gain=np.eye(2))
    happen = [[es.Stuck(1.0, "left")], [es.Stuck(0.4, "left")], [es.SensorFault(1.0, "gyro", "frozen")], []]
    plants = [es.ControlledPlant(model, actuator=SIDES, events=events) for events in happen]
    given = {"reference": COMMANDS, "seed": 5, "dt": DT, "prior": PRIOR, "engine": "native"}
    mixed = es.close_loop_bank(plants, law, es.Kalman(model), **given)
    alike = es.close_loop_bank(plants[1], law, es.Kalman(model), runs=9, **given)
    for i, plant in enumerate(plants):
        single = es.close_loop_bank(plant, law, es.Kalman(model), runs=1, first=i, **given)[0]
        for one in (mixed[i], alike[i]) if i == 1 else (mixed[i],):
            assert [type(event) for event in one.events] == [type(event) for event in plant.events]
            for name in ("state", "input", "output", "command", "mean", "covariance"):
                assert_array_equal(getattr(one, name), getattr(single, name), err_msg=name)
    with pytest.raises(es.InputError, match="`plant` is a list of 4, one for each run"):
        es.close_loop_bank(plants, law, es.Kalman(model), runs=3, **given)


def test_a_scheduled_estimator_in_a_loop_is_that_over_the_record_and_banks_equal_single_runs():
    noises = {"Q": 0.1 * np.eye(2), "R": 0.01 * np.eye(2)}
    model = es.StateSpace(**matrices(1.0), **noises, dt=0, states=MODEL.states, inputs=MODEL.inputs, outputs=MODEL.outputs,
                          schedule={"speed": matrices})  # fmt: skip
    plant = es.ControlledPlant(model, actuator=SIDES, events=[es.Failure(1.0, 0.5)])
    law = es.StateFeedback([[0.3, 0.1], [0.1, 0.2]], reference_gain=np.eye(2))
    estimator = es.UnknownGain(model, es.Prior([1.0], [[0.2]]))
    given = {"reference": COMMANDS, "seed": 5, "dt": DT, "prior": PRIOR, "schedule": COURSE}
    bank = es.close_loop_bank(plant, law, estimator, runs=9, engine="native", **given)
    single = es.close_loop_bank(plant, law, estimator, runs=1, first=8, engine="native", **given)[0]
    for name in ("state", "input", "output", "command", "mean", "gain", "gain_covariance"):
        assert_array_equal(getattr(bank[8], name), getattr(single, name), err_msg=name)
    channels = (*MODEL.outputs, "speed")
    record = es.Record(
        np.column_stack([single.output, COURSE["speed"]]), single.input, dt=DT, hold="first_order", inputs=MODEL.inputs,
        outputs=channels,
    )  # fmt: skip
    offline = es.estimate(estimator, record, prior=PRIOR)
    assert_allclose(single.gain, offline.gain, atol=1e-9)
    assert_allclose(single.mean, offline.mean, atol=1e-9)


def test_many_scheduled_loops_have_the_values_of_their_bank():
    plant = es.ControlledPlant(FOLLOWING, actuator=SIDES)
    noisy = es.Kalman(
        es.StateSpace(MODEL.A, MODEL.B, MODEL.C, R=np.eye(2), dt=0, inputs=MODEL.inputs, outputs=MODEL.outputs)
    )
    case = es.LoopCase(plant, LAW, noisy, reference=COMMANDS, prior=PRIOR, dt=DT, schedule=COURSE)
    found = es.monte_carlo_loops(case, runs=2, seed=1, summary=lambda closed: {"end": closed.state[-1]}, progress=False)
    assert_allclose(found[""].values["end"][0], fly(FOLLOWING, schedule=COURSE).state[-1], atol=1e-12)
