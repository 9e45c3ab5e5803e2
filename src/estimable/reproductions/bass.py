"""R. W. Bass, slides on Trans-Kalman filters and rho synthesis (2005). They number neither tables nor figures."""

import numpy as np

from ..design.alpha_beta import alpha_beta_covariance, alpha_beta_gains
from .bass_bandwidth import rho_bandwidth
from .entries import Reproduced, Reproduction, Row

SOURCE = "Bass (2005)"

CLAIM = (
    "The slides say that this tracker beats every Kalman filter in one component. With the right variances none can: at T = 1 s "
    "its variance of position is 1.18 times the Kalman filter's where both densities are equal, 82 times where they are 1e4 to 1."
)


def alpha_beta(draws: int) -> Reproduced:
    """The gains of the slides, what is left of each noise in the position, and the poles. Nothing is drawn."""
    α, β = alpha_beta_gains("least_worst")
    φ = alpha_beta_covariance(α, β, dt=1, sigma_a2=3, sigma_s2=0)[0, 0]
    ψ = alpha_beta_covariance(α, β, dt=1, sigma_a2=0, sigma_s2=1)[0, 0]
    pole = np.roots([1.0, α + β - 2, 1 - α])[0]
    numbers = (
        ("alpha", 0.886554, α), ("beta", 1.411793, β), ("phi", 0.0243289, φ), ("psi", 0.886554, ψ),
        ("pole, real part", -0.149, pole.real), ("pole, imaginary part", 0.302, abs(pole.imag)),
        ("pole, modulus", 0.336818, abs(pole)),
    )  # fmt: skip
    return Reproduced(tuple(Row(name, "", published, float(ours)) for name, published, ours in numbers), None, (CLAIM,))


ENTRIES = (
    Reproduction("bass-alpha-beta", SOURCE, "Trans-Kalman alpha-beta filters in numbers", alpha_beta),
    Reproduction("bass-rho-bandwidth", SOURCE, "Stability margin rho over bandwidth", rho_bandwidth),
)
