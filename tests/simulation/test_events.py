"""Every event against a simulation of its own: a few lines of Runge-Kutta, cut where the motion changes its law."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import solve_ivp

import estimable as es

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
    return es.close_loop(plant, LAW, es.Kalman(noisy), reference=COMMANDS, seed=1, dt=DT, prior=PRIOR, engine="native", **given)


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
        self.push = lambda t: np.zeros(2)

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
        cuts = [start, *sorted(arrivals), end]
        z = np.concatenate([self.x, self.p])
        for a, b in zip(cuts[:-1], cuts[1:], strict=True):
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
