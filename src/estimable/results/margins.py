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
    """Bounds on the expected covariance P[k] of the one-step prediction, where each sample arrives with probability `rate`.

    - `lower` and `upper` (n, n): for large k the expectation E P[k] lies between these matrices. A matrix with an infinite
      diagonal means that this bound does not exist.
    - `bounded`: "yes" where the upper bound exists, "no" where the lower bound does not exist, "unknown" between.
    """

    rate: float
    lower: Annotated[Any, "n n", "symmetric"]
    upper: Annotated[Any, "n n", "symmetric"]
    bounded: str = static()


@frozen
class LossTolerance:
    """The result of `loss_tolerance`: an interval that contains the critical arrival probability.

    - `lower` and `upper`: the ends of the interval. If samples arrive more rarely than `lower`, the expected covariance grows
      without bound from some initial covariance. If they arrive more often than `upper`, it stays bounded from every one.
      Both are 0 for a stable A: then no rate is critical.
    - `exact`: whether the two ends agree.
    - `spectral_radius`: the spectral radius of A.
    - `sentence`: the verdict as a sentence.
    - `model`: the model.
    """

    lower: float
    upper: float
    spectral_radius: float
    exact: bool = static()
    sentence: str = static()
    model: StateSpace

    def at(self, rate: float) -> ArrivalCovariance:
        """Bounds on the expected covariance where samples arrive independently with probability `rate`, from 0 to 1.

        Raises `InputError` for a rate that is not in [0, 1].
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
    """The result of `stability_radius`.

    - `margin`: the norm of the smallest complex matrix E for which A + E is not stable.
    - `frequency`: the frequency in rad/s at which A + E reaches the limit of stability.
    """

    margin: float
    frequency: float


@frozen
class Perturbed:
    """A bound on the norm of the state x of a stable system under a perturbation.

    From a start with norm ||x0|| the state satisfies ||x(t)|| <= overshoot ||x0|| d + final (1 - d). The factor d falls from
    1 to 0: it is decay^k after k samples, and exp(-decay t) in continuous time (dt = 0).

    - `overshoot`: the factor by which the state may exceed its start.
    - `decay`: the rate of the decay, per sample or per second.
    - `final`: the bound on ||x|| after the start is forgotten.
    - `dt`: the time step in seconds, 0 for continuous time.
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
    """The result of `rho_margin`: three margins of a stable matrix A, with margin <= sigma <= stability_radius.

    The norms are those of x / scaling, so all margins depend on the units of the states.

    - `margin`: ρ = (1 - rate) / overshoot, the largest value over all pairs for which ||A^k|| <= overshoot rate^k for all k.
      In continuous time ρ = rate / overshoot, with ||e^{At}|| <= overshoot exp(-rate t).
    - `rate` and `overshoot`: the pair that attains this value.
    - `sigma`: 1 / Σ ||A^k||, in continuous time 1 / ∫ ||e^{At}|| dt.
    - `stability_radius`: the norm of the smallest constant change of A that makes it unstable.
    - `scaling` (n,): the size of one unit of each state.
    - `course`: the computed norms of the powers A^k, or of e^{At}.
    - `dt`: the time step in seconds, 0 for continuous time.
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
        """The bound that decays fastest for the perturbed system x[k+1] = A x[k] + f(k, x[k]) + g[k], or dx/dt = A
        x + f(t, x) + g(t).

        It holds for every f with ||f|| <= kappa ||x|| and every g with ||g|| <= delta. Raises `InputError` unless kappa is
        below the margin.
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
