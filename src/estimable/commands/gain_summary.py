"""The gain of a record before and after a change, and how much of it is lost."""

from typing import Any, NamedTuple

import numpy as np

from ..filters.unknown_gain import UnknownGain
from ..protocols import Algorithm
from ..results import Estimate
from ..tables import standard_deviation
from .numbers import decimals

WINDOW = 2.0  # seconds over which the gain is averaged
SIGMAS = 2.0  # smaller differences are not reported as a change


class GainWindow(NamedTuple):
    """The gains over an interval of a record: its times, their mean (p,), and their standard deviation at its end (p,).

    The mean is NaN and the standard deviation infinite if a gain is unknown.
    """

    start: float
    end: float
    mean: np.ndarray
    sigma: np.ndarray


class GainSummary(NamedTuple):
    """The gains of a record before and after its first change (or its first third), and the detected changes.

    `overlap`: no change was detected, and the record is too short to separate before from after.
    """

    names: tuple[str, ...]
    before: GainWindow
    after: GainWindow
    overlap: bool
    changes: tuple[Any, ...] = ()

    @property
    def findings(self) -> tuple[str, ...]:
        """One sentence for each change, and for each gain without a change a comparison of its two windows."""
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
            early, late = (f"{window.start:.4g} to {window.end:.4g} s" for window in (self.before, self.after))
            same = f"{was} and {now} differ by less than 2 sigma ({chance})"
            return f"{name}: no change is detected, {early} against {late}: {same}."
        return f"{name} {_verb(before, after)} from {was} to {now}; chance alone explains up to {chance} (2 sigma)."


def _verb(before: float, after: float) -> str:
    return "changed" if (before < 0) != (after < 0) else "fell" if abs(after) < abs(before) else "rose"


def gain_summary(result: Estimate) -> GainSummary:
    """The gains over the 2 s before the first detected change, and over the last 2 s of a record (at most since the last
    change was detected).

    If no change was detected, the first window ends at one third of the record. The mean is that of the estimates in the
    window. The standard deviation is that of its last estimate, which uses all earlier samples. `findings` assumes that the
    errors of the two windows are independent. The errors of a constant gain are correlated, so the comparison is then
    conservative. A window without a sample uses the last sample before its end.
    """
    t = np.zeros(len(result.gain)) if result.t is None else np.asarray(result.t)
    sigma = standard_deviation(result.gain_covariance, result.extra.get("gain_diffuse_covariance"))
    known = np.where(np.isfinite(sigma), result.gain, np.nan)
    changes = changes_of(result)
    before = float(t[max(changes[0].onset - 1, 0)]) if changes else float(t[0] + (t[-1] - t[0]) / 3)
    begun = changes[-1].detected_at if changes else 0
    return GainSummary(
        result.names.gains, _window(t, known, sigma, before), _window(t, known, sigma, t[-1], begun),
        overlap=bool(before > t[-1] - WINDOW) and not changes, changes=changes,
    )  # fmt: skip


def changes_of(result: Estimate) -> tuple[Any, ...]:
    """The changes that a detector found; none if no detector ran."""
    from .. import diagnostics

    return diagnostics.changes(result) if "alarm" in result.extra else ()


def _window(t: np.ndarray, gain: np.ndarray, sigma: np.ndarray, end: float, first: int = 0) -> GainWindow:
    """The `WINDOW` seconds up to `end`, not before row `first`."""
    last = int(np.searchsorted(t, end, side="right")) - 1
    rows = slice(min(max(first, int(np.searchsorted(t, end - WINDOW, side="right"))), last), last + 1)
    seen = ~np.isnan(gain[rows])
    count = seen.sum(axis=0)
    mean = np.where(count, np.nansum(gain[rows], axis=0) / np.maximum(count, 1), np.nan)
    start = min(max(t[first], end - WINDOW), t[last])
    return GainWindow(float(start), float(end), mean, sigma[last])


def is_effectiveness(algorithm: Algorithm[Any]) -> bool:
    """Whether a gain of 1 means the full effect in the model, so that 1 minus the gain is the part that is lost."""
    inner = algorithm.innermost
    if not isinstance(inner, UnknownGain) or not isinstance(inner.directions, str):
        return False
    return inner.directions in ("one", "per_input") and inner.fixed is None


def by_name(names: tuple[str, ...], values: np.ndarray) -> Any:
    """A number for one gain; {name: number} for several."""
    numbers = [float(value) for value in values]
    return numbers[0] if len(numbers) == 1 else dict(zip(names, numbers, strict=True))
