"""What the choice of an order rests on."""

from typing import Annotated, NamedTuple

import numpy as np

from ..frozen import saved

CRITERIA = ("bic", "aicc", "aic", "cross_validation")


@saved
class OrderSelection(NamedTuple):
    """What `select_order` returns: of each of `orders` (K,) the criteria (K,), in units of twice a log-likelihood.

    `aic`, `aicc`, `bic`, `cross_validation`: infinite where the records do not bear the order; `delays` (K,): the best at
    each order; `singular_values` (largest first, None: no subspace model could be made), `gap`: the order before their
    largest step; `order`: the recommendation, by `criterion`.
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
        """The delay that goes with the recommended order."""
        return int(self.delays[np.flatnonzero(self.orders == self.order)[0]])

    def by(self, criterion: str) -> int:
        """The order that a criterion recommends."""
        return int(self.orders[np.argmin(getattr(self, criterion))])

    @property
    def sentence(self) -> str:
        """What is recommended, and what others would take."""
        names = {"bic": "BIC", "aicc": "AICc", "aic": "AIC", "cross_validation": "cross-validation"}
        others = [f"{names[one]} {self.by(one)}" for one in CRITERIA if one != self.criterion]
        others += [] if self.gap is None else [f"the gap of the singular values {self.gap}"]
        return f"{names[self.criterion]} recommends order {self.order}; {', '.join(others)}."

    def plot(self):
        """A plotly figure: how far each criterion lies above its best, and the singular values."""
        from ..figures.identification_plots import plot_orders

        return plot_orders(self)
