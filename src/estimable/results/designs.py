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
    """The result of `disturbance_accommodation`: the estimator and the control law of a loop that accommodates a disturbance.

    Here x is the state of the plant (n states), and z the state of the waveform of the disturbance (q states).

    - `model`: a model of plant and waveform together, with the states (x, z). Use it in `Kalman`.
    - `feedback` (m, n + q): the gain of the law u = -feedback (x^, z^), for `StateFeedback`. Its first n columns are those of
      `lqr_gain`.
    - `filter`: the stationary Kalman gains of `model`, as from `kalman_gain`.
    - `steady` (n, q): in steady state the disturbance leaves the state at x = steady z.
    - `left` (r, q): the remaining effect of z on the outputs that should be free of it. Zero: no effect remains.
    - `poles` (n,): the eigenvalues of A - B K, with K the first n columns of `feedback`.
    - `mode`: the chosen mode.
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
        """The prior of (x, z) for `model`: the given prior of x, and z with mean zero and this `covariance`.

        `covariance` is (q, q), or one variance for all of z. None: nothing is known about z (it is diffuse).
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
    """The result of `trans_kalman`: a gain for a set of possible noise covariances, and the proof that no gain is better.

    The set has V corners, which are pairs (Q, R). The cost of a gain K at a corner is tr W P(K), with W the given weight and
    P(K) the covariance of its error there. The criterion is the cost, or the regret: the excess over the cost of
    the Kalman filter that knows the corner.

    - `filter` (n, p): the gain, x[k|k] = x[k|k-1] + filter e with e the innovation. Use it in
      `FixedGain(model, design.filter)`.
    - `covariance` (V, n, n) and `cost` (V,): the covariance of its error and its cost, at each corner.
    - `optimal` (V,): the cost of the Kalman filter that knows the corner.
    - `guessed` (V, V): entry [i, j] is the cost of the Kalman filter for corner i if corner j is true.
    - `worst`: the largest value of the criterion over the whole set.
    - `bound`: no constant gain has a smaller `worst` than this number. Where they are equal, the gain is proven to be the
      best. For a sparse gain the bound holds for sparse and full gains alike.
    - `least_favourable`: the model with the least favourable noise, a mixture of the corners. Its Kalman gain is `filter`.
      None for a sparse gain.
    - `shares` (V,): the share of each corner in that mixture.
    - `poles` (n,): the poles of the error.
    - `model` and `criterion`: those of the design.
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
        """The excess of the cost over that of the Kalman filter that knows the corner, (V,); never below 0."""
        return self.cost - self.optimal

    @property
    def relative_regret(self) -> Any:
        """The regret divided by the cost of the Kalman filter that knows the corner, (V,)."""
        return self.regret / self.optimal

    def margin(self, scaling: Numbers | None = None) -> RhoMargin:
        """The margin of the error of this filter against unmodelled coupling, as from `rho_margin`; `scaling` as there."""
        from ..analysis.rho import rho_margin

        A, C = self.model.A, self.model.C
        return rho_margin(A - self.filter @ C @ A, dt=self.model.dt, scaling=scaling)

    def to_pandas(self):
        """A DataFrame of relative costs, with a row for each filter and a column for each true corner.

        The filters are this one and the Kalman filter of each corner. An entry is the cost divided by that of the filter that
        knows the corner. The last column is the largest of its row.
        """
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
    """The best design by one criterion: its number `design`, its `bandwidth` in rad/s, and the `value` of the criterion
    there.
    """

    design: int
    bandwidth: float
    value: float


@frozen
class RhoSynthesis:
    """The result of `rho_synthesis`: N designs with their criteria, and the chosen design.

    Each design is a feedback and a filter, made from one value η of the parameter.

    - `eta` (N,): the values of η, per second.
    - `bandwidth` (N,): the bandwidth of each loop in rad/s, infinite where a sampled loop has none.
    - `criteria`: a mapping from the name of each criterion to its values (N,).
    - `composite` (N,): the weighted geometric mean of the ratios of each criterion to its best value. It is 1 at least; the
      design with the smallest is chosen.
    - `weights`: the weights of the criteria in the composite.
    - `chosen`: the number of the chosen design.
    - `feedback` (m, n) and `filter` (n, p): its gains.
    - `closed_loop` (2n, 2n): its system matrix, for the state x and the error x - x^ of the estimate.
    - `margin`: its margins, a `RhoMargin`.
    - `scaling` (n,): the size of one unit of each state, in the norms.
    - `noise`: the noise for which the criteria `dispersion` and `control` are computed.
    - `model`: the model.
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
        """The values (N,) of a criterion, divided by its best value: 1 at the best design, and greater elsewhere."""
        return times_worse(name, self.criteria[name])

    def filter_of_sample(self, dt: float) -> Any:
        """The gain (n, p) of a continuous design for samples `dt` seconds apart. Use it in
        `FixedGain(model.discretise(dt), ...)`.

        It is the integral of e^(-As) filter over one step: the innovation of a sample acts through `filter` until the next
        sample.
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
