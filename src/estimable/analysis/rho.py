"""Margins against what is not modelled: how large a perturbation of a stable system can be before it may fail."""

from typing import Annotated, Any

import numpy as np

from .. import checks
from ..annotations import Numbers
from ..errors import AssumptionError
from ..frozen import frozen, static
from ..kernels import decay

SEARCH = 1e-10  # relative, to which the best rate is searched


@frozen
class StabilityRadius:
    """`margin`: the norm of the smallest complex matrix E for which A + E is not stable; `frequency` (rad/s) where."""

    margin: float
    frequency: float


@frozen
class Perturbed:
    """Bounds on x under a perturbation: ||x|| <= overshoot ||x0|| at its start, `final` in the end, `decay` between.

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
    """What `rho_margin` returns: margin <= sigma <= stability_radius.

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
    course: decay.Course
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
                f"`kappa` must be below the margin {self.margin:.6g}: beyond it nothing is bounded. Got {kappa:g}."
            )
        faults.finish()
        rates = _Rates(self.course, self.dt == 0)
        rate = rates.best(lambda λ: rates.decay(λ) - kappa * rates.overshoot(λ))
        γ, α = rates.overshoot(rate), rates.decay(rate)
        speed = α - kappa * γ
        return Perturbed(γ, speed if self.dt == 0 else 1 - speed, γ * delta / speed, self.dt)

    def __repr__(self) -> str:
        return f"RhoMargin({self.margin:.4g} <= sigma {self.sigma:.4g} <= stability radius {self.stability_radius:.4g})"


class _Rates:
    """Overshoot γ and speed of decay for every rate λ that the norms a at times t prove: a_N <= λ^t bounds all that follows.

    λ is the factor in a sample, or in a second. Between two times at a distance h a straight line times e^{αt} is at most
    e^{(αh)²/8} above its ends (Hoeffding's lemma).
    """

    def __init__(self, course: decay.Course, continuous: bool):
        self.course, self.continuous = course, continuous
        self.t, self.log_a, self.h = course.t, _log(course.a), np.diff(course.t)
        self.ends = [_log(a + course.ε) for a in (course.a[:-1], course.a[1:])]
        self.dead = course.a[1] == 0
        self.slowest = float(np.min(self.log_a[1:] / self.t[1:]))  # log λ of the fastest decay that is proven
        self.lowest = float(np.exp(self.slowest))

    def decay(self, λ: float) -> float:
        """The speed of decay of λ, per sample or per second."""
        return -np.log(λ) if self.continuous else 1 - λ

    def overshoot(self, λ: float) -> float:
        """The smallest γ for which the norms stay below γ λ^t."""
        if λ == 0:
            return 1.0
        α = -np.log(λ)
        at = self.log_a + α * self.t
        if not self.continuous:
            return float(np.exp(np.max(at)))
        line = np.maximum(self.ends[0] + α * self.t[:-1], self.ends[1] + α * self.t[1:]) + (α * self.h) ** 2 / 8
        growing = at[:-1] + max(self.course.ω + α, 0.0) * self.h
        return float(np.exp(max(np.max(at), np.max(np.minimum(line, growing)))))

    def best(self, value: float) -> float:
        """The λ of the largest `value`, which has one maximum."""
        from scipy.optimize import minimize_scalar

        def at(s: float) -> float:
            return np.exp(self.slowest * (1 - s)) if self.continuous else self.lowest + s * (1 - self.lowest)

        found: Any = minimize_scalar(
            lambda s: -value(at(s)), bounds=(0, 1 - 1e-12), method="bounded", options={"xatol": SEARCH}
        )
        return max((λ for λ in (at(float(found.x)), at(0.0)) if λ > 0 or self.dead), key=value)


def _log(a: float) -> Any:
    with np.errstate(divide="ignore"):
        return np.log(a)


def rho_margin(A: Numbers, *, dt: float, scaling: Numbers | None = None) -> RhoMargin:
    """How much unmodelled coupling, nonlinearity or change in time a stable system bears.

    Model: x[k+1] = A x[k] + f(k, x[k]) + g[k] (dt = 0: dx/dt). With ||f|| <= κ ||x|| and κ below the margin, x stays
    bounded whatever f is, and `perturbed(κ, δ)` gives the bound.

    A (n, n) must be stable. `dt`: its step in seconds, 0 if continuous. `scaling`: the size of one unit of each state, (n,),
    or "balanced" to let rows and columns of A weigh alike; None: the states as they are. All of it depends on these units.

    Raises `InputError`; `AssumptionError` where A is not stable. In continuous time the norm is bounded between the times
    at which it is computed, which costs the margin about .2 %, always to the safe side.

    Cost: up to 20,000 products and singular values of A. Reference: R. W. Bass (2005), who takes for the rate the spectral
    radius, at which the overshoot of a defective A is infinite, and δ/ρ for what stays, which holds for κ = 0 only.

    >>> found = rho_margin([[0.5]], dt=1)
    >>> round(found.margin, 9), round(found.perturbed(0.4, 1.0).final, 6)
    (0.5, 10.0)
    """
    A, dt = _read(A, dt)
    scaling = _scaling(A, scaling)
    A = A * scaling / scaling[:, None]
    course, total = _decay(A, dt == 0)
    rates = _Rates(course, dt == 0)
    rate = rates.best(lambda λ: _log(rates.decay(λ)) - _log(rates.overshoot(λ)))
    γ, speed = rates.overshoot(rate), rates.decay(rate)
    radius = decay.nearest_instability(A, dt == 0)[0]
    return RhoMargin(speed / γ, speed if dt == 0 else rate, γ, 1 / total, radius, scaling, course, dt)


def stability_radius(A: Numbers, *, dt: float) -> StabilityRadius:
    """How far, in the spectral norm, a stable A is from a matrix that is not stable (the complex stability radius).

    A (n, n); `dt` in seconds, 0 if continuous. Raises `InputError`; `AssumptionError` where A is not stable.

    Cost: a few eigenvalue problems of 2n. Reference: D. Hinrichsen, A. J. Pritchard (1986); N. A. Bruinsma, M. Steinbuch
    (1990). It is a margin against constant perturbations; for those that vary or are nonlinear see `rho_margin`.

    >>> round(stability_radius([[-3.0]], dt=0).margin, 9)
    3.0
    """
    A, dt = _read(A, dt)
    margin, θ = decay.nearest_instability(A, dt == 0)
    return StabilityRadius(margin, θ if dt == 0 else θ / dt)


def _read(A: Numbers, dt: float) -> tuple[np.ndarray, float]:
    faults = checks.Faults()
    A = faults.array("A", A, "n n")
    dt = faults.number("dt", dt, lower=0.0, unit="seconds")
    faults.finish()
    A = np.asarray(A)
    if len(A) == 0:
        checks.refuse("`A` must be at least 1 × 1.")
    poles = np.linalg.eigvals(A)
    worst = poles.real.max() if dt == 0 else np.abs(poles).max()
    if worst >= (0.0 if dt == 0 else 1.0):
        what = (
            "real part of an eigenvalue is {:.6g}, not < 0"
            if dt == 0
            else "modulus of an eigenvalue is {:.6g}, not < 1"
        )
        raise AssumptionError(f"`A` is not stable, so that it has no margin: the largest {what.format(worst)}.")
    return A, dt


def _scaling(A: np.ndarray, scaling: Numbers) -> np.ndarray:
    if scaling is None:
        return np.ones(len(A))
    if isinstance(scaling, str):
        from scipy.linalg import matrix_balance

        faults = checks.Faults()
        faults.choice("scaling", scaling, ("balanced",))
        faults.finish()
        return matrix_balance(A, permute=False, separate=True)[1][0]
    faults = checks.Faults()
    faults.learn("n", len(A), f"`A` is {len(A)} × {len(A)}")
    sizes = faults.array("scaling", scaling, "n")
    if sizes is not None and np.any(sizes <= 0):
        faults.add(f"`scaling` must be sizes, greater than 0. Got {sizes.min():g}.")
    faults.finish()
    return np.asarray(sizes)


def _decay(A: np.ndarray, continuous: bool) -> tuple[decay.Course, float]:
    """||A^k|| or ||e^{At}||, and a bound of their sum or integral."""
    if not continuous:
        a = decay.norms(A)
        course = decay.Course(np.arange(len(a), dtype=float), a, np.zeros(len(a) - 1), 0.0)
        total = a[:-1].sum()
    else:
        course = decay.course(A)
        a, h, ω = course.a, np.diff(course.t), course.ω
        growing = a[:-1] * (h if ω == 0 else np.expm1(ω * h) / ω)
        total = np.sum(np.minimum(h * ((a[1:] + a[:-1]) / 2 + course.ε), growing))
    if a[-1] >= 1:
        raise AssumptionError(
            f"`A` is too near the limit of stability: its norm is still {a[-1]:.3g} after {len(a) - 1} steps."
        )
    return course, float(total / (1 - a[-1]))  # the rest repeats it, smaller by the last norm each time
