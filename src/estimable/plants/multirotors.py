"""Multirotors with four, six or eight rotors: a linear model about hover, and the nonlinear flight.

Numbers: geometry, thrust and moment coefficients of the x500 quadrotor in PX4's simulation (rotors at ±.174 m, 8.54858e-6
N s²/rad², .016 m, at most 1,000 rad/s: 8.55 N), mass and inertia near those of that aircraft. Its motors have a lag of .0125 s
up and .025 s down; the .04 s here, the noises and the gusts are our own. Axes: x forward, y left, z up.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from .. import checks
from ..annotations import Array
from ..models.nonlinear_model import NonlinearModel
from ..models.state_space import StateSpace

GRAVITY = 9.81  # [m/s²]
MAX_THRUST = 8.55  # [N]
THRUST_COEFFICIENT = 8.54858e-6  # [N s²/rad²]
GYRO_SIGMA, ACCELEROMETER_SIGMA = (0.05, 0.05, 0.03), 0.8  # [rad/s], [m/s²]
GUST_SECONDS, GUST_RMS = 0.5, (1.5, 1.5, 0.4, 0.4)  # of the accelerations p, q, r [rad/s²] and vertical [m/s²]
RATES, GUSTS = ("p", "q", "r"), ("gust_p", "gust_q", "gust_r", "gust_z")
OUTPUTS = ("p_rad_s", "q_rad_s", "r_rad_s", "specific_force_m_s2")
ATTITUDE = ("roll", "pitch", "yaw", "vertical_speed", "height")
LAYOUTS, ROTORS = ("x", "plus"), (4, 6, 8)
TIME_CONSTANT = 0.04  # [s]: lag of a motor, for `ControlledPlant(actuator=1 / TIME_CONSTANT)`


class Airframe(NamedTuple):
    """A frame: the `mixer` (4, m) from thrusts [N] to roll, pitch and yaw moment [N m] and lift [N]; mass and inertia."""

    mixer: np.ndarray
    mass: float
    inertia: np.ndarray

    @property
    def names(self) -> tuple[str, ...]:
        """The motors."""
        return tuple(f"motor{i + 1}" for i in range(self.mixer.shape[1]))

    @property
    def accelerations(self) -> np.ndarray:
        """From thrusts to p', q', r' [rad/s²] and the vertical specific force [m/s²], (4, m)."""
        return self.mixer / np.append(self.inertia, self.mass)[:, None]

    @property
    def hover(self) -> np.ndarray:
        """The thrusts [N] at hover, (m,)."""
        m = self.mixer.shape[1]
        return np.full(m, self.mass * GRAVITY / m)


def frame(
    rotors: int = 4,
    *,
    layout: str = "x",
    arm: float = 0.246,
    mass: float = 2.0,
    inertia: tuple[float, float, float] = (0.0217, 0.0217, 0.04),
    moment_coefficient: float = 0.016,
    max_thrust: float = MAX_THRUST,
) -> Airframe:
    """The frame of a multirotor: `rotors` 4, 6 or 8 on a circle of radius `arm` [m], neighbours spinning in opposite directions.

    `layout`: "x" (forward lies between two arms) or "plus" (along one). Rotor i at (x, y) with spin s = ±1 gives the roll moment
    y T, the pitch moment -x T and the yaw moment s c T; `moment_coefficient` c [m]. Raises `InputError` if it cannot hover within
    `max_thrust` [N].

    >>> frame(4).mixer.round(3).tolist()[2:]
    [[-0.016, 0.016, -0.016, 0.016], [1.0, 1.0, 1.0, 1.0]]
    """
    faults = checks.Faults()
    if rotors not in ROTORS:
        faults.add(f"`rotors` must be 4, 6 or 8. Got {checks.short(rotors)}.")
    faults.choice("layout", layout, LAYOUTS)
    given = {"arm": arm, "mass": mass, "moment_coefficient": moment_coefficient, "max_thrust": max_thrust}
    radius, weight, c, most = (faults.number(name, value, above=0.0) for name, value in given.items())
    J = faults.array("inertia", inertia, "3")
    if J is not None and np.any(J <= 0):
        faults.add(f"`inertia` must be positive, in kg m². Got {checks.short(inertia)}.")
    if not faults.sentences and weight * GRAVITY >= rotors * most:
        faults.add(
            f"it cannot hover: its weight is {weight * GRAVITY:.3g} N, its thrust at most {rotors * most:.3g} N."
        )
    faults.finish()
    angles = 2 * np.pi * (np.arange(rotors) + (0.5 if layout == "x" else 0.0)) / rotors  # from forward, to the left
    spin = np.where(np.arange(rotors) % 2 == 0, -1.0, 1.0)
    mixer = np.stack([radius * np.sin(angles), -radius * np.cos(angles), spin * c, np.ones(rotors)])
    return Airframe(mixer, float(weight), np.asarray(J))


def multirotor(
    rotors: int = 4,
    *,
    layout: str = "x",
    arm: float = 0.246,
    mass: float = 2.0,
    inertia: tuple[float, float, float] = (0.0217, 0.0217, 0.04),
    moment_coefficient: float = 0.016,
    max_thrust: float = MAX_THRUST,
    attitude: bool = False,
) -> StateSpace:
    """A multirotor about hover as a continuous model: inputs the thrusts of the motors [N], about an operating point.

    States: the rates p, q, r [rad/s] and the accelerations of gusts: about the three axes [rad/s²] and vertical [m/s²], each of
    first order with .5 s. Outputs: three gyros and the specific force along the thrust axis, to which the thrusts contribute
    directly. With `attitude`: also roll, pitch, yaw [rad], measured with .005 rad, the vertical speed [m/s], and the height [m],
    measured with .02 m.
    The arguments are those of `frame`. The motors follow their commands with a lag of .04 s: `ControlledPlant(model,
    actuator=1 / .04)`. Half of the variance of the accelerometer is vibration (`flight` has it as lines).

    >>> hexarotor = multirotor(6)
    >>> hexarotor.inputs[2], hexarotor.operating_point.inputs.round(2).tolist()[2]
    ('motor3', 3.27)
    """
    faults = checks.Faults()
    faults.flag("attitude", attitude)
    faults.finish()
    own = frame(rotors, layout=layout, arm=arm, mass=mass, inertia=inertia, moment_coefficient=moment_coefficient,
                max_thrust=max_thrust)  # fmt: skip
    states = (*RATES, *(ATTITUDE if attitude else ()), *GUSTS)
    n, m, at = len(states), rotors, states.index
    A, B = np.zeros((n, n)), np.zeros((n, m))
    B[:3] = own.accelerations[:3]
    A[:3, at("gust_p") : at("gust_z")] = np.eye(3)
    A[at("gust_p") :, at("gust_p") :] = -np.eye(4) / GUST_SECONDS
    if attitude:
        A[3:6, :3], A[at("height"), at("vertical_speed")], A[at("vertical_speed"), at("gust_z")] = np.eye(3), 1.0, 1.0
        B[at("vertical_speed")] = own.accelerations[3]
    outputs, sigma = (*OUTPUTS, *_measured(attitude)), _sigmas(attitude)
    C, D = np.zeros((len(outputs), n)), np.zeros((len(outputs), m))
    C[:3, :3], C[3, at("gust_z")], D[3] = np.eye(3), 1.0, own.accelerations[3]
    for row, state in enumerate(("roll", "pitch", "yaw", "height") if attitude else (), start=4):
        C[row, at(state)] = 1.0
    rest = np.zeros(len(outputs))
    rest[3] = GRAVITY
    return StateSpace(
        A, B, C, D, G=np.eye(n)[:, -4:], Q=2 / GUST_SECONDS * np.diag(np.square(GUST_RMS)), R=np.diag(np.square(sigma)), dt=0,
        states=states, inputs=own.names, outputs=outputs,
        operating_point={"states": np.zeros(n), "inputs": own.hover, "outputs": rest},
    )  # fmt: skip


def flight(
    rotors: int = 4,
    *,
    layout: str = "x",
    arm: float = 0.246,
    mass: float = 2.0,
    inertia: tuple[float, float, float] = (0.0217, 0.0217, 0.04),
    moment_coefficient: float = 0.016,
    max_thrust: float = MAX_THRUST,
    vibration: bool = False,
    substeps: int = 2,
) -> NonlinearModel:
    """The nonlinear flight of a multirotor: inputs the thrusts [N], parameters the effectiveness of each motor (1: healthy).

    Rigid body with gyroscopic moments: J ω' = M - ω × J ω, Euler angles, vertical motion under the tilted thrust. States and
    outputs as in `multirotor(attitude=True)`; the outputs are in absolute units. `vibration`: the accelerometer has a line at the
    speed of each rotor, √(T / 8.55e-6) rad/s (757 rad/s for a quadrotor at hover), with half of its variance; the phases are
    further states. The other arguments are those of `frame`.

    >>> sorted(flight(6).parameter_names)[:2]
    ['motor1', 'motor2']
    """
    faults = checks.Faults()
    faults.flag("vibration", vibration)
    faults.finish()
    own = frame(rotors, layout=layout, arm=arm, mass=mass, inertia=inertia, moment_coefficient=moment_coefficient,
                max_thrust=max_thrust)  # fmt: skip
    J, mixer, m = own.inertia, own.mixer, rotors
    line = ACCELEROMETER_SIGMA / np.sqrt(m) if vibration else 0.0  # m lines of amplitude a have the variance m a²/2

    def f(x: Array, u: Array, θ: Array):
        ω, (roll, pitch, _), gust = x[:3], x[3:6], x[8:12]
        *moments, lift = jnp.sum(mixer * (θ * u)[None, :], axis=1)
        turn = jnp.stack([x[1] * x[2] * (J[2] - J[1]), x[2] * x[0] * (J[0] - J[2]), x[0] * x[1] * (J[1] - J[0])])
        spin = (jnp.stack(moments) - turn) / J + gust[:3]
        sine, cosine = jnp.sin(roll), jnp.cos(roll)
        angles = [
            ω[0] + (sine * ω[1] + cosine * ω[2]) * jnp.tan(pitch),
            cosine * ω[1] - sine * ω[2],
            (sine * ω[1] + cosine * ω[2]) / jnp.cos(pitch),
        ]
        rise = lift / own.mass * cosine * jnp.cos(pitch) - GRAVITY + gust[3]
        turning = jnp.sqrt(jnp.maximum(θ * u, 1e-9) / THRUST_COEFFICIENT)
        parts = [spin, jnp.stack([*angles, rise, x[6]]), -gust / GUST_SECONDS]
        return jnp.concatenate([*parts, turning] if vibration else parts)

    def h(x: Array, u: Array, θ: Array):
        force = jnp.sum(θ * u) / own.mass + x[11] + line * jnp.sum(jnp.cos(x[12:]))
        return jnp.concatenate([x[:3], force[None], x[3:6], x[7:8]])

    sigma = _sigmas(True)
    sigma[3] = ACCELEROMETER_SIGMA * (np.sqrt(0.5) if vibration else 1.0)
    states = (*RATES, *ATTITUDE, *GUSTS, *(f"phase{i + 1}" for i in range(m if vibration else 0)))
    return NonlinearModel(
        f, h, G=np.eye(len(states))[:, 8:12], Q=2 / GUST_SECONDS * np.diag(np.square(GUST_RMS)), R=np.diag(np.square(sigma)),
        dt=0, substeps=substeps, parameters=dict.fromkeys(own.names, 1.0), states=states, inputs=own.names,
        outputs=(*OUTPUTS, *_measured(True)),
    )  # fmt: skip


def _measured(attitude: bool) -> tuple[str, ...]:
    return ("roll_rad", "pitch_rad", "yaw_rad", "height_m") if attitude else ()


def _sigmas(attitude: bool) -> list[float]:
    """The standard deviations of the sensors."""
    return [*GYRO_SIGMA, ACCELEROMETER_SIGMA, *((0.005, 0.005, 0.005, 0.02) if attitude else ())]
