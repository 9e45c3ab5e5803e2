"""The α-β tracker with constant gains: what its error is, and the usual choices of the gains."""

from typing import Any

import numpy as np

from .. import checks
from ..kernels import alpha_beta as kernel

CHOICES = ("least_worst", "kalata", "benedict_bordner", "critically_damped")


def alpha_beta_covariance(alpha: float, beta: float, *, dt: float, sigma_a2: float, sigma_s2: float) -> Any:
    """The stationary covariance (2, 2) of the error (position, velocity) of an α-β tracker, after each measurement.

    Model: r' = v, v' white of density `sigma_a2`; r is measured every `dt` seconds with white noise of variance
    `sigma_s2` / dt. Tracker: K = (α, β / dt). Closed form.

    Assumes constant dt and constant gains, and that the variances are right; the tracker need not be optimal. Raises
    `InputError` unless 0 < α < 2, 0 < β < 2 (2 - α), outside of which the error grows without bound.

    Reference: R. W. Bass (2005), φ and ψ of P11; P12 and P22 by the same equation.

    >>> float(alpha_beta_covariance(0.886554, 1.411793, dt=1, sigma_a2=3, sigma_s2=0)[0, 0].round(5))
    0.02433
    """
    faults = checks.Faults()
    α, β = faults.number("alpha", alpha, above=0.0), faults.number("beta", beta, above=0.0)
    dt = faults.number("dt", dt, above=0.0, unit="seconds")
    σ_a2, σ_s2 = faults.number("sigma_a2", sigma_a2, lower=0.0), faults.number("sigma_s2", sigma_s2, lower=0.0)
    if α is not None and β is not None and not kernel.stable(α, β):
        faults.add(f"an α-β tracker is stable for 0 < α < 2 and 0 < β < 2 (2 - α) only. Got α = {α:g}, β = {β:g}.")
    faults.finish()
    assert α is not None
    assert β is not None
    parts = σ_a2 * np.array(kernel.of_manoeuvre(α, β, dt)) + σ_s2 * np.array(kernel.of_noise(α, β, dt))
    return parts[np.array([[0, 1], [1, 2]])]


def alpha_beta_gains(choice: str, *, index: float | None = None, alpha: float | None = None) -> tuple[float, float]:
    """(α, β) by one of the usual choices.

    "least_worst": Bass's, where ∂φ/∂β = 0 and ψ = α (β = 2 α² / (2 - α)). "benedict_bordner": β = α² / (2 - α) for the given
    `alpha`. "critically_damped": both poles equal, for the given `alpha`. "kalata": optimal for a target whose
    acceleration is constant over each step, of tracking `index` = σ_accel dt² / σ_measurement.

    Raises `InputError` for a choice without its number, or a number outside its range.

    >>> [round(gain, 6) for gain in alpha_beta_gains("least_worst")]
    [0.886554, 1.411793]
    """
    faults = checks.Faults()
    faults.choice("choice", choice, CHOICES)
    needs = {"kalata": "index", "benedict_bordner": "alpha", "critically_damped": "alpha"}
    given = {"index": index, "alpha": alpha}
    for name, value in given.items():
        wanted = needs.get(choice) == name
        if wanted and value is None:
            faults.add(f"`{name}` must be given for {choice!r}.")
        elif wanted:
            given[name] = faults.number(name, value, above=0.0, upper=1.0 if name == "alpha" else None)
        elif value is not None:
            faults.add(f"`{name}` has no meaning for {choice!r}.")
    faults.finish()
    α, Λ = given["alpha"], given["index"]
    if choice == "least_worst":
        s = np.sqrt((3 - np.sqrt(3)) / 2)
        α = 2 * s / (1 + s)
        return float(α), float((3 - np.sqrt(3)) * (2 - α))
    if choice == "kalata":
        assert Λ is not None
        r = (4 + Λ - np.sqrt(8 * Λ + Λ**2)) / 4  # Kalata (1984): r² = 1 - α
        return float(1 - r**2), float(2 * (1 - r) ** 2)
    assert α is not None
    return (α, α**2 / (2 - α)) if choice == "benedict_bordner" else (α, float(2 - α - 2 * np.sqrt(1 - α)))
