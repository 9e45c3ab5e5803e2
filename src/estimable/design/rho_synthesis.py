"""Feedback and filter gains that depend on one number, chosen for the largest robustness margin or a composite criterion."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..analysis.rho import rho_margin
from ..annotations import Numbers
from ..errors import AssumptionError
from ..kernels.riccati import care, dare
from ..models.state_space import StateSpace
from ..results.designs import RhoSynthesis, times_worse
from . import loop_criteria
from .families import DesignFamily
from .rho_plan import Plan, read_plan


def rho_synthesis(
    model: StateSpace,
    *,
    eta: Numbers | None = None,
    control: DesignFamily | Numbers | None = None,
    filter: DesignFamily | Numbers | str | None = None,
    weights: Mapping[str, float] | None = None,
    scaling: Numbers | None = None,
) -> RhoSynthesis:
    """Design a loop at each value of one parameter η, and choose the most robust design, or the best by a weighted composite.

    Model: constant, continuous or discrete, with inputs. The law is u = -K x^, with x^ from a filter with gain L. Each η
    gives one K and one L. The loop of the state and the error, (x, x - x^), has the matrix F = [[A - B K, B K],
    [0, A - L C]]; in discrete time x^ is the filtered estimate. The function computes these criteria of each loop:

    - `response_time`: the seconds until the response to an impulse in any direction stays below 5 %
    - `rho` and `sigma`: margins against unmodelled dynamics, as in `rho_margin`
    - `external`: 1 / rho, the bound on the state per bounded force. `peak_gain`: the largest effect of that force on one
      state
    - `dispersion` and `control`: the rms of (x, x - x^) and of u under the noise of the model, or under unit white noise if
      it has none
    - `static_error`: ||F^-1||, in discrete time ||(I - F)^-1||: the state per constant force
    - `resonance`: the largest ||(iωI - F)^-1|| over all frequencies ω. `magnification`: `resonance` divided by `static_error`

    The bandwidth is sqrt(σ_min(F) σ_max(F)), from the singular values of F; in discrete time of log(F) / dt.

    `eta` (N,): the values of η per second, increasing. None: 200 values around the speeds of the plant. `control` and
    `filter`: each a `DesignFamily`, or a fixed gain, (m, n) or (n, p). None: `DesignFamily.approach` and `approach_of_error`.
    `filter="kalman"`: the Kalman gain of the model's Q and R. `weights`: {criterion: weight >= 0}, the weights in the
    composite that chooses the design. None: rho and control equally; {"rho": 1} chooses the largest margin. `scaling` (n,):
    the size of one unit of each state; None: the states unchanged. All criteria depend on it.

    Returns a `RhoSynthesis`. Raises `InputError`, also for weights of a family that are not positive semidefinite at some η;
    `AssumptionError` where the model is not stabilisable and detectable, or a loop is not stable. Norms over time are
    accurate to about 3 %. The `margin` of the chosen loop is a guaranteed bound. Cost: about 10 ms per design at n = 8.

    Reference: R. W. Bass (2005), slides on rho synthesis; the default family and the composite are ours.

    >>> mass = StateSpace([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]], dt=0)
    >>> found = rho_synthesis(mass, eta=[0.5, 1.0, 2.0], weights={"rho": 1})
    >>> found.chosen, found.feedback.round(6).tolist()
    (2, [[2.0, 3.0]])
    """
    plan = read_plan(model, eta, control, filter, weights, scaling)
    gains = [_gains(model, plan, float(η)) for η in plan.eta]
    loops = np.array([_loop(model, *gain) for gain in gains])
    _check_stable(model, plan.eta, loops)
    criteria, noise = loop_criteria.evaluate(model, gains, loops, plan.scaling)
    bandwidth = loop_criteria.bandwidths(loops * _relative(plan.scaling), model.dt)
    composite = _composite(criteria, plan.weights)
    chosen = int(np.argmin(composite))
    K, gain = gains[chosen]
    both = np.tile(plan.scaling, 2)
    margin = rho_margin(loops[chosen], dt=model.dt, scaling=both)
    return RhoSynthesis(
        plan.eta, bandwidth, criteria, composite, chosen, K, gain, loops[chosen], margin, plan.weights, plan.scaling,
        noise, model,
    )  # fmt: skip


def _gains(model: StateSpace, plan: Plan, η: float) -> tuple[Any, Any]:
    """K (m, n) and the filter's gain (n, p) at one η."""
    K, gain = plan.control, plan.filter
    try:
        if isinstance(K, DesignFamily):
            Q, S, R = K.at(η)
            K = (care if model.is_continuous else dare)(model.A, model.B, Q, R, S).K
        if isinstance(gain, DesignFamily):
            gain = _filter(model, gain, η)
    except AssumptionError as error:
        raise AssumptionError(f"there is no design at eta = {η:.6g}: {error}") from None
    return K, gain


def _filter(model: StateSpace, family: DesignFamily, η: float) -> Any:
    """The filter's gain, by duality; discrete, with Q' = Q, S' = Q C', R' = C Q C' + R of the next output C A x."""
    Q, S, R = family.at(η)
    if model.is_continuous:
        return care(model.A.T, model.C.T, Q, R, S).K.T
    if not family.next_output:
        S, R = Q @ model.C.T, model.C @ Q @ model.C.T + R
    return dare(model.A.T, (model.C @ model.A).T, Q, R, S).K.T


def _loop(model: StateSpace, K: np.ndarray, gain: np.ndarray) -> Any:
    """The closed-loop matrix of (x, x - x^)."""
    A, B, C, n = model.A, model.B, model.C, model.n
    error = A - gain @ C if model.is_continuous else A - gain @ C @ A
    return np.block([[A - B @ K, B @ K], [np.zeros((n, n)), error]])


def _check_stable(model: StateSpace, eta: np.ndarray, loops: np.ndarray) -> None:
    z = np.linalg.eigvals(loops)
    size = z.real.max(axis=1) if model.is_continuous else np.abs(z).max(axis=1)
    at, limit = int(np.argmax(size)), 0.0 if model.is_continuous else 1.0
    if size[at] >= limit:
        part = "real part" if model.is_continuous else "modulus"
        raise AssumptionError(
            f"the loop is not stable at eta = {eta[at]:.6g}: the largest {part} of a pole is {size[at]:.6g}, not < {limit:g}."
        )


def _relative(scaling: np.ndarray) -> Any:
    """The factors that convert A, entry by entry, to the units of `scaling`."""
    both = np.tile(scaling, 2)
    return both / both[:, None]


def _composite(criteria: dict[str, Any], weights: dict[str, float]) -> Any:
    """The weighted geometric mean of the ratios of each criterion to its best value."""
    logs = [weight * np.log(times_worse(name, criteria[name])) for name, weight in weights.items() if weight > 0]
    return np.exp(sum(logs) / sum(weights.values()))
