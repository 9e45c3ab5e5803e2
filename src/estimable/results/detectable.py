# pyright: reportMissingTypeStubs=false
"""The smallest loss that a record would have shown: the result of `detectable_loss`."""

from typing import Any, NamedTuple

import numpy as np

from ..frozen import saved
from .gain_row import GainRow, sentence_of
from .trusts import Trust

QUIET, SHORTEST = 0.05, 1.0  # a shorter end without information is not reported: part of the interval, and seconds


@saved
class DetectableLoss(NamedTuple):
    """The result of `detectable_loss`, for p gains.

    - `start`, `end` [s]: when the loss begins, and until when it must raise an alarm.
    - `power` (k,): the probabilities of an alarm. `loss` (p, k): the losses that raise one with these probabilities, in units
      of the gain; infinite where no loss does.
    - `floor_sigma` (p,): the standard deviation with which the record determines a jump at `start`: no method shows a loss
      below twice that.
    - `informed_until` (p,): the time in seconds after which the inputs add less than 1 % to the information about such a jump.
    - `delay` (p, k): the median time from `start` to the alarm, in seconds.
    - `gains` (p,): the names of the gains.
    - `intervals`: the same for each interval of the record (`every`), of losses that begin with the interval and show before
      it ends. `to_pandas()` has them as a table.
    """

    start: float
    end: float
    power: tuple[float, ...]
    loss: Any
    floor_sigma: Any
    informed_until: Any
    delay: Any
    gains: tuple[str, ...]
    intervals: tuple["DetectableLoss", ...] = ()

    def to_pandas(self):
        """A DataFrame, one row for each gain and interval (without intervals, for each gain): `start`, `end`, the loss for each
        power, and `floor_sigma`.
        """
        import pandas as pd

        return pd.DataFrame([
            {
                "gain": name, "start": one.start, "end": one.end,
                **{f"loss_{100 * power:.3g}": loss for power, loss in zip(one.power, one.loss[i], strict=True)},
                "floor_sigma": one.floor_sigma[i],
            }
            for i, name in enumerate(self.gains) for one in self.intervals or (self,)
        ])  # fmt: skip

    @property
    def sentences(self) -> tuple[str, ...]:
        """A sentence for each gain."""
        return tuple(self._of(i, name) for i, name in enumerate(self.gains))

    @property
    def quiet(self) -> dict[str, tuple[float, float]]:
        """The interval up to `end` in which the inputs carry no information about a gain, for the gains that have one."""
        long = max(QUIET * (self.end - self.start), SHORTEST)
        ends = zip(self.gains, map(float, self.informed_until), strict=True)
        return {name: (until, self.end) for name, until in ends if self.end - until > long}

    @property
    def still(self) -> tuple[str, ...]:
        """A sentence for each gain whose value at the end is an old one."""
        called = {"gain": "the gain"}
        return tuple(
            f"After {until:.4g} s the input carries no information about {called.get(name, name)}; the value is that of "
            f"{until:.4g} s."
            for name, (until, _) in self.quiet.items()
        )

    def _of(self, i: int, name: str) -> str:
        loss, power = float(self.loss[i, -1]), 100 * self.power[-1]
        if not np.isfinite(loss):
            return f"No loss of {name} that began at {self.start:.4g} s would have been detected by {self.end:.4g} s."
        return (
            f"A loss of {name} of {loss:.2g} that began at {self.start:.4g} s would have been detected by {self.end:.4g} s with "
            f"probability {power:.0f} %."
        )


@saved
class GainAssessment(NamedTuple):
    """The result of `assess_gain`: the gain of a record, and whether to believe it.

    - `result`: the `Estimate`, whose `gain_quantiles` give the median and the 95 % interval.
    - `algorithm`: the algorithm that ran; `plain`: the filter of a constant gain whose model `trust` judged.
    - `trust`: the verdict. `detectable`: the smallest loss that would have been detected; None where none can be said.
    - `noise`: the `NoiseFit` of the model; None where its own noises remain.
    - `notes`: what was prepared, as sentences.
    - `rows`: a `GainRow` for each gain: before, after, when, and what happened. `finding`: the same in one sentence.
    """

    result: Any
    algorithm: Any
    plain: Any
    trust: Trust
    detectable: DetectableLoss | None
    noise: Any = None
    notes: tuple[str, ...] = ()
    rows: tuple[GainRow, ...] = ()

    @property
    def sentence(self) -> str:
        """The verdict as one sentence."""
        return self.trust.sentence

    @property
    def finding(self) -> str:
        """What happened to the gains, as one sentence."""
        return sentence_of(self.rows)


def size_of(loss: float) -> str:
    """A loss in units of the gain; a dash where none would be detected.

    >>> size_of(0.0634), size_of(np.inf)
    ('0.063', '-')
    """
    return f"{loss:.2g}" if np.isfinite(loss) else "-"
