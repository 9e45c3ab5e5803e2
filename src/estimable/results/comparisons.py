"""The results of a comparison of identification methods."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ..data.record import Record
from ..data.trends import Trend
from ..frozen import saved
from .fits import Fit
from .order_selection import DeadTime

NOISE = 2.262157  # t of the differences of squared errors over ten segments, within which two methods are equally good
FACTOR = 2.0  # of the squared errors of two methods that are equally good
FARTHEST = -1000.0  # per cent: a worse fit is not printed as a number
UNLIKE = 0.5  # of the energy of the judged inputs at frequencies that were hardly fitted: beyond, the fit says little
LARGER = 1.5  # sigma relative to that for white residuals: beyond, the verdict says so
LEAD = 1.0  # points of one-step fit: below this lead the best simulation is also the best for a filter


def shown(fit: float) -> str:
    """A fit in per cent as text; "diverged" where it is far below that of a constant."""
    return f"{fit:.1f} %" if fit > FARTHEST else "diverged"


def _doubts_of(label: str, fit: Fit) -> list[str]:
    """What a fit leaves open: failed checks, other parameters, and a sigma that is not the usual one."""
    doubts: list[str] = []
    checks = {} if fit.validation is None else {check.name: check for check in fit.validation.checks}
    failed = [name for name, check in checks.items() if not check.passed]
    if failed:
        doubts.append(f"{label} fails the {'check' if len(failed) == 1 else 'checks'} {', '.join(failed)}")
    if fit.rivals is not None and len(fit.rivals):
        doubts.append(f"other parameters fit as well ({len(fit.rivals)} found)")
    if "sigma" in checks and not 1 / LARGER < (factor := checks["sigma"].value) < LARGER:
        doubts.append(f"sigma is {factor:.2g} times the white one")
    return doubts


@saved
class Ranked(NamedTuple):
    """One method of a comparison, with its fit to the first part of the records and its results on the held-out part.

    - `method`: the identifier.
    - `fit`: its `Fit` to the first part. None: the method failed.
    - `model`: the fitted model, in absolute units.
    - `fits` (p,): for each output, how well a simulation by the model fits the held-out part, in per cent.
    - `one_step_fits` (p,): the same for predictions from the previous sample.
    - `behind`: by how many standard errors the squared errors of this method exceed those of the best method, over segments
      of the held-out rows. `ratio`: the sum of its squared errors divided by that of the best method.
    - `diverged`: whether its simulation ran away from the outputs.
    - `failure`: the reason why there is no fit, otherwise empty.
    - `ahead`: whether methods were ranked by predictions one step ahead: in a closed loop, and without inputs.
    """

    method: Any
    fit: Fit | None
    model: Any
    fits: np.ndarray
    one_step_fits: np.ndarray
    behind: float = 0.0
    failure: str = ""
    ratio: float = 1.0
    diverged: bool = False
    ahead: bool = False

    @property
    def shown_fit(self) -> str:
        """The fit as text, in per cent; "diverged" where the simulation ran away."""
        return "diverged" if self.diverged else shown(self.fit_percent)

    @property
    def shown_behind(self) -> str:
        """`behind` as text, of at most six characters."""
        return f"{self.behind:.1f}" if abs(self.behind) < 1000 else "> 1000"

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
        """The mean over the outputs of the fit by which methods were ranked, in per cent."""
        return float(np.mean(self.one_step_fits if self.ahead else self.fits))

    @property
    def alike(self) -> bool:
        """Whether the method is as good as the best one within the noise, and better than the mean of the outputs."""
        good = not self.failure and not self.diverged and self.fit_percent > 0
        return bool(good and self.behind < NOISE and self.ratio < FACTOR)


@saved
class Divided(NamedTuple):
    """The records of a comparison, and what the methods were fitted to.

    - `records`: the records on which the methods were judged, from row `rows[i]` on.
    - `trend`: the levels or straight lines that were subtracted from what was fitted.
    - `whole`: the judged records without that trend; held-out ones without their own.
    - `first`: what the methods were fitted to, without the trend: the first part of each record, or whole others.
    """

    records: Sequence[Record]
    whole: list[Record]
    first: list[Record]
    trend: Trend
    rows: tuple[int, ...]


@saved
class Comparison(NamedTuple):
    """The result of `compare`: the methods, ranked by how well they simulate held-out data.

    - `ranked`: a `Ranked` for each method, the best first and the failed ones last.
    - `best`: the best of them. None where no method explains the records better than the mean of the outputs.
    - `sentence`: the verdict as a sentence.
    - `task`: the records, and the trend that was subtracted from them before the fit.
    - `feedback`: the test whether the inputs depend on the noise of the outputs. `closed`: whether the records count as made in
      a closed loop. `delay`: the dead time. None without inputs, or where the records are too short.
    - `ahead`: whether the methods were judged one step ahead, as in a loop and without inputs, instead of by simulation.
    - `unlike`: the share of the energy of the judged inputs at frequencies that hardly excited the fitted part.
    """

    ranked: tuple[Ranked, ...]
    best: Ranked | None
    sentence: str
    task: Divided | None = None
    feedback: Any = None
    closed: bool = False
    delay: DeadTime | None = None
    ahead: bool = False
    unlike: float = 0.0

    @property
    def verdict(self) -> str:
        """The verdict in one line: how many models explain the records, and what to doubt."""
        if self.best is None:
            found = "No linear model explains the record"
        else:
            alike = sum(one.alike for one in self.ranked)
            found = "One model explains the record" if alike == 1 else f"{alike} models explain the record equally well"
        return "; ".join([found, *self._doubts]) + "."

    @property
    def _doubts(self) -> list[str]:
        """What the verdict leaves open."""
        seen, late, best = self.feedback, self.delay, self.predictor
        doubts: list[str] = []
        if self.unlike > UNLIKE:
            doubts.append("its parts have different frequencies, so that the fit says little")
        if self.closed:
            doubts.append("it was made in a closed loop")
        elif seen is not None and seen.unclear:
            doubts.append("it may be a closed loop")
        if late is not None and late.at_edge:
            doubts.append("the dead time is at the edge of the search")
        return doubts if best is None or best.fit is None else doubts + _doubts_of(best.label, best.fit)

    @property
    def orders(self) -> dict[int, list[str]]:
        """The order of each method that was fitted, and the methods of each order."""
        found: dict[int, list[str]] = {}
        for one in self.ranked:
            if one.order is not None:
                found.setdefault(one.order, []).append(one.label)
        return dict(sorted(found.items()))

    @property
    def predictor(self) -> Ranked | None:
        """The method whose model is best for a filter.

        It is the best one-step predictor among the methods that are not significantly worse than `best`.
        """
        if self.best is None:
            return None
        ahead = max((one for one in self.ranked if one.alike), key=lambda one: float(np.mean(one.one_step_fits)))
        lead = float(np.mean(ahead.one_step_fits - self.best.one_step_fits))
        return ahead if lead > LEAD else self.best
