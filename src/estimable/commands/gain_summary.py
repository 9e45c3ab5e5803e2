"""The gain of a record before and after a change, and how much of it is lost."""

from typing import Any, NamedTuple

import numpy as np

from .. import diagnostics
from ..diagnostics.gain_rows import third_of
from ..phrases import decimals
from ..results import Estimate
from ..results.gain_row import SIGMAS


class GainAt(NamedTuple):
    """The gains at one time: their estimates `mean` (p,), which are medians where they are not Gaussian, and their standard
    deviations (p,): the widths of the 95 % intervals over 3.92.

    An unknown gain is NaN, with an infinite standard deviation.
    """

    time: float
    mean: np.ndarray
    sigma: np.ndarray


class GainSummary(NamedTuple):
    """The gains of a record before and after its first change (or its first third), and the detected changes.

    `overlap`: no change was detected, and the record is too short to separate before from after.
    """

    names: tuple[str, ...]
    before: GainAt
    after: GainAt
    overlap: bool
    changes: tuple[Any, ...] = ()

    @property
    def findings(self) -> tuple[str, ...]:
        """One sentence for each change, and for each gain without a change a comparison of its two values."""
        changed = {change.gain for change in self.changes}
        quiet = (self._finding(i) for i, name in enumerate(self.names) if name not in changed)
        return (*map(self._changed, range(len(self.changes))), *quiet)

    def _called(self, name: str) -> str:
        return "The gain" if len(self.names) == 1 else name

    def _changed(self, which: int) -> str:
        change, last = self.changes[which], len(self.changes) - 1
        i = self.names.index(change.gain)
        before = self.before.mean[i] if which == 0 else change.before  # the table's numbers, if it has them
        after = self.after.mean[i] if which == last else change.after
        digits = decimals(SIGMAS * change.sigma)
        was, now, spread = (f"{value:.{digits}f}" for value in (before, after, SIGMAS * change.sigma))
        when, seen = f"sample {change.onset} ± {SIGMAS * change.onset_sigma:.2g}", f"at sample {change.detected_at}"
        if change.onset_s is not None:
            when = f"{change.onset_s:.4g} ± {SIGMAS * change.onset_sigma_s:.1g} s"
            seen = f"{change.detected_at_s - change.onset_s:.2g} s later"
        verb = _verb(before, after)
        return f"{self._called(change.gain)} {verb} from {was} to {now} (2 sigma {spread}) at {when}; detected {seen}."

    def _finding(self, i: int) -> str:
        name = self._called(self.names[i])
        before, after = self.before.mean[i], self.after.mean[i]
        spread = SIGMAS * float(np.hypot(self.before.sigma[i], self.after.sigma[i]))
        if self.overlap:
            return f"{name}: the record is too short to compare before and after."
        if not np.isfinite(spread):
            return f"{name}: the record does not determine it."
        was, now, chance = (f"{value:.{decimals(spread)}f}" for value in (before, after, spread))
        if abs(after - before) <= spread:
            early, late = (f"at {one.time:.4g} s" for one in (self.before, self.after))
            return (
                f"{name}: no change is detected: {was} {early} and {now} {late} differ by less than 2 sigma ({chance})."
            )
        return f"{name} {_verb(before, after)} from {was} to {now}; chance alone explains up to {chance} (2 sigma)."


def _verb(before: float, after: float) -> str:
    return "changed" if (before < 0) != (after < 0) else "fell" if abs(after) < abs(before) else "rose"


def gain_summary(result: Estimate) -> GainSummary:
    """The gains before the first detected change, and at the end of a record.

    If no change was detected, the first are those after one third of the record. Each number is the estimate at that row with
    its own standard deviation. `findings` assumes that the errors of the two are independent. The errors of a constant gain are
    correlated, so the comparison is then conservative.
    """
    t = np.zeros(len(result.gain)) if result.t is None else np.asarray(result.t)
    median, sigma = result.gain_standing
    sigma = np.where(np.isnan(median), np.inf, sigma)
    changes = changes_of(result)
    third, short = third_of(result)
    row = max(changes[0].onset - 1, 0) if changes else third
    before, after = (GainAt(float(t[k]), median[k], sigma[k]) for k in (row, len(t) - 1))
    return GainSummary(result.names.gains, before, after, short and not changes, changes)


def changes_of(result: Estimate) -> tuple[Any, ...]:
    """The changes that a detector found; none if no detector ran."""
    return diagnostics.changes(result) if "alarm" in result.extra else ()


def by_name(names: tuple[str, ...], values: np.ndarray) -> Any:
    """A number for one gain; {name: number} for several."""
    numbers = [float(value) for value in values]
    return numbers[0] if len(numbers) == 1 else dict(zip(names, numbers, strict=True))
