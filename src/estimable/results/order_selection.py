"""The criteria behind the choice of an order."""

from typing import Annotated, NamedTuple

import numpy as np

from ..frozen import saved
from .fits import Fit

CRITERIA = ("bic", "aicc", "aic", "cross_validation")


@saved
class OrderSelection(NamedTuple):
    """The result of `select_order`: criteria for each of K orders, and a recommended order.

    - `orders` (K,): the orders that were tried.
    - `delays` (K,): the best delay at each order, in steps.
    - `aic`, `aicc`, `bic`, `cross_validation` (K,): the criteria at each order; smaller is better. They are in units of twice
      a log-likelihood, and infinite where the records are too short for the order.
    - `singular_values`: the singular values of a subspace model, the largest first. None where no subspace model could be
      fitted.
    - `gap`: the order at which the singular values fall most.
    - `order`: the recommended order.
    - `criterion`: the criterion that recommends it.
    """

    orders: Annotated[np.ndarray, "K"]
    delays: Annotated[np.ndarray, "K"]
    aic: Annotated[np.ndarray, "K"]
    aicc: Annotated[np.ndarray, "K"]
    bic: Annotated[np.ndarray, "K"]
    cross_validation: Annotated[np.ndarray, "K"]
    singular_values: Annotated[np.ndarray | None, "s"]
    gap: int | None
    order: int
    criterion: str

    @property
    def delay(self) -> int:
        """The delay at the recommended order."""
        return int(self.delays[np.flatnonzero(self.orders == self.order)[0]])

    def by(self, criterion: str) -> int:
        """The order that a criterion recommends."""
        return int(self.orders[np.argmin(getattr(self, criterion))])

    @property
    def sentence(self) -> str:
        """The recommended order and the orders by the other criteria, as a sentence."""
        names = {"bic": "BIC", "aicc": "AICc", "aic": "AIC", "cross_validation": "cross-validation"}
        others = [f"{names[one]} {self.by(one)}" for one in CRITERIA if one != self.criterion]
        others += [] if self.gap is None else [f"the gap of the singular values {self.gap}"]
        return f"{names[self.criterion]} recommends order {self.order}; {', '.join(others)}."

    def plot(self):
        """A plotly figure: the excess of each criterion over its best value, and the singular values."""
        from ..figures.identification_plots import plot_orders

        return plot_orders(self)


@saved
class OrderCandidate(NamedTuple):
    """One choice of orders (`na`, `nb`, `delay`), with its criteria (`aic`, `aicc`, `bic`; smaller is better) and its `fit`."""

    na: int
    nb: int
    delay: int
    aic: float
    aicc: float
    bic: float
    fit: Fit


@saved
class OrderRanking(NamedTuple):
    """The result of `choose_orders`: the `candidates`, the best first, and the `criterion` that ranks them."""

    candidates: tuple[OrderCandidate, ...]
    criterion: str

    @property
    def best(self) -> OrderCandidate:
        """The candidate with the smallest criterion."""
        return self.candidates[0]

    @property
    def sentence(self) -> str:
        """The choice and its lead, as a sentence."""
        first = self.best
        choice = f"{self.criterion.upper()} chooses na = {first.na}, nb = {first.nb}, delay = {first.delay}"
        if len(self.candidates) == 1:
            return f"{choice}: the only candidate."
        second = self.candidates[1]
        lead = getattr(second, self.criterion) - getattr(first, self.criterion)
        doubt = ": a small lead, so compare both" if lead < 2 else ""
        return f"{choice}, {lead:.1f} ahead of na = {second.na}, nb = {second.nb}, delay = {second.delay}{doubt}."


@saved
class DeadTime(NamedTuple):
    """The result of `dead_time`.

    - `delay`: the samples after which the inputs begin to act. None: no effect of the inputs is seen.
    - `alike`: the delays that fit as well.
    - `p`: the p-value of the effect of the inputs, for all the delays that were tried.
    - `at_edge`: whether the delay is at the end of the scan, so that a larger one may fit better.
    - `most`: the largest delay that was tried.
    """

    delay: int | None
    alike: tuple[int, ...]
    p: float
    at_edge: bool
    most: int

    @property
    def sentence(self) -> str:
        """The dead time as a sentence."""
        if self.delay is None:
            return f"No effect of the input is seen within {self.most} samples (p = {self.p:.2g})."
        if self.at_edge:
            return f"The dead time of {self.delay} samples is at the edge of the search: try delays above {self.most}."
        others = [str(d) for d in self.alike if d != self.delay]
        return f"The dead time is {self.delay} samples" + (f"; {', '.join(others)} fit as well." if others else ".")
