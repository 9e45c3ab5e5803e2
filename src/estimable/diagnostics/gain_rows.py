"""What a record says of each gain: before, after, the change between them."""

import numpy as np

from .. import checks
from ..results import DetectableLoss, Estimate, GainRow
from ..results.gain_row import SIGMAS, sentence_of
from .changes import SIGNIFICANT, DetectedChange, changes

__all__ = ["gain_rows", "sentence_of"]
THIRD = 1 / 3  # of the record, at which a gain without a change is compared with its end
SHORT = 2.0  # seconds: a record whose first third ends later than this before its end is too short to compare
EXACT = 0.01  # a gain that is known to this counts as 1


def gain_rows(result: Estimate, *, detectable: DetectableLoss | None = None) -> tuple[GainRow, ...]:
    """What a record says of each gain, one row for each: before, after, when, and a verdict.

    `result`: an estimate with a gain, made by `estimate` with `keep="all"`. `detectable`: what the same record would have shown.
    `sentence_of(rows)` is one sentence about all of them.

    Returns a tuple of `GainRow`s. Raises `InputError` for a result without a gain.

    >>> model = StateSpace([[0.5]], [[1.0]], Q=[[0.0]], R=[[0.01]], dt=1)
    >>> record = Record([0.0, 1.0, 1.5, 1.75, 1.4, 1.2], np.ones(6), dt=1)
    >>> watched = ChangeDetection(UnknownGain(model, Prior([1.0], [[0.0]])), jump=1.0)
    >>> rows = diagnostics.gain_rows(estimate(watched, record, prior=Prior([0.0], [[0.0]])))
    >>> diagnostics.sentence_of(rows)
    'gain lost 47 % ± 13 % at 3 s.'
    """
    if not isinstance(result, Estimate) or result.gain is None or len(result.gain) == 0:
        checks.refuse(f"`result` must be an estimate with a gain. Got {checks.short(result)}.")
    found = changes(result) if "alarm" in result.extra else ()
    effect = result.origin is not None and result.origin.algorithm.innermost.gain_is_effectiveness
    return tuple(_row(result, i, found, effect, detectable) for i in range(result.gain.shape[1]))


def third_of(result: Estimate) -> tuple[int, bool]:
    """The row after a third of the record, and whether it is too near the end for a comparison."""
    t = np.zeros(len(result.gain)) if result.t is None else np.asarray(result.t)
    row = int(np.searchsorted(t, t[0] + THIRD * (t[-1] - t[0]), "right")) - 1
    return row, bool(t[row] > t[-1] - SHORT)


def _row(
    result: Estimate, i: int, found: tuple[DetectedChange, ...], effect: bool, detectable: DetectableLoss | None
) -> GainRow:
    name, (median, sigma) = result.names.gains[i], result.gain_standing
    own = [change for change in found if change.gain == name]
    third, short = third_of(result)
    row = max(own[0].onset - 1, 0) if own else third
    before, after = ((float(median[k, i]), float(sigma[k, i])) for k in (row, -1))
    shown = np.nan if detectable is None else float(detectable.loss[i, -1])
    return GainRow(
        name, *before, *after,
        changed_at=tuple(float(change.onset if change.onset_s is None else change.onset_s) for change in own),
        timed=result.t is not None, effectiveness=effect, verdict=_verdict(before, after, bool(own), short, effect),
        detectable=shown,
    )  # fmt: skip


def _verdict(before: tuple[float, float], after: tuple[float, float], jumped: bool, short: bool, effect: bool) -> str:
    (was, was_sigma), (now, now_sigma) = before, after
    if not np.isfinite(now) or not (np.isfinite(was) or jumped):
        return "unknown"
    apart = abs(now - was) / max(np.hypot(was_sigma, now_sigma), 1e-300)
    if jumped and apart > SIGMAS:
        whole = effect and abs(was - 1) <= max(SIGMAS * was_sigma, EXACT)
        if whole and 0 <= now < 1:
            return "lost"
        return "changed" if (was < 0) != (now < 0) else "fell" if abs(now) < abs(was) else "rose"
    if jumped or short or apart > SIGNIFICANT:
        return "jumped" if jumped else "too short" if short else "moved"
    return "steady" if effect and abs(now - 1) > max(SIGMAS * now_sigma, EXACT) else "unchanged"
