"""The claims of the slides on robustness and cost over bandwidth, for a published aircraft; they print no plant or numbers."""

from functools import lru_cache

import numpy as np

from ..design.rho_synthesis import rho_synthesis
from ..kernels.courses import bandwidth
from ..models.state_space import StateSpace
from ..results import RhoSynthesis
from .entries import Reproduced, ReproducedRow

# K. S. Narendra, S. S. Tripathi, J. Aircraft 10 (1973) 193: a helicopter at 135 knots; velocities [knots], pitch rate and pitch.
VTOL = StateSpace(
    [[-0.0366, 0.0271, 0.0188, -0.4555], [0.0482, -1.01, 0.0024, -4.0208], [0.1002, 0.3681, -0.707, 1.42], [0, 0, 1, 0]],
    [[0.4422, 0.1761], [3.5446, -7.5922], [-5.52, 4.49], [0, 0]], np.eye(4)[[0, 1, 3]], Q=0.01 * np.eye(4), R=0.01 * np.eye(3),
    dt=0, states=["forward", "vertical", "pitch_rate", "pitch"], inputs=["collective", "cyclic"],
    outputs=["forward", "vertical", "pitch"],
)  # fmt: skip
ETA = np.geomspace(0.05, 3000.0, 120)
FAST = 20  # designs at the fast end, over which a power is fitted

PLANT = (
    "The slides name no plant. This is the helicopter of Narendra and Tripathi (1973), with measured forward speed, vertical "
    "speed and pitch. The noises, of density .01, are ours. The threefold gains on a VTOL aircraft cannot be checked."
)
CUBE = (
    "The rms of the control grows like the cube of the bandwidth if one number determines feedback and filter, as the "
    "slides say, and in proportion to the bandwidth if the filter is that of Q and R."
)
SLIGHT = (
    "For n = 3 the slides call their bandwidth a slight perturbation of the classical one. For a third-order equation it is "
    "the natural frequency to the power 1.5, which depends on the unit of time."
)
PEAK = "The margin rises to its maximum and then falls, as the slides say; here it falls only slightly."


@lru_cache(maxsize=1)
def designs() -> tuple[RhoSynthesis, RhoSynthesis]:
    """Both gains driven by η, and only the feedback, with the Kalman filter."""
    both = rho_synthesis(VTOL, eta=ETA, weights={"rho": 1.0})
    return both, rho_synthesis(VTOL, eta=ETA, filter="kalman", weights={"rho": 1.0})


def _power(found: RhoSynthesis) -> float:
    """d log rms of u / d log bandwidth, at the fast end."""
    log = np.log(found.bandwidth[-FAST:]), np.log(found.criteria["control"][-FAST:])
    return float(np.polyfit(*log, 1)[0])


def _companion(*coefficients: float) -> np.ndarray:
    """x^(n) = -coefficients (x, x', ..)."""
    n = len(coefficients)
    return np.vstack([np.eye(n)[1:], -np.array(coefficients)])


def rho_bandwidth(draws: int) -> Reproduced:
    """The bandwidth of the largest margin, the growth of the cost, and the bandwidth for 2 and 3 states. Nothing is drawn."""
    both, alone = designs()
    best, last = both.optima["rho"], float(both.criteria["rho"][-1])
    ω = 2.0
    second, third = (
        float(bandwidth(A[None])[0]) / ω for A in (_companion(ω**2, 1.4 * ω), _companion(ω**3, 2 * ω**2, 2 * ω))
    )
    rows = (
        ReproducedRow("power of the bandwidth in the control's rms, both gains driven", "", 3.0, _power(both)),
        ReproducedRow("the same, feedback alone driven", "", None, _power(alone)),
        ReproducedRow("bandwidth over natural frequency, n = 2", "", 1.0, second),
        ReproducedRow("bandwidth over natural frequency, n = 3 (Butterworth, 2 rad/s)", "", None, third),
        ReproducedRow("bandwidth of the largest margin rho", "rad/s", None, best.bandwidth),
        ReproducedRow("largest rho", "1/s", None, best.value),
        ReproducedRow("rho of the fastest design, of the largest", "", None, last / best.value),
        ReproducedRow("largest rho, proven bound", "1/s", None, float(both.margin.margin)),
        ReproducedRow("stability radius of that design", "1/s", None, float(both.margin.stability_radius)),
        ReproducedRow("largest rho, feedback alone driven", "1/s", None, alone.optima["rho"].value),
    )
    return Reproduced(rows, both.plot, (PLANT, CUBE, PEAK, SLIGHT))
