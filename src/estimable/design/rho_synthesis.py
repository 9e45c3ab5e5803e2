"""Feedback and filter gains by one number, chosen where the loop bears most, or by what it costs."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from .. import checks
from ..analysis.observability import observability, reachability
from ..analysis.rho import RhoMargin, rho_margin
from ..errors import AssumptionError
from ..frozen import frozen, static
from ..kernels.riccati import care, dare
from ..models.constant import check_constant
from ..models.discretisation import over
from ..models.state_space import StateSpace
from . import loop_criteria
from .families import DesignFamily, joint
from .gains import kalman_gain
from .loop_criteria import BEST, CRITERIA

NUMBER = 200   # of designs
RANGE = 30.0   # times and parts of the plant's own speed, between which η goes
FASTEST = 4.0  # η dt, of discrete designs: e^-4 is left of a motion after a sample


class Optimum(NamedTuple):
    """Where a criterion is best: the index of the design, its bandwidth, and the criterion's value there."""

    index: int
    bandwidth: float
    value: float


@frozen
class RhoSynthesis:
    """What `rho_synthesis` returns: N designs, and the one that was chosen.

    `eta` (N,); `bandwidth` (N,) rad/s, infinite where a sampled loop has none; `criteria`: each criterion's name and its values
    (N,); `composite` (N,): the weighted geometric mean of how many times worse than its own best each criterion is, 1 at least;
    `weights` of the criteria; `chosen`: the index. Of the chosen design: `feedback` (m, n), `filter` (n, p), `closed_loop` (2n, 2n) of
    (x, x - x^), and its `margin`. `scaling` (n,): the units of the states in the norms; `noise`: which noise `dispersion` and
    `control` are of.
    """

    eta: Any
    bandwidth: Any
    criteria: Any
    composite: Any
    chosen: int = static()
    feedback: Any
    filter: Any
    closed_loop: Any
    margin: RhoMargin
    weights: Any
    scaling: Any
    noise: str = static()
    model: StateSpace

    @property
    def optima(self) -> dict[str, Optimum]:
        """Where each criterion, and the composite, is best."""
        found = {name: _best(name, values) for name, values in self.criteria.items()}
        found["composite"] = int(np.argmin(self.composite))
        series = {**self.criteria, "composite": self.composite}
        return {name: Optimum(i, float(self.bandwidth[i]), float(series[name][i])) for name, i in found.items()}

    def filter_of_sample(self, dt: float) -> Any:
        """Of a continuous design, the gain (n, p) of a sample that lasts `dt` seconds, for `FixedGain(model.discretise(dt), ..)`.

        The innovation then acts through `filter` until the next sample: it is the integral of e^(-As) filter over a step.
        """
        if not self.model.is_continuous:
            checks.refuse("`filter` is of a sample already: this design is discrete.")
        faults = checks.Faults()
        dt = faults.number("dt", dt, above=0.0, unit="seconds")
        faults.finish()
        eye = np.eye(self.model.n)
        return over(-self.model.A, eye, 0 * eye, dt, hold="zero_order")[1] @ self.filter

    def plot(self) -> Any:
        """All criteria over the bandwidth, each relative to its best, with the optima marked: a plotly figure."""
        from ..figures.tuning import plot_tuning

        return plot_tuning(self)

    def __repr__(self) -> str:
        i = self.chosen
        return (
            f"RhoSynthesis({len(self.eta)} designs; chosen eta {self.eta[i]:.4g}, bandwidth {self.bandwidth[i]:.4g} rad/s, "
            f"rho {self.margin.margin:.4g})"
        )


def rho_synthesis(
    model: StateSpace, *, eta: Any = None, control: Any = None, filter: Any = None,
    weights: Mapping[str, float] | None = None, scaling: Any = None,
) -> RhoSynthesis:  # fmt: skip
    """Go through one-parameter families of feedback and filter gains, and choose by robustness or by a weighted composite.

    Model: constant, continuous or discrete, with inputs; u = -K x^, with x^ of a filter of gain L. For each η the loop is
    A = [[A - B K, B K], [0, A - L C]] in (x, x - x^) (discrete: the filtered x^), of which every criterion is computed:

    - `response_time`: until an impulse in any direction is below 5 % for good, seconds
    - `rho`, `sigma`: what the loop bears that is not modelled, as in `rho_margin`
    - `external`: 1 / rho, the bound of the state under a bounded force; `peak_gain`: the largest that force makes of one state
    - `dispersion`, `control`: rms of (x, x - x^), and of u, under the model's noise (unit white noise where it has none)
    - `static_error`: ||A^-1|| (discrete ||(I - A)^-1||), the state per constant force
    - `resonance`: the largest of ||(iωI - A)^-1|| over frequency; `magnification`: that over `static_error`

    and the bandwidth sqrt(σ_min(A) σ_max(A)) (discrete: of log(A) / dt).

    `eta` (N,), increasing, per second (default 200 values around the plant's own speeds). `control`, `filter`: a `DesignFamily`, or fixed
    gains, (m, n) and (n, p); default `DesignFamily.approach` and `approach_of_error`; `filter="kalman"` is that
    of the model's Q and R. `weights`: {criterion: weight >= 0}, by whose composite to choose; default {"rho": 1}. `scaling` (n,): the
    size of one unit of each state; None: the states as they are. All of it depends on them.

    Raises `InputError`, also for weights that are not positive semidefinite at some η; `AssumptionError` where the model is not
    stabilisable and detectable, or a loop not stable. Norms over time are followed to about 3 %; `margin`, of the chosen loop, is
    exact to the safe side. Cost: about 10 ms a design at n = 8.

    Reference: R. W. Bass (2005), slides on rho synthesis; the default family and the composite are ours.

    >>> mass = StateSpace([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]], dt=0)
    >>> found = rho_synthesis(mass, eta=[0.5, 1.0, 2.0])
    >>> found.chosen, found.feedback.round(6).tolist()
    (1, [[1.0, 2.0]])
    """
    plan = _read(model, eta, control, filter, weights, scaling)
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


class _Plan(NamedTuple):
    """A call, read: `control` and `filter` are families or fixed gains."""

    eta: Any
    control: Any
    filter: Any
    weights: dict[str, float]
    scaling: Any


def _read(model: Any, eta: Any, control: Any, filter: Any, weights: Any, scaling: Any) -> _Plan:
    faults = checks.Faults()
    if faults.instance("model", model, StateSpace):
        check_constant(model, faults)
        if model.m == 0:
            faults.add("`model` has no input: give B, StateSpace(A, B, ...).")
    faults.finish()
    n, m, p = model.n, model.m, model.p
    for axis, size, noun in (("n", n, "state"), ("m", m, "input"), ("p", p, "output")):
        faults.learn(axis, size, f"the model has {checks.counted(size, noun)}")
    eta = faults.array("eta", _default_eta(model) if eta is None else eta, "N")
    if eta is not None and (len(eta) == 0 or np.any(eta <= 0) or np.any(np.diff(eta) <= 0)):
        faults.add("`eta` must be rates per second, greater than 0 and increasing.")
    control = _read_part("control", control, DesignFamily.approach, (n, m), "m n", model, faults)
    filter = _read_filter(filter, model, faults)
    weights = _read_weights(weights, faults)
    scaling = faults.array("scaling", np.ones(n) if scaling is None else scaling, "n")
    if scaling is not None and np.any(scaling <= 0):
        faults.add(f"`scaling` must be sizes, greater than 0. Got {scaling.min():g}.")
    if not faults.sentences and not isinstance(control, DesignFamily) and not isinstance(filter, DesignFamily):
        faults.add("`control` and `filter` are both fixed gains, so that nothing depends on `eta`: leave one out.")
    if not faults.sentences:
        _check_families(eta, control, filter, model, faults)
    faults.finish()
    _check_reach(model)
    return _Plan(eta, control, filter, weights, scaling)


def _read_part(name: str, given: Any, default: Any, sizes: tuple[int, int], axes: str, model, faults) -> Any:
    """A family of the right sizes, or a fixed gain."""
    if given is None:
        return default(model)
    if not isinstance(given, DesignFamily):
        return faults.array(name, given, axes)
    if (given.n, given.m) != sizes:
        faults.add(f"`{name}` must be a family of (n, {axes.split()[0]}) = {sizes}. Got {(given.n, given.m)}.")
    return given


def _read_filter(given: Any, model: StateSpace, faults: checks.Faults) -> Any:
    if isinstance(given, str):
        faults.choice("filter", given, ("kalman",))
        return kalman_gain(model).filter if given == "kalman" and model.R is not None else _without_noise(given, faults)
    return _read_part(
        "filter", given, DesignFamily.approach_of_error, (model.n, model.p), "n p", model, faults
    )


def _without_noise(given: str, faults: checks.Faults) -> None:
    if given == "kalman":
        faults.add('`filter` = "kalman" needs `R` and Q in the model: StateSpace(..., Q=..., R=...).')


def _read_weights(given: Any, faults: checks.Faults) -> dict[str, float]:
    """Weights of known criteria, not all zero."""
    if given is None:
        return {"rho": 1.0}
    if not isinstance(given, Mapping):
        faults.add(f"`weights` must be a mapping {{criterion: weight}}. Got {checks.short(given)}.")
        return {}
    for name in given:
        if name not in CRITERIA:
            near = checks.suggestion(name, CRITERIA)
            faults.add(f"`weights`: there is no criterion {name!r}. There are {checks.listed(CRITERIA)}.{near}")
    read = {name: faults.number(f"weights[{name!r}]", value, lower=0.0) for name, value in given.items()}
    if all(value == 0 for value in read.values()):
        faults.add("`weights` must hold a weight that is not zero.")
    return read


def _check_families(eta, control, filter, model: StateSpace, faults: checks.Faults) -> None:
    """Weights must be positive semidefinite together, and what costs nothing must not be free for ever."""
    for name, family in (("control", control), ("filter", filter)):
        if not isinstance(family, DesignFamily):
            continue
        smallest = [joint(*family.at(η)) for η in eta]
        if min(smallest) < -1e-11:
            at = int(np.argmin(smallest))
            faults.add(
                f"`{name}`: [[Q, S], [S.T, R]] must be positive semidefinite: at eta = {eta[at]:g} its smallest eigenvalue is "
                f"{smallest[at]:.3g} of its largest entry. Families by `DesignFamily.factored` always are."
            )
            continue
        if name == "filter" and not model.is_continuous and not family.next_output and (np.any(family.S0) or np.any(family.S1)):
            faults.add("`filter`: of a discrete filter S must be zero, or of the next output (`next_output`).")
        if np.linalg.matrix_rank(family.R, hermitian=True) < family.m and (model.is_continuous or name == "filter"):
            what = "two inputs do the same" if name == "control" else "two outputs say the same"
            faults.add(f"`{name}`: R must be positive definite. It is not where {what}: give a DesignFamily with another R.")


def _check_reach(model: StateSpace) -> None:
    reached, seen = reachability(model), observability(model)
    if not reached.stabilisable:
        raise AssumptionError(f"`model` cannot be stabilised: a mode that does not die out is not moved. {_said(reached)}")
    if not seen.detectable:
        raise AssumptionError(f"`model` is not detectable: a mode that does not die out is not seen. {_said(seen)}")


def _said(found: Any) -> str:
    return " ".join(found.sentences)


def _default_eta(model: StateSpace) -> Any:
    """Around the geometric mean of the plant's own speeds."""
    z = np.linalg.eigvals(model.A)
    if not model.is_continuous:
        z = np.log(z[np.abs(z) > 1e-12].astype(complex)) / model.dt
    speeds = np.abs(z)
    speeds = speeds[speeds > 1e-6 * (speeds.max(initial=0.0) or 1.0)]
    middle = float(np.exp(np.log(speeds).mean())) if len(speeds) else (1.0 if model.is_continuous else 0.1 / model.dt)
    top = RANGE * middle if model.is_continuous else min(RANGE * middle, FASTEST / model.dt)
    return np.geomspace(top / RANGE**2, top, NUMBER)


def _gains(model: StateSpace, plan: _Plan, η: float) -> tuple[Any, Any]:
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


def _loop(model: StateSpace, K: Any, gain: Any) -> Any:
    """The motion of (x, x - x^)."""
    A, B, C, n = model.A, model.B, model.C, model.n
    error = A - gain @ C if model.is_continuous else A - gain @ C @ A
    return np.block([[A - B @ K, B @ K], [np.zeros((n, n)), error]])


def _check_stable(model: StateSpace, eta: Any, loops: Any) -> None:
    z = np.linalg.eigvals(loops)
    size = z.real.max(axis=1) if model.is_continuous else np.abs(z).max(axis=1)
    at, limit = int(np.argmax(size)), 0.0 if model.is_continuous else 1.0
    if size[at] >= limit:
        part = "real part" if model.is_continuous else "modulus"
        raise AssumptionError(
            f"the loop is not stable at eta = {eta[at]:.6g}: the largest {part} of a pole is {size[at]:.6g}, not < {limit:g}."
        )


def _relative(scaling: Any) -> Any:
    """What A is multiplied by, entry by entry, in the units of `scaling`."""
    both = np.tile(scaling, 2)
    return both / both[:, None]


def _composite(criteria: dict[str, Any], weights: dict[str, float]) -> Any:
    """The weighted geometric mean of how many times worse than its best each criterion is."""
    logs = [weight * np.log(relative(name, criteria[name])) for name, weight in weights.items() if weight > 0]
    return np.exp(sum(logs) / sum(weights.values()))


def relative(name: str, values: Any) -> Any:
    """How many times worse than its best a criterion is: 1 at its optimum."""
    best = values[_best(name, values)]
    return best / values if BEST[name] == "largest" else values / best


def _best(name: str, values: Any) -> int:
    return int((np.nanargmax if BEST[name] == "largest" else np.nanargmin)(values))
