"""A DC motor: the standard example of a linear plant with an electrical and a mechanical time constant."""

from .. import checks
from ..models.state_space import StateSpace


def dc_motor(
    *,
    resistance: float = 1.0,
    inductance: float = 0.5,
    constant: float = 0.01,
    friction: float = 0.1,
    inertia: float = 0.01,
    sigma: float = 0.002,
    torque_density: float = 1e-8,
) -> StateSpace:
    """A DC motor as a continuous model: states current [A] and speed [rad/s], input voltage [V], output the speed.

    Model: L di/dt = -R i - K ω + u, J dω/dt = K i - b ω + w. `resistance` R [ohm], `inductance` L [H], `constant` K [N m/A, V s],
    `friction` b [N m s], `inertia` J [kg m²], `sigma`: of the sensor [rad/s], `torque_density`: of the load torque w [N² m² s].

    Reference: W. Messner, D. Tilbury, Control Tutorials for MATLAB and Simulink, DC motor speed (the default numbers).

    >>> motor = dc_motor()
    >>> (-motor.C @ np.linalg.solve(motor.A, motor.B)).round(4).item()  # K / (R b + K²), rad/s per volt
    0.0999
    """
    faults = checks.Faults()
    given = {
        "resistance": resistance, "inductance": inductance, "constant": constant, "friction": friction, "inertia": inertia
    }  # fmt: skip
    R, L, K, b, J = (faults.number(name, value, above=0.0) for name, value in given.items())
    noise, torque = (
        faults.number(name, value, lower=0.0) for name, value in (("sigma", sigma), ("torque_density", torque_density))
    )
    faults.finish()
    return StateSpace(
        [[-R / L, -K / L], [K / J, -b / J]], [[1 / L], [0.0]], [[0.0, 1.0]], G=[[0.0], [1 / J]], Q=[[torque]], R=[[noise**2]],
        dt=0, states=["current", "speed"], inputs=["voltage_v"], outputs=["speed_rad_s"],
    )  # fmt: skip
