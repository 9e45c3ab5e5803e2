# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false
"""The results of designs: gains, with their margins or costs."""

from typing import Annotated, Any, NamedTuple

import numpy as np

from .. import checks
from ..annotations import Numbers
from ..frozen import frozen, saved, static
from ..models.discretisation import over
from ..models.prior import Prior
from ..models.state_space import StateSpace
from .margins import RhoMargin
from .stationary_gains import KalmanGain

BEST = {
    "response_time": "smallest",
    "rho": "largest",
    "sigma": "largest",
    "external": "smallest",
    "peak_gain": "smallest",
    "dispersion": "smallest",
    "control": "smallest",
    "static_error": "smallest",
    "resonance": "smallest",
    "magnification": "smallest",
}  # fmt: skip  of a loop's criteria, which value is best


@frozen
class DisturbanceAccommodation:
    """The result of `disturbance_accommodation`.

    `model`: the composite of plant and waveform, states (x, z), for `Kalman`. `feedback` (m, n + q), for `StateFeedback`:
    u = -feedback (x^, z^); the part for x is that of `lqr_gain`. `filter`: the stationary gains of the composite, as from
    `kalman_gain`. `steady` (n, q): in steady state x = steady z. `left` (r, q): the remaining effect of z on the freed outputs.
    `poles` (n,) of A - B K.
    """

    model: StateSpace
    feedback: Annotated[Any, "m N"]
    filter: KalmanGain
    steady: Annotated[Any, "n q"]
    left: Annotated[Any, "r q"]
    poles: Annotated[Any, "n"]
    mode: str = static()

    @property
    def order(self) -> int:
        """The number of states of the waveform."""
        return self.steady.shape[1]

    def prior(self, of_state: Prior, covariance: Numbers | None = None) -> Prior:
        """The prior of the composite: that of the state, and z with mean zero and this `covariance` (q, q), or one variance.

        None: z is diffuse.
        """
        faults, q = checks.Faults(), self.order
        n = self.model.n - q
        if faults.instance("of_state", of_state, Prior) and of_state.size != n:
            faults.add(f"`of_state` must be a prior of n = {n} states: the plant has as many. Got {of_state.size}.")
        faults.learn("q", q, f"the waveform has {checks.counted(q, 'state')}")
        given: Any = covariance
        given = given * np.eye(q) if given is not None and checks.depth(given) == 0 else given
        V = np.zeros((q, q)) if given is None else faults.covariance("covariance", given, "q q")
        faults.finish()
        known = (
            []
            if of_state.diffuse is None
            else [np.vstack([of_state.diffuse, np.zeros((q, of_state.diffuse.shape[1]))])]
        )
        unknown = [np.vstack([np.zeros((n, q)), np.eye(q)])] if covariance is None else []
        P = np.block([[of_state.covariance, np.zeros((n, q))], [np.zeros((q, n)), V]])
        diffuse = np.hstack(known + unknown) if known + unknown else None
        return Prior(np.append(of_state.mean, np.zeros(q)), P, diffuse=diffuse)

    def __repr__(self) -> str:
        size = np.linalg.norm(self.left, 2)
        left = "no effect on the outputs remains" if size == 0 else f"an effect of {size:.3g} on the outputs remains"
        return f"DisturbanceAccommodation({self.mode} of {checks.counted(self.order, 'waveform state')}: {left})"


@frozen
class TransKalman:
    """The result of `trans_kalman`. The set of noises has V corners; the cost of a gain K at a corner is tr W P(K).

    `filter` (n, p): x[k|k] = x[k|k-1] + filter e, for `FixedGain(model, design.filter)`. `covariance` (V, n, n) of its error, and
    `cost` (V,), at each corner; `optimal` (V,): the cost of the Kalman filter that knows the corner; `guessed` (V, V): at [i, j]
    that of the Kalman filter tuned for corner i where corner j is true.

    The certificate: `worst` is the largest value of the criterion over the whole set; `bound`: no constant gain has less (for a
    sparse one: no gain, sparse or not). `shares` (V,) of the least favourable mixture of the corners, and `least_favourable`, the
    model with that noise, whose Kalman gain is `filter`; None for a sparse gain. `poles` (n,) of the error.
    """

    filter: Annotated[Any, "n p"]
    covariance: Annotated[Any, "V n n", "symmetric"]
    cost: Annotated[Any, "V"]
    optimal: Annotated[Any, "V"]
    guessed: Annotated[Any, "V V"]
    worst: float
    bound: float
    shares: Annotated[Any, "V"]
    least_favourable: StateSpace | None
    poles: Annotated[Any, "n"]
    model: StateSpace
    criterion: str = static()

    @property
    def regret(self) -> Any:
        """The excess cost over the Kalman filter that knows the noise, (V,); never below 0."""
        return self.cost - self.optimal

    @property
    def relative_regret(self) -> Any:
        """The same relative to the cost of that filter, (V,)."""
        return self.regret / self.optimal

    def margin(self, scaling: Numbers | None = None) -> RhoMargin:
        """How much unmodelled coupling the error tolerates; `scaling` as in `rho_margin`."""
        from ..analysis.rho import rho_margin

        A, C = self.model.A, self.model.C
        return rho_margin(A - self.filter @ C @ A, dt=self.model.dt, scaling=scaling)

    def to_pandas(self):
        """A DataFrame: a row for each filter (this one, and the Kalman filter of each corner), a column for each true corner:
        cost relative to that of the filter that knows the noise; the last column is the worst of the row."""
        import pandas as pd

        rows = np.vstack([self.cost, self.guessed]) / self.optimal
        corners = [str(i) for i in range(len(self.cost))]
        names = ["trans-Kalman", *(f"Kalman of {i}" for i in corners)]
        return pd.DataFrame(rows, index=names, columns=corners).assign(worst=rows.max(axis=1))

    def __repr__(self) -> str:
        return (
            f"TransKalman({self.criterion} {self.worst:.4g} at worst, {self.bound:.4g} at least; {len(self.cost)} corners; "
            f"largest pole {np.abs(self.poles).max():.4g})"
        )


@saved
class Optimum(NamedTuple):
    """The optimum of a criterion: the number of the design, its bandwidth, and the criterion's value there."""

    design: int
    bandwidth: float
    value: float


@frozen
class RhoSynthesis:
    """The result of `rho_synthesis`: N designs, and the chosen one.

    `eta` (N,); `bandwidth` (N,) rad/s, infinite where a sampled loop has none; `criteria`: each criterion's name and its values
    (N,); `composite` (N,): the weighted geometric mean of the ratios of each criterion to its best value, 1 at least; `weights`
    of the criteria; `chosen`: the number of the chosen design, with its `feedback` (m, n), `filter` (n, p), `closed_loop`
    (2n, 2n) of (x, x - x^), and `margin`. `scaling` (n,): the units of the states in the norms; `noise`: the noise to which
    `dispersion` and `control` refer.
    """

    eta: Annotated[Any, "N"]
    bandwidth: Annotated[Any, "N"]
    criteria: Annotated[Any, "N"]
    composite: Annotated[Any, "N"]
    chosen: int = static()
    feedback: Annotated[Any, "m n"]
    filter: Annotated[Any, "n p"]
    closed_loop: Annotated[Any, "c c"]
    margin: RhoMargin
    weights: Any
    scaling: Annotated[Any, "n"]
    noise: str = static()
    model: StateSpace

    @property
    def optima(self) -> dict[str, Optimum]:
        """The optimum of each criterion, and of the composite."""
        found = {name: best_of(name, values) for name, values in self.criteria.items()}
        found["composite"] = int(np.argmin(self.composite))
        series = {**self.criteria, "composite": self.composite}
        return {name: Optimum(i, float(self.bandwidth[i]), float(series[name][i])) for name, i in found.items()}

    def times_worse(self, name: str) -> Any:
        """The ratio of a criterion to its best value at each design, (N,): 1 at its optimum."""
        return times_worse(name, self.criteria[name])

    def filter_of_sample(self, dt: float) -> Any:
        """For a continuous design, the gain (n, p) of a sample of `dt` seconds, for `FixedGain(model.discretise(dt), ..)`.

        The innovation then acts through `filter` until the next sample: it is the integral of e^(-As) filter over a step.
        """
        if not self.model.is_continuous:
            checks.refuse("this design is discrete: `filter` already applies to a sample.")
        faults = checks.Faults()
        dt = faults.number("dt", dt, above=0.0, unit="seconds")
        faults.finish()
        eye = np.eye(self.model.n)
        return over(-self.model.A, eye, 0 * eye, dt, hold="zero_order")[1] @ self.filter

    def plot(self) -> Any:
        """All criteria over the bandwidth, each relative to its best, with the optima marked: a plotly figure."""
        from ..figures.tuning_plots import plot_tuning

        return plot_tuning(self)

    def __repr__(self) -> str:
        i = self.chosen
        return (
            f"RhoSynthesis({len(self.eta)} designs; chosen eta {self.eta[i]:.4g}, bandwidth {self.bandwidth[i]:.4g} rad/s, "
            f"rho {self.margin.margin:.4g})"
        )


def times_worse(name: str, values: np.ndarray) -> Any:
    """The ratio of a criterion to its best value: 1 at its optimum."""
    best = values[best_of(name, values)]
    return best / values if BEST[name] == "largest" else values / best


def best_of(name: str, values: np.ndarray) -> int:
    """The number of the design at which a criterion is best."""
    return int((np.nanargmax if BEST[name] == "largest" else np.nanargmin)(values))
