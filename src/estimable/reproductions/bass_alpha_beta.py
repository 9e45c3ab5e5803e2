"""The α-β tracker of the slides: every number printed about it, and a check of the claims."""

from typing import Any

import numpy as np

from ..design.tracker_gains import alpha_beta_choices, alpha_beta_covariance, alpha_beta_gains
from ..design.trans_kalman import trans_kalman
from ..models.state_space import StateSpace
from . import plots
from .entries import Reproduced, ReproducedRow

RATIOS = (0.01, 0.1, 1.0, 10.0, 100.0, 1e4)  # σ_a² / σ_s², T = 1 s
RANGE = np.geomspace(1e-3, 1e4, 57)
ACCELERATION = np.array([[1 / 3, 1 / 2], [1 / 2, 1]])

WORSE = (
    "The slides say that this tracker beats every Kalman filter in one component. With the right variances none can: the Kalman "
    "gain is optimal for every weighting of the error, hence in each component. Rows 'over the Kalman filter's' are above 1."
)
STEPS = (
    "The slides say 'stable for arbitrary dT': that holds only for steps of one length. If steps of 1 and 10 s alternate, the "
    "error grows by 1.43 in two steps. The spectral radius is .337, but the error can grow in one step: by 1.48 at T = 1 s."
)
SAFE = (
    "Constant gains can be safe if the variances are unknown: the last row is the least possible worst case over the same "
    "range of ratios, that of the Kalman gain of a least favourable ratio (trans_kalman)."
)


def _step(α: float, β: float, T: float) -> np.ndarray:
    """The transition of the error from update to update."""
    return np.array([[1 - α, (1 - α) * T], [-β / T, 1 - β]])


def _prices(ratio: float) -> dict[str, float]:
    """Variance of position of each choice of the gains, divided by that of the Kalman filter."""
    table = alpha_beta_choices(dt=1, sigma_a2=ratio, sigma_s2=1)
    return dict(zip(table.names, table.price[:, 0], strict=True))


def safest() -> Any:
    """The gains with the smallest worst relative regret over the ratios."""
    track = StateSpace([[1.0, 1.0], [0.0, 1.0]], C=[[1.0, 0.0]], Q=ACCELERATION, R=[[1.0]], dt=1)
    noises = [(ratio * ACCELERATION, [[1.0]]) for ratio in (RATIOS[0], RATIOS[-1])]
    return trans_kalman(track, noises=noises, weight=[1.0, 0.0])


def alpha_beta(draws: int) -> Reproduced:
    """Gains, the remainder of each noise in the position, poles, and the claims. Nothing is drawn."""
    α, β = alpha_beta_gains("least_worst")
    φ = alpha_beta_covariance(α, β, dt=1, sigma_a2=3, sigma_s2=0)[0, 0]
    ψ = alpha_beta_covariance(α, β, dt=1, sigma_a2=0, sigma_s2=1)[0, 0]
    P11 = alpha_beta_covariance(α, β, dt=2, sigma_a2=0.6, sigma_s2=0.8)[0, 0]
    pole, Ψ = np.roots([1.0, α + β - 2, 1 - α])[0], _step(α, β, 1.0)
    two = _step(α, β, 10.0) @ Ψ
    numbers = (
        ("alpha", 0.886554, α), ("beta", 1.411793, β), ("phi", 0.0243289, φ), ("psi", 0.886554, ψ),
        ("P11 at T = 2 s, densities .6 and .8 (by the printed formula)", 0.0243289 * 0.6 * 8 / 3 + 0.886554 * 0.8 / 2, P11),
        ("pole, real part", -0.149, pole.real), ("pole, imaginary part", 0.302, abs(pole.imag)),
        ("pole, modulus", 0.336818, abs(pole)), ("modulus after 3 updates (printed: less than)", 0.04, abs(pole) ** 3),
        ("norm of one update, T = 1 s (printed: at most)", 1 / 3, np.linalg.norm(Ψ, 2)),
        ("norm of 3 updates, T = 1 s (printed: less than)", 0.04, np.linalg.norm(np.linalg.matrix_power(Ψ, 3), 2)),
        ("growth in two updates, T = 1 and 10 s in turn", None, np.abs(np.linalg.eigvals(two)).max()),
        *((f"P11 over the Kalman filter's, ratio {ratio:g}", None, _prices(ratio)["least_worst"]) for ratio in RATIOS),
        ("the least possible over all ratios from .01 to 1e4", None, 1 + safest().worst),
    )  # fmt: skip
    rows = tuple(ReproducedRow(name, "", published, float(ours)) for name, published, ours in numbers)
    return Reproduced(rows, _picture, (WORSE, STEPS, SAFE))


def _picture() -> Any:
    """The cost of each choice over the ratio of the densities."""
    tables = [alpha_beta_choices(dt=1, sigma_a2=ratio, sigma_s2=1) for ratio in RANGE]
    lines = [
        plots.Line(name.replace("_", " "), RANGE, [table.price[i, 0] for table in tables], i, plots.DASHES[i])
        for i, name in enumerate(tables[0].names)
    ]
    gains = safest().filter[:, 0]
    cost = [alpha_beta_covariance(*gains, dt=1, sigma_a2=ratio, sigma_s2=1)[0, 0] for ratio in RANGE]
    best = [table.covariance[0, 0, 0] for table in tables]
    lines.append(plots.Line("trans-Kalman", RANGE, np.array(cost) / best, plots.INK))
    figure = plots.over_time(
        [plots.Panel("variance of position, over the Kalman filter's", lines)], x="σ_a² / σ_s² [1/s⁴]"
    )
    return figure.update_xaxes(type="log").update_yaxes(type="log")
