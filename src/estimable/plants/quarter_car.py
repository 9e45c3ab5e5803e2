"""A quarter of a car: body and wheel on suspension and tyre, over a rough road."""

import numpy as np

from .. import checks
from ..models.state_space import StateSpace

REFERENCE_FREQUENCY = 0.1  # [cycles/m], ISO 8608
ROUGHNESS = {"A": 16e-6, "B": 64e-6, "C": 256e-6, "D": 1024e-6}  # [m³]: spectrum of a road at that frequency, by class


def quarter_car(
    *,
    body: float = 290.0,
    wheel: float = 59.0,
    stiffness: float = 16_812.0,
    damping: float = 1_000.0,
    tyre: float = 190_000.0,
    speed: float = 20.0,
    road: str = "C",
    sigma: float = 1e-3,
) -> StateSpace:
    """A quarter of a car as a continuous model: input the force of an active suspension [N], disturbed by the road.

    States: suspension deflection [m], body velocity [m/s], tyre deflection [m], wheel velocity [m/s]. Outputs: the suspension
    deflection and the body velocity. The velocity of the road is white noise: at `speed` V [m/s] on a road of class `road` (ISO
    8608) its density is (2π n0)² G(n0) V / 2.

    `body` and `wheel` [kg], `stiffness` [N/m] and `damping` [N s/m] of the suspension, `tyre` [N/m], `sigma` of the sensors [m],
    [m/s].

    Reference: J.-S. Lin, I. Kanellakopoulos, IEEE Control Systems 17 (1997) 45-59 (the default numbers); ISO 8608.

    >>> car = quarter_car()
    >>> sorted(round(float(abs(z)) / (2 * np.pi), 1) for z in np.linalg.eigvals(car.A))  # Hz: body and wheel
    [1.2, 1.2, 9.4, 9.4]
    """
    faults = checks.Faults()
    given = {"body": body, "wheel": wheel, "stiffness": stiffness, "tyre": tyre, "speed": speed}
    M, m, k, k_t, V = (faults.number(name, value, above=0.0) for name, value in given.items())
    c, noise = (faults.number(name, value, lower=0.0) for name, value in (("damping", damping), ("sigma", sigma)))
    faults.choice("road", road, tuple(ROUGHNESS))
    faults.finish()
    A = [[0, 1, 0, -1], [-k / M, -c / M, 0, c / M], [0, 0, 0, 1], [k / m, c / m, -k_t / m, -c / m]]
    density = (2 * np.pi * REFERENCE_FREQUENCY) ** 2 * ROUGHNESS[road] * V / 2
    return StateSpace(
        A, [[0.0], [1 / M], [0.0], [-1 / m]], np.eye(2, 4), G=[[0.0], [0.0], [-1.0], [0.0]], Q=[[density]],
        R=np.diag([noise**2] * 2), dt=0, states=["suspension", "body_velocity", "tyre", "wheel_velocity"],
        inputs=["force_n"], outputs=["suspension_m", "body_velocity_m_s"],
    )  # fmt: skip
