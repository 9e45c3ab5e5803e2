"""The α-β tracker with constant gains: the covariance of its error, and the usual choices of the gains."""

from typing import Any

import numpy as np

from .. import checks
from ..kernels import tracker_error as kernel
from ..models.state_space import StateSpace
from ..results import TrackerChoices
from .gains import kalman_gain

LARGEST_INDEX = 1e70  # tracking index: its square, and the covariances, are then finite
CHOICES = ("least_worst", "kalata", "benedict_bordner", "critically_damped")


def alpha_beta_covariance(alpha: float, beta: float, *, dt: float, sigma_a2: float, sigma_s2: float) -> Any:
    """The stationary covariance (2, 2) of the error (position, velocity) of an α-β tracker, after each measurement.

    Model: r' = v, v' white of density `sigma_a2`; r is measured every `dt` seconds with white noise of variance
    `sigma_s2` / dt. Tracker: K = (α, β / dt). Closed form.

    Assumes constant dt and constant gains, and that the variances are right; the tracker need not be optimal. Raises
    `InputError` unless 0 < α < 2, 0 < β < 2 (2 - α); otherwise the error grows without bound.

    Reference: R. W. Bass (2005), φ and ψ of P11; P12 and P22 by the same equation.

    >>> float(alpha_beta_covariance(0.886554, 1.411793, dt=1, sigma_a2=3, sigma_s2=0)[0, 0].round(5))
    0.02433
    """
    faults = checks.Faults()
    α, β = faults.number("alpha", alpha, above=0.0), faults.number("beta", beta, above=0.0)
    dt = faults.number("dt", dt, above=0.0, unit="seconds")
    σ_a2, σ_s2 = faults.number("sigma_a2", sigma_a2, lower=0.0), faults.number("sigma_s2", sigma_s2, lower=0.0)
    if α is not None and β is not None and not kernel.stable(α, β):
        faults.add(kernel.UNSTABLE.format(α, β))
    faults.finish()
    assert α is not None
    assert β is not None
    T = np.float64(dt)  # overflows to an infinite value, which is refused below
    with np.errstate(all="ignore"):
        parts = σ_a2 * np.array(kernel.of_manoeuvre(α, β, T)) + σ_s2 * np.array(kernel.of_noise(α, β, T))
    if not np.isfinite(parts).all():
        checks.refuse(f"the covariance is not finite for `dt` = {dt:g} s and these densities: choose other units.")
    return parts[np.array([[0, 1], [1, 2]])]


def alpha_beta_gains(choice: str, *, index: float | None = None, alpha: float | None = None) -> tuple[float, float]:
    """(α, β) by one of the usual choices.

    "least_worst": Bass's, where ∂φ/∂β = 0 and ψ = α (β = 2 α² / (2 - α)). "benedict_bordner": β = α² / (2 - α) for the given
    `alpha`. "critically_damped": both poles equal, for the given `alpha`. "kalata": optimal for a target whose
    acceleration is constant over each step; `index` is the tracking index σ_accel dt² / σ_measurement. φ and ψ are the factors of
    the position's variance, φ σ_a² dt³ / 3 + ψ σ_s² / dt (`alpha_beta_covariance`).

    Raises `InputError` for a choice without its number, or a number outside its range.

    Reference: R. W. Bass (2005); T. R. Benedict, G. W. Bordner, IRE TAC 7 (1962) 27; P. R. Kalata, IEEE TAES 20 (1984) 174.

    >>> [round(gain, 6) for gain in alpha_beta_gains("least_worst")]
    [0.886554, 1.411793]
    """
    needs = {"kalata": "index", "benedict_bordner": "alpha", "critically_damped": "alpha"}
    return _gains(choice, _number(choice, CHOICES, needs, index, alpha))


def _gains(choice: str, number: float = 0.0) -> tuple[float, float]:
    """(α, β) of a choice whose number, Λ or α, is in range."""
    if choice == "least_worst":
        s = np.sqrt((3 - np.sqrt(3)) / 2)
        α = 2 * s / (1 + s)
        return float(α), float((3 - np.sqrt(3)) * (2 - α))
    if choice == "kalata":
        α, β = kernel.kalata(number)
        return float(α), float(β)
    α = number
    return (α, α**2 / (2 - α)) if choice == "benedict_bordner" else (α, float((1 - np.sqrt(1 - α)) ** 2))


def alpha_beta_gamma_gains(
    choice: str, *, index: float | None = None, alpha: float | None = None
) -> tuple[float, float, float]:
    """(α, β, γ) by one of the usual choices, K = (α, β / T, γ / T²); others write γ / (2 T²), and twice this γ.

    "kalata": optimal for a target whose acceleration is increased at each step by white noise, of tracking `index` = σ_increment
    dt² / σ_measurement: β = 2 (1 - s)², γ = β² / (2 α), s² = 1 - α. "critically_damped": all three poles equal, for the given
    `alpha` (a fading memory).

    Raises `InputError` for a choice without its number, or a number outside its range.

    Reference: P. R. Kalata, IEEE TAES 20 (1984) 174; N. Morrison, Introduction to Sequential Smoothing and Prediction (1969).

    >>> [round(gain, 6) for gain in alpha_beta_gamma_gains("critically_damped", alpha=0.875)]
    [0.875, 0.5625, 0.125]
    """
    needs = {"kalata": "index", "critically_damped": "alpha"}
    number = _number(choice, tuple(needs), needs, index, alpha)
    if choice == "kalata":
        return kernel.kalata_gamma(number)
    return kernel.fading(float(np.cbrt(1 - number)))


def _number(
    choice: str, choices: tuple[str, ...], needs: dict[str, str], index: float | None, alpha: float | None
) -> float:
    """`index` or `alpha`, whichever the choice needs, checked; 0 where it needs none."""
    faults = checks.Faults()
    if not faults.choice("choice", choice, choices):
        faults.finish()
    number = 0.0
    for name, value in (("index", index), ("alpha", alpha)):
        wanted = needs.get(choice) == name
        if wanted and value is None:
            faults.add(f"`{name}` must be given for {choice!r}.")
        elif wanted:
            number = faults.number(name, value, above=0.0, upper=1.0 if name == "alpha" else None)
        elif value is not None:
            faults.add(f"`{name}` is not used by {choice!r}: leave it out.")
    faults.finish()
    return number


def alpha_beta_choices(*, dt: float, sigma_a2: float, sigma_s2: float) -> TrackerChoices:
    """The usual choices of α and β side by side, for an acceleration of density `sigma_a2` and a sensor of density `sigma_s2`.

    "kalman": the optimum. "kalata": for the index whose acceleration has the same variance of velocity, Λ = dt² (σ_a² / σ_s²)^½.
    "benedict_bordner", "critically_damped": with the α of their family that minimises the variance of position.
    "least_worst": Bass's, which needs neither density. Raises `InputError` for numbers that are not positive.

    >>> table = alpha_beta_choices(dt=1, sigma_a2=1, sigma_s2=1)
    >>> dict(zip(table.names, table.price[:, 0].round(3).tolist()))["least_worst"]
    1.182
    """
    faults = checks.Faults()
    dt = faults.number("dt", dt, above=0.0, unit="seconds")
    σ_a2, σ_s2 = (
        faults.number(name, value, above=0.0) for name, value in (("sigma_a2", sigma_a2), ("sigma_s2", sigma_s2))
    )
    faults.finish()
    with np.errstate(all="ignore"):
        index = np.float64(dt) ** 2 * np.sqrt(np.float64(σ_a2) / σ_s2)
    if not 1 / LARGEST_INDEX < index < LARGEST_INDEX:
        checks.refuse(f"the tracking index dt² (sigma_a2 / sigma_s2)^½ is {index:.3g}: choose other units.")
    noises = {"dt": dt, "sigma_a2": σ_a2, "sigma_s2": σ_s2}
    gains = {
        "kalman": _kalman(dt, σ_a2, σ_s2),
        "kalata": _gains("kalata", float(index)),
        "benedict_bordner": _best("benedict_bordner", noises),
        "critically_damped": _best("critically_damped", noises),
        "least_worst": _gains("least_worst"),
    }
    covariance = np.array([alpha_beta_covariance(*pair, **noises) for pair in gains.values()])
    variances = np.diagonal(covariance, axis1=1, axis2=2)
    α, β = np.array(list(gains.values())).T
    radius = np.array([np.abs(kernel.poles(*pair)).max() for pair in gains.values()])
    return TrackerChoices(α, β, covariance, radius, variances / variances[0], tuple(gains))


def _kalman(dt: float, σ_a2: float, σ_s2: float) -> tuple[float, float]:
    """The optimal gains, computed at T = 1 s with the same ratio of noises."""
    ratio = σ_a2 / σ_s2 * dt**4
    Q = ratio * np.array([[1 / 3, 1 / 2], [1 / 2, 1.0]])
    K = kalman_gain(StateSpace([[1.0, 1.0], [0.0, 1.0]], C=[[1.0, 0.0]], Q=Q, R=[[1.0]], dt=1)).filter
    return float(K[0, 0]), float(K[1, 0])


def _best(choice: str, noises: dict[str, float]) -> tuple[float, float]:
    """The gains of a family with the least variance of position."""
    from scipy.optimize import minimize_scalar

    def variance(α: float) -> float:
        return np.log(alpha_beta_covariance(*_gains(choice, α), **noises)[0, 0])

    found: Any = minimize_scalar(
        lambda z: variance(1 / (1 + np.exp(-z))), bounds=(-20, 20), method="bounded", options={"xatol": 1e-9}
    )
    return _gains(choice, float(1 / (1 + np.exp(-found.x))))
