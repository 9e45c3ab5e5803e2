# pyright: reportUnnecessaryComparison=false
"""Margins of a model against losses, unmodelled coupling and changes, with their bounds."""

from typing import Annotated, Any

import numpy as np

from .. import checks
from ..annotations import Numbers
from ..errors import AssumptionError
from ..frozen import frozen, static
from ..kernels.decay import Course
from ..kernels.decay_rates import DecayRates
from ..kernels.losses import upper_covariance
from ..kernels.riccati import dlyap
from ..models.state_space import StateSpace


@frozen
class ArrivalCovariance:
    """Bounds on the expected covariance of the one-step prediction where samples arrive at `rate`.

    lower <= E P[k] <= upper as k grows, both (n, n) and as matrices; an infinite diagonal: no bound exists. `bounded`: "yes"
    where the upper bound exists, "no" where no lower one does, "unknown" between.
    """

    rate: float
    lower: Annotated[Any, "n n", "symmetric"]
    upper: Annotated[Any, "n n", "symmetric"]
    bounded: str = static()


@frozen
class LossTolerance:
    """The result of `loss_tolerance`: the critical arrival probability lies in [lower, upper].

    Below it the expected covariance grows without bound from some start; above it the covariance stays bounded from every start.
    Both are 0 where A is stable: then no rate is critical. `spectral_radius` of A; `exact`: the two agree.
    """

    lower: float
    upper: float
    spectral_radius: float
    exact: bool = static()
    sentence: str = static()
    model: StateSpace

    def at(self, rate: float) -> ArrivalCovariance:
        """Bounds on the expected covariance where samples arrive independently at `rate`, from 0 to 1.

        Raises `InputError` for a rate outside.
        """
        faults = checks.Faults()
        rate = faults.number("rate", rate, lower=0.0, upper=1.0)
        faults.finish()
        parts = _parts(self.model)
        lower, upper = _lower_covariance(*parts, λ=rate), upper_covariance(*parts, λ=rate)
        bounded = "yes" if upper is not None else "no" if lower is None else "unknown"
        unbounded = np.diag(np.full(self.model.n, np.inf))
        lower, upper = (unbounded if X is None else X for X in (lower, upper))
        return ArrivalCovariance(rate, lower, upper, bounded)

    def __repr__(self) -> str:
        return f"LossTolerance({self.sentence})"


def _parts(model: StateSpace) -> Any:
    """A, C, Q, R and the cross noise, in the state's own units."""
    A, C, G, R = (np.asarray(M) for M in (model.A, model.C, model.G, model.R))
    N = np.zeros((model.n, model.p)) if model.S is None else G @ np.asarray(model.S)
    return A, C, G @ np.asarray(model.Q) @ G.T, R, N


def _lower_covariance(A: np.ndarray, C: np.ndarray, Q: np.ndarray, R: np.ndarray, N: np.ndarray, λ: float) -> Any:
    """X = (1 - λ) A X A' + Q - λ N R^-1 N': as if an arrived sample determined the whole state. (None: no solution.)"""
    try:
        return dlyap(np.sqrt(1 - λ) * A, Q - λ * N @ np.linalg.solve(R, N.T))
    except AssumptionError:
        return None


@frozen
class StabilityRadius:
    """`margin`: the norm of the smallest complex matrix E for which A + E is not stable; `frequency` (rad/s) where."""

    margin: float
    frequency: float


@frozen
class Perturbed:
    """Bounds on x under a perturbation: ||x|| <= overshoot ||x0|| at the start, `final` at the end, `decay` between.

    ||x(t)|| <= overshoot ||x0|| d + final (1 - d), d = decay^k after k samples (dt = 0: exp(-decay t)).
    """

    overshoot: float
    decay: float
    final: float
    dt: float = static()

    def at(self, t: Numbers, *, x0: float) -> Any:
        """The bound at times t (seconds) from a start of norm `x0`."""
        t = np.asarray(t, float)
        d = np.exp(-self.decay * t) if self.dt == 0 else self.decay ** (t / self.dt)
        return self.overshoot * x0 * d + self.final * (1 - d)


@frozen
class RhoMargin:
    """The result of `rho_margin`: margin <= sigma <= stability_radius.

    `margin` is ρ = (1 - rate) / overshoot (dt = 0: rate / overshoot), the largest over all rates for which
    ||A^k|| <= overshoot rate^k (dt = 0: ||e^{At}|| <= overshoot exp(-rate t)). `sigma` = 1 / Σ ||A^k|| (1 / ∫ ||e^{At}||).
    All are in the units of `scaling` (n,): the norms are of x / scaling.
    """

    margin: float
    rate: float
    overshoot: float
    sigma: float
    stability_radius: float
    scaling: Annotated[Any, "n"]
    course: Course
    dt: float = static()

    def perturbed(self, kappa: float, delta: float = 0.0) -> Perturbed:
        """The bound that decays fastest where x moves by A x + f(t, x) + g(t), ||f|| <= kappa ||x||, ||g|| <= delta.

        Raises `InputError` where kappa is not below the margin.
        """
        faults = checks.Faults()
        kappa = faults.number("kappa", kappa, lower=0.0)
        delta = faults.number("delta", delta, lower=0.0)
        if kappa is not None and kappa >= self.margin:
            faults.add(
                f"`kappa` must be below the margin {self.margin:.6g}: above it there is no bound. Got {kappa:g}."
            )
        faults.finish()
        rates = DecayRates(self.course, self.dt == 0)
        rate = rates.best(lambda λ: rates.decay(λ) - kappa * rates.overshoot(λ))
        γ, α = rates.overshoot(rate), rates.decay(rate)
        speed = α - kappa * γ
        return Perturbed(γ, speed if self.dt == 0 else 1 - speed, γ * delta / speed, self.dt)

    def __repr__(self) -> str:
        return f"RhoMargin({self.margin:.4g} <= sigma {self.sigma:.4g} <= stability radius {self.stability_radius:.4g})"
