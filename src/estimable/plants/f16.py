"""The F-16's short period with a loop gain that drops in flight (A. G. Sillence 1999, ch. 3 and 5, errata corrected).

State (alpha [deg], pitch_rate [deg/s]), input the elevator deflection [deg]; the loop gain K multiplies b. The thesis
prints 1.2915 for M_alpha, where its pole table needs 3.5, and .3 for the gain on the actuator, where it needs -.4.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np

from .. import checks
from ..annotations import Array, Numbers
from ..controllers.proportional_integral import ProportionalIntegral
from ..controllers.state_feedback import StateFeedback
from ..data.record import Record
from ..frozen import replace, saved
from ..models.controlled import ControlledPlant
from ..models.discretisation import exponential
from ..models.events import Failure
from ..models.state_space import StateSpace

A = np.array([[-1.3433, 0.9946], [3.5, -1.0521]])
B = np.array([[-0.1525], [-24.3282]])
ACTUATOR = 20.0  # [1/s]: 20 / (s + 20) from the command to the deflection
FEEDBACK = np.array([0.283, 0.876, -0.4])  # gains of alpha, q and the deflection in dec = ... - .9964 q_c
COMMAND = -0.9964
INTEGRAL = -0.0001  # gain of z, dz/dt = q_c - q
SIGMA_ALPHA, SIGMA_Q = 0.03, 0.1108  # sensor noise [deg], [deg/s]: "37.227 dB"
RATE = 100.0  # samples per second
SECONDS = 16.5
STATES, OUTPUTS, INPUTS = ("alpha", "pitch_rate"), ("alpha_deg", "pitch_rate_deg_s"), ("elevator_deg",)
SIMULATIONS = ("continuous_actuator", "held_elevator")


def short_period(*, sigma_alpha: float = SIGMA_ALPHA, sigma_q: float = SIGMA_Q, Q: Numbers | None = None) -> StateSpace:
    """The short-period motion of the F-16 as a continuous model: states alpha [deg] and pitch rate [deg/s], input the
    elevator [deg].

    Both states are measured, with sensor noise of the standard deviations `sigma_alpha` and `sigma_q`. `Q`: the density of
    process noise, per second (default none).

    >>> sorted(round(float(z), 4) for z in np.linalg.eigvals(short_period().A))
    [-3.0691, 0.6737]
    """
    R = np.diag(np.square(_sigmas(sigma_alpha, sigma_q)))
    return StateSpace(A, B, Q=Q, R=R, dt=0, states=STATES, inputs=INPUTS, outputs=OUTPUTS)


def _sigmas(sigma_alpha: float, sigma_q: float) -> tuple[Any, Any]:
    """The standard deviations of the sensors, checked."""
    faults = checks.Faults()
    found = tuple(faults.number(name, value, lower=0.0)
                  for name, value in (("sigma_alpha", sigma_alpha), ("sigma_q", sigma_q)))  # fmt: skip
    faults.finish()
    return found[0], found[1]


def closed_loop(gain: float, *, integral: bool = True) -> np.ndarray:
    """The system matrix of the loop of aircraft, actuator and PI law, where the loop gain is `gain`.

    Its states are alpha, the pitch rate, the deflection of the elevator, and z, the integral of the error of the pitch rate.
    With `integral=False` the law has no integral (P), and z is omitted.

    >>> [round(float(abs(z)), 4) for z in np.sort_complex(np.linalg.eigvals(closed_loop(0.08)))][:2]
    [26.6776, 3.721]
    """
    faults = checks.Faults()
    gain = faults.number("gain", gain)
    faults.flag("integral", integral)
    faults.finish()
    F = np.zeros((4, 4))
    F[:2, :2], F[:2, 2:3] = A, gain * B
    F[2, :3], F[2, 2], F[2, 3] = ACTUATOR * FEEDBACK, ACTUATOR * (FEEDBACK[2] - 1), ACTUATOR * INTEGRAL
    F[3, 1] = -1.0
    return F if integral else F[:3, :3]


def pitch_command(t: np.ndarray) -> np.ndarray:
    """The pitch-rate command [deg/s] at the times t [s]: three doublets, then zero.

    A doublet is +10 and then -10 deg/s, and lasts 4.5 s. The command is filtered by 3 / (s + 3), exactly at the times t.
    """
    edges = np.arange(0.0, 13.5 + 1e-9, 2.25)
    steps = np.array([10.0, -20.0, 20.0, -20.0, 20.0, -20.0, 10.0])
    faults = checks.Faults()
    since = np.asarray(faults.array("t", t, "T"))
    faults.finish()
    since = since[:, None] - edges
    return np.sum(np.where(since > 0, steps * -np.expm1(-3 * np.maximum(since, 0)), 0.0), axis=1)


def controlled(
    gain_after: float = 1.0, *, failure_time: float = 4.5, simulation: str = "continuous_actuator",
    sigma_alpha: float = SIGMA_ALPHA, sigma_q: float = SIGMA_Q,
) -> ControlledPlant:  # fmt: skip
    """The short period with its actuator, as a plant for `close_loop`. At `failure_time` [s] the loop gain drops from 1 to
    `gain_after`.

    >>> controlled(0.4).hold
    'first_order'
    """
    faults = checks.Faults()
    faults.choice("simulation", simulation, SIMULATIONS)
    faults.finish()
    return ControlledPlant(
        short_period(sigma_alpha=sigma_alpha, sigma_q=sigma_q), actuator=ACTUATOR, held=simulation == "held_elevator",
        events=[Failure(failure_time, gain_after)],
    )  # fmt: skip


def law(*, integral: bool = False) -> StateFeedback | ProportionalIntegral:
    """The control law of the pitch rate for the healthy aircraft, for `close_loop`: a P law, or a PI law with
    `integral=True`.

    >>> law().feedback.tolist()
    [[-0.283, -0.876]]
    """
    faults = checks.Faults()
    faults.flag("integral", integral)
    faults.finish()
    F, N, L = -FEEDBACK[None, :2], [[COMMAND]], -FEEDBACK[None, 2:]
    if not integral:
        return StateFeedback(F, reference_gain=N, input_feedback=L)
    return ProportionalIntegral(
        F, reference_gain=N, integral=[[-INTEGRAL]], tracked=[[0.0, 1.0]], dt=1 / RATE, input_feedback=L
    )


@saved
class Flight(NamedTuple):
    """One simulated flight: its `record`, the true `state` (T, 2) and loop `gain` (T,), and the pitch-rate `command` (T,)."""

    record: Record
    state: np.ndarray
    gain: np.ndarray
    command: np.ndarray


def flight(
    gain_after: float, *, seed: int, failure_time: float = 4.5, simulation: str = "continuous_actuator",
    sigma_alpha: float = SIGMA_ALPHA, sigma_q: float = SIGMA_Q,
) -> Flight:  # fmt: skip
    """Simulate a flight under the PI law. At `failure_time` [s] the loop gain drops from 1 to `gain_after`.

    The command is that of `pitch_command`. `simulation`: "continuous_actuator": the command is held over a sample, and the
    actuator moves between samples (the record then has the hold "first_order"); "held_elevator": the deflection itself is
    held, as in the thesis. The law feeds back the true states; the sensor noise is only in the record.

    >>> flown = flight(0.5, seed=1)
    >>> flown.record.y.shape, float(flown.gain[-1])
    ((1651, 2), 0.5)
    """
    sigmas = _sigmas(sigma_alpha, sigma_q)
    faults = checks.Faults()
    faults.whole("seed", seed, 0)
    faults.finish()
    clean = _clean(gain_after, failure_time, simulation)
    noise = np.random.default_rng(seed).normal(size=clean.state.shape) * sigmas
    return clean._replace(record=replace(clean.record, y=clean.state + noise))


def drawn_flight(
    gain_after: float, *, failure_time: float = 4.5, simulation: str = "continuous_actuator",
    sigma_alpha: float = SIGMA_ALPHA, sigma_q: float = SIGMA_Q,
) -> Callable[[Any], Flight]:  # fmt: skip
    """Make a function that draws one `Flight` with a random key, for `monte_carlo`. The arguments are as in `flight`.

    >>> import jax
    >>> drawn_flight(0.5)(jax.random.key(1)).record.y.shape
    (1651, 2)
    """
    sigmas = np.array([_sigmas(sigma_alpha, sigma_q)])
    clean = _clean(gain_after, failure_time, simulation)

    def draw(key: Array) -> Flight:
        y = clean.state + sigmas * jax.random.normal(key, clean.state.shape)
        return clean._replace(record=replace(clean.record, y=y))

    return draw


def _clean(gain_after: float, failure_time: float, simulation: str) -> Flight:
    """The flight without sensor noise."""
    faults = checks.Faults()
    faults.choice("simulation", simulation, SIMULATIONS)
    faults.number("gain_after", gain_after)
    faults.number("failure_time", failure_time, unit="seconds")
    faults.finish()
    held = simulation == "held_elevator"
    t = np.arange(round(SECONDS * RATE) + 1) / RATE
    gain = np.where(t >= failure_time - 1e-9, gain_after, 1.0)
    command = pitch_command(t)
    x = _fly(command, gain, held=held)
    record = Record(
        x[:, :2], x[:, 2:3], dt=1 / RATE, outputs=OUTPUTS, inputs=INPUTS,
        hold="zero_order" if held else "first_order",
        units={"alpha_deg": "deg", "pitch_rate_deg_s": "deg/s", "elevator_deg": "deg"},
    )  # fmt: skip
    return Flight(record, x[:, :2], gain, command)


def _fly(command: np.ndarray, gain: np.ndarray, *, held: bool) -> np.ndarray:
    """States, deflection and z at the samples, under an actuator command that is held over each sample."""
    transitions = {k: _transition(k, held) for k in np.unique(gain)}
    x, rows = np.zeros(4), []
    for q_c, k in zip(command, gain, strict=True):
        rows.append(x)
        dec = COMMAND * q_c + FEEDBACK @ x[:3] + INTEGRAL * x[3]
        x = transitions[k] @ np.append(x, [dec, q_c])
    return np.array(rows)


def _transition(gain: float, held: bool) -> np.ndarray:
    """From (alpha, q, deflection, z, dec, q_c) to the first four of them a sample later."""
    M = np.zeros((6, 6))
    M[:2, :2], M[:2, 2:3] = A, gain * B
    M[3, 1], M[3, 5] = -1.0, 1.0
    if held:  # the deflection jumps at the samples, as the actuator's exact response
        step = exponential(M / RATE)[:4]
        decay = np.exp(-ACTUATOR / RATE)
        step[2] = [0.0, 0.0, decay, 0.0, 1 - decay, 0.0]
        return step
    M[2, 2], M[2, 4] = -ACTUATOR, ACTUATOR
    return exponential(M / RATE)[:4]
