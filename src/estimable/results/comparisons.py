"""The results of a comparison of identification methods."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ..data.record import Record
from ..data.trends import Trend
from ..frozen import saved
from .fits import Fit

NOISE = 2.0  # standard errors of a difference of squared errors, within which two methods are equally good
LEAD = 1.0  # points of one-step fit: below this lead the best simulation is also the best for a filter


@saved
class Ranked(NamedTuple):
    """One method: its `fit` to the first part, and its `model` (in absolute units) compared with the held-out part.

    `fits` (p,) per cent, by simulation, and `one_step_fits` (p,); `fit_percent` is the mean of the first. `behind`: by how many
    standard errors its squared errors exceed those of the best. `failure`: why there is no fit, else empty.
    """

    method: Any
    fit: Fit | None
    model: Any
    fits: np.ndarray
    one_step_fits: np.ndarray
    behind: float = 0.0
    failure: str = ""

    @property
    def name(self) -> str:
        """The class of the method."""
        return type(self.method).__name__

    @property
    def label(self) -> str:
        """The name of the method."""
        return self.method.label

    @property
    def order(self) -> int | None:
        """Number of states, or the total degree of A over all outputs; None where there is no fit."""
        if self.fit is None or self.model is None:
            return None
        na = getattr(self.fit.model, "na", None)
        return self.model.n if na is None else na * self.model.p

    @property
    def order_of_a_model(self) -> int:
        """The degree of A where there is one, else the number of states."""
        assert self.model is not None
        assert self.fit is not None
        return int(getattr(self.fit.model, "na", self.model.n))

    @property
    def fit_percent(self) -> float:
        """Mean over the outputs of the fit by simulation."""
        return float(np.mean(self.fits))

    @property
    def alike(self) -> bool:
        """Whether its difference from the best is within noise."""
        return not self.failure and bool(self.behind < NOISE)


@saved
class Divided(NamedTuple):
    """The `records`; without their `trend`: whole, and the first part of each."""

    records: Sequence[Record]
    whole: list[Record]
    first: list[Record]
    trend: Trend


@saved
class Comparison(NamedTuple):
    """The result of `compare`: the methods, the best first, failed ones last; the `best`, None where none explains the record.

    `task`: the records given to the methods, without their levels.
    """

    ranked: tuple[Ranked, ...]
    best: Ranked | None
    sentence: str
    task: Divided | None = None

    @property
    def predictor(self) -> Ranked | None:
        """The best for a filter: of the methods not significantly worse than `best`, the best one-step predictor."""
        if self.best is None:
            return None
        ahead = max((one for one in self.ranked if one.alike), key=lambda one: float(np.mean(one.one_step_fits)))
        lead = float(np.mean(ahead.one_step_fits - self.best.one_step_fits))
        return ahead if lead > LEAD else self.best
