"""Margins against unmodelled dynamics: how large a perturbation of a stable system can be before it may fail."""

import numpy as np

from .. import checks
from ..annotations import Numbers
from ..errors import AssumptionError
from ..kernels import decay
from ..kernels.decay_rates import DecayRates, log
from ..results import RhoMargin, StabilityRadius


def rho_margin(A: Numbers, *, dt: float, scaling: Numbers | None = None) -> RhoMargin:
    """How much unmodelled coupling, nonlinearity or time variation a stable system tolerates.

    Model: x[k+1] = A x[k] + f(k, x[k]) + g[k], or dx/dt = A x + f(t, x) + g(t) where dt = 0. The term f is unknown, with
    ||f|| <= κ ||x||. The term g is a bounded force, with ||g|| <= δ. If κ is below the margin, x stays bounded for every such
    f. The method `perturbed(κ, δ)` of the result gives the bound.

    A (n, n) must be stable. `dt`: its step in seconds, 0 if continuous. `scaling`: the size of one unit of each state, (n,),
    or "balanced" to balance the rows and columns of A; None: the states unchanged. All results depend on these units.

    Returns a `RhoMargin`. Raises `InputError`; `AssumptionError` where A is not stable. In continuous time the norm of e^{At}
    is computed at discrete times and bounded between them. This lowers the margin by about .2 %, so that it remains a
    guarantee.

    Cost: up to 20,000 powers of A, and the largest singular value of each.

    Reference: R. W. Bass (2005). The source uses the spectral radius as the rate, at which the overshoot of a defective A is
    infinite. Its final bound δ/ρ holds for κ = 0 only.

    >>> found = rho_margin([[0.5]], dt=1)
    >>> round(found.margin, 9), round(found.perturbed(0.4, 1.0).final, 6)
    (0.5, 10.0)
    """
    A, dt = _read(A, dt)
    units = _scaling(A, scaling)
    A = A * units / units[:, None]
    course, total = _decay(A, dt == 0)
    rates = DecayRates(course, dt == 0)
    rate = rates.best(lambda λ: log(rates.decay(λ)) - log(rates.overshoot(λ)))
    γ, speed = rates.overshoot(rate), rates.decay(rate)
    radius = decay.nearest_instability(A, dt == 0)[0]
    return RhoMargin(speed / γ, speed if dt == 0 else rate, γ, 1 / total, radius, units, course, dt)


def stability_radius(A: Numbers, *, dt: float) -> StabilityRadius:
    """How far a stable A is, in the spectral norm, from the nearest complex matrix that is not stable.

    A is (n, n). `dt`: its step in seconds, 0 if continuous. The result is a margin against constant perturbations; for
    time-varying or nonlinear ones use `rho_margin`.

    Returns a `StabilityRadius`. Raises `InputError`; `AssumptionError` where A is not stable.

    Cost: a few eigenvalue problems of size 2n.

    Reference: D. Hinrichsen, A. J. Pritchard (1986); N. A. Bruinsma, M. Steinbuch (1990).

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
        raise AssumptionError(f"`A` is not stable, so it has no margin: the largest {what.format(worst)}.")
    return A, dt


def _scaling(A: np.ndarray, scaling: Numbers | None) -> np.ndarray:
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
    """||A^k|| or ||e^{At}||, and a bound on their sum or integral."""
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
    return course, float(total / (1 - a[-1]))  # the rest is a geometric series with the last norm as ratio
