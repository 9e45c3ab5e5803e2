"""R. W. Bass, slides on Trans-Kalman filters and rho synthesis (2005). They number neither tables nor figures."""

from .bass_alpha_beta import alpha_beta
from .bass_bandwidth import rho_bandwidth
from .entries import Reproduction

SOURCE = "Bass (2005)"

ENTRIES = (
    Reproduction("bass-alpha-beta", SOURCE, "Trans-Kalman alpha-beta filters in numbers", alpha_beta),
    Reproduction("bass-rho-bandwidth", SOURCE, "Stability margin rho over bandwidth", rho_bandwidth),
)
