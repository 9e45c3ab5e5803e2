"""R. W. Bass, slides on Trans-Kalman filters and rho synthesis (2005). They number neither tables nor figures."""

from .entries import Reproduction

SOURCE = "Bass (2005)"
ROBUST = "not yet: it needs the robust designs"

ENTRIES = (
    Reproduction("bass-alpha-beta", SOURCE, "Trans-Kalman alpha-beta filters in numbers", None, ROBUST),
    Reproduction("bass-rho-bandwidth", SOURCE, "Stability margin rho over bandwidth", None, ROBUST),
)
