"""The ranking of fitted methods by their errors on held-out rows, and the verdict in a sentence."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from .. import checks
from ..data.record import Record
from ..diagnostics.feedback import Feedback
from ..identifiers.standing import Standing
from ..protocols import Method
from ..results import Comparison, DeadTime, Fit
from ..results.comparisons import UNLIKE, Divided, Ranked
from . import judge
from .held_out import not_fitted

GAP = 20  # missing rows between records, more than the order of any autoregression of errors
REFUSED = "no linear model explains this record"


class Before(NamedTuple):
    """What is known before any method runs: the test of feedback, whether the record counts as a loop, and the dead time."""

    feedback: Feedback | None
    closed: bool
    delay: DeadTime | None


class HeldOut(NamedTuple):
    """Errors on the held-out rows (N, p), simulated and one step ahead, the outputs there, and the rows where records end.

    Missing rows separate the records.
    """

    simulated: np.ndarray
    one_step: np.ndarray
    y: np.ndarray
    ends: list[int]

    def by(self, ahead: bool) -> np.ndarray:
        """The errors by which methods are ranked: one step ahead, or simulated."""
        return self.one_step if ahead else self.simulated


class FittedMethod(NamedTuple):
    """A method, its fit, the model in absolute units, and its errors."""

    method: Method
    fit: Fit
    model: Any
    held: HeldOut


class FailedMethod(NamedTuple):
    """A method, and why there is no fit."""

    method: Method
    why: str


def errors_of(stands: Sequence[Standing], whole: Sequence[Record], rows: Sequence[int]) -> HeldOut:
    """The errors from row `rows[i]` of each record on."""
    gap = np.full((GAP, whole[0].y.shape[1]), np.nan)
    held = [(s.simulated[n:], s.one_step[n:], r.y[n:]) for s, r, n in zip(stands, whole, rows, strict=True)]
    columns = (np.concatenate([x for part in one for x in (part, gap)]) for one in zip(*held, strict=True))
    return HeldOut(*columns, ends=np.cumsum([len(part[2]) + len(gap) for part in held]).tolist())


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def ranked(found: Sequence[FittedMethod | FailedMethod], task: Divided, before: Before) -> Comparison:
    """The methods in order, and the verdict. In a loop, where u depends on the noise, and without inputs, methods are judged one
    step ahead."""
    none, ahead = np.array([-np.inf]), before.closed or not task.first[0].inputs
    failed = [
        Ranked(one.method, None, None, none, none, failure=one.why) for one in found if isinstance(one, FailedMethod)
    ]
    fitted = [one for one in found if isinstance(one, FittedMethod)]
    if not fitted:
        return Comparison(tuple(failed), None, f"{REFUSED}: no method could be fitted to it.", task, *before, ahead)
    fits = [judge.fit_percent(one.held.by(ahead), one.held.y) for one in fitted]
    order = sorted(range(len(fitted)), key=lambda i: -float(np.mean(fits[i])))
    first, lines = fitted[order[0]].held, []
    for one in (fitted[i] for i in order):
        simulated, steps = (judge.fit_percent(e, one.held.y) for e in (one.held.simulated, one.held.one_step))
        t, ratio = judge.behind(one.held.by(ahead), first.by(ahead), first.y, first.ends)
        ran_away = judge.diverged(one.held.by(ahead), one.held.y)
        lines.append(
            Ranked(one.method, one.fit, one.model, simulated, steps, t, ratio=ratio, diverged=ran_away, ahead=ahead)
        )
    best, sentence = _verdict(lines, judge.explained(first.by(ahead), first.y), task, before)
    share = not_fitted(task)
    return Comparison((*lines, *failed), best, _unlike(share) + sentence, task, *before, ahead, share)


def _verdict(lines: list[Ranked], explained: np.ndarray, task: Divided, before: Before) -> tuple[Ranked | None, str]:
    """The best method if it explains an output, and the sentence."""
    best = lines[0]
    by = ", one step ahead" if best.ahead else ""
    if before.closed and before.delay is not None and before.delay.delay is None:
        return None, f"{REFUSED}: its input has no effect that is seen in the outputs. {before.delay.sentence}"
    if not explained.any():
        what = "prediction one step ahead" if best.ahead else "simulation"
        why = f"the best {what} ({best.name}) fits {best.shown_fit} of the held-out outputs"
        return None, f"{REFUSED}: {why}, which chance or a level fits as well."
    others = [one.label for one in lines[1:] if one.alike]
    doubt = f" Not significantly worse: {', '.join(others)}." if others else " All others are significantly worse."
    result = f"{best.label} of order {best.order} fits best: {best.shown_fit} of the held-out rows{by}."
    missing = [task.records[0].outputs[i] for i in np.flatnonzero(~explained)]
    rest = f" It does not explain {checks.listed(missing)}." if missing else ""
    seen = before.feedback
    loop = f" {seen.sentence}" if seen is not None and (seen.closed or seen.unclear) else ""
    return best, result + doubt + rest + loop


def _unlike(share: float) -> str:
    """A sentence where the judged inputs move at frequencies that were hardly fitted; otherwise empty."""
    if share <= UNLIKE:
        return ""
    return (
        f"The record cannot be split: {share:.0%} of the energy of the held-out input lies at frequencies that hardly excited "
        "the fitted part, so that the fit says little. Give a second record (`held_out`). "
    )
