"""The lateral motion of the F-16 with aileron and rudder, linear about level flight at 153 m/s.

The matrices are those of the F-16 of JSBSim 1.3.3, by central differences of .5 deg (agreeing with .1 deg to 2e-4) about its
trim at 153 m/s (Mach .451) and 1,000 ft: alpha 2.077 deg, elevator -1.196 deg, dynamic pressure 13.92 kPa. The flight
control computer does not act; the aileron and the rudder are those of the aerodynamic tables.
"""

import numpy as np

from .. import checks
from ..annotations import Numbers
from ..models.state_space import StateSpace

AIRSPEED, ALTITUDE, SPAN = 153.0, 304.8, 9.144  # [m/s], [m], [m]
ACTUATOR = 20.0  # [1/s], as that of the elevator
A = np.array([
    [-0.317972, 0.063874, 0.035722, -0.991971],
    [0.0, 0.0, 1.0, 0.036262],
    [-28.149915, 0.0, -2.773014, 0.615652],
    [8.119186, 0.0, -0.072865, -0.441956],
])  # fmt: skip
B = np.array([[-0.006126, 0.02331], [0.0, 0.0], [10.897896, 3.337283], [0.552004, -1.725445]])
STATES = ("beta", "bank", "roll_rate", "yaw_rate")
INPUTS, OUTPUTS = ("aileron_deg", "rudder_deg"), ("beta_deg", "bank_deg", "roll_rate_deg_s", "yaw_rate_deg_s")
SIGMA = 0.1  # [deg], [deg/s]


def f16_lateral(*, sigma: float = SIGMA, Q: Numbers | None = None) -> StateSpace:
    """The lateral motion of the F-16 at 153 m/s as a continuous model: states beta, bank angle [deg], roll rate and yaw rate
    [deg/s]; inputs aileron and rudder [deg].

    All states are measured, with sensor noise of the standard deviation `sigma`. `Q` (4, 4): the density of process noise, per
    second (default none). Turbulence enters by `Turbulence(dryden, {"beta": "beta"}, angle="deg")`.

    >>> sorted(round(float(z.real), 3) for z in np.linalg.eigvals(f16_lateral().A))  # roll, Dutch roll twice, spiral
    [-2.841, -0.338, -0.338, -0.016]
    """
    faults = checks.Faults()
    read = faults.number("sigma", sigma, lower=0.0)
    faults.finish()
    R = np.diag(np.full(4, read**2))
    return StateSpace(A, B, Q=Q, R=R, dt=0, states=STATES, inputs=INPUTS, outputs=OUTPUTS)
