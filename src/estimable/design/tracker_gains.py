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

    Model: dr/dt = v for the position r and velocity v; dv/dt is white noise of density `sigma_a2`. r is measured every `dt`
    seconds with white noise of variance `sigma_s2` / dt. The tracker corrects position and velocity by the gains α and β / dt
    times the innovation.

    Assumes constant dt and constant gains, and that the densities are right; the gains need not be optimal. The result is in
    closed form. Raises `InputError` unless 0 < α < 2 and 0 < β < 2 (2 - α); otherwise the error grows without bound.

    Reference: R. W. Bass (2005), φ and ψ of P11; P12 and P22 follow from the same equation.

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
    """The gains (α, β) of a tracker of position and velocity, by one of four usual choices.

    The variance of the position is φ σ_a² dt³ / 3 + ψ σ_s² / dt, where φ and ψ depend on the gains only; σ_a² and σ_s² are
    the densities of `alpha_beta_covariance`.

    - "least_worst": the choice of Bass, which needs no number. It has ∂φ/∂β = 0, which gives β = 2 α² / (2 - α), and ψ = α.
    - "benedict_bordner": β = α² / (2 - α) for the given `alpha`.
    - "critically_damped": both poles are equal, for the given `alpha`.
    - "kalata": optimal for a target whose acceleration is constant over each step. `index` is the tracking index, σ_accel
      dt² / σ_measurement, from the standard deviations of acceleration and measurement.

    Raises `InputError` for a choice without its number, or for a number outside its range.

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
    """The gains (α, β, γ) of a tracker of position, velocity and acceleration, by one of two usual choices.

    After a step of T seconds, the tracker corrects position, velocity and acceleration by α, β / T and γ / T² times the
    innovation. Some authors write γ / (2 T²) instead; their γ is twice this one.

    - "kalata": optimal for a target whose acceleration changes at each step by white noise with standard deviation
      σ_increment. `index` is the tracking index σ_increment T² / σ_measurement. The gains are α = 1 - s², β = 2 (1 - s)² and
      γ = β² / (2 α), where s solves 2 (1 - s)³ = `index` s (1 + s).
    - "critically_damped": all three poles are equal, for the given `alpha` (a fading memory).

    Raises `InputError` for a choice without its number, or for a number outside its range.

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
    """The usual choices of the gains α and β side by side, for an acceleration of density `sigma_a2` and a sensor of density
    `sigma_s2`.

    - "kalman": the optimal gains.
    - "kalata": the gains of `alpha_beta_gains` for the index Λ = dt² (σ_a² / σ_s²)^½. With this index an acceleration that is
      constant over a step adds the same variance to the velocity.
    - "benedict_bordner" and "critically_damped": with the `alpha` that minimises the variance of the position.
    - "least_worst": the choice of Bass, which needs neither density.

    Returns a `TrackerChoices`. Raises `InputError` for numbers that are not positive.

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
