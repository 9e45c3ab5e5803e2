"""The list of changes that a change detector found."""

from typing import NamedTuple

import numpy as np

from .. import checks
from ..frozen import saved
from ..results import Estimate

SIGNIFICANT = 3.0  # standard deviations by which a further gain has moved


@saved
class DetectedChange(NamedTuple):
    """One detected jump of a gain.

    - `gain`: the name of the gain.
    - `onset` and `detected_at`: the rows of the jump and of its detection. `onset_s` and `detected_at_s`: their times in
      seconds, None for a record without time.
    - `before`: the gain before the jump. `after` and `sigma`: the gain after it and its standard deviation, as estimated at
      the next jump or at the end of the record: the median, and the width of the 95 % interval over 3.92.
    - `onset_sigma` and `onset_sigma_s`: the standard deviation of the onset in rows and in seconds, as estimated at the
      detection.
    """

    gain: str
    onset: int
    detected_at: int
    onset_s: float | None
    detected_at_s: float | None
    before: float
    after: float
    sigma: float
    onset_sigma: float
    onset_sigma_s: float | None

    @property
    def sentence(self) -> str:
        """The change, as a sentence."""
        when = f"at row {self.onset} ± {self.onset_sigma:.2g}"
        if self.onset_s is not None:
            when = f"at {self.onset_s:.6g} ± {self.onset_sigma_s:.2g} s"
        alarm = f"row {self.detected_at}" if self.detected_at_s is None else f"{self.detected_at_s:.6g} s"
        return f"{self.gain} changed from {self.before:.3g} to {self.after:.3g} ± {self.sigma:.2g} {when}, detected at {alarm}."


def changes(result: Estimate) -> tuple[DetectedChange, ...]:
    """The jumps that a `ChangeDetection` found in a record, in the order of their detection.

    `result`: the result of `estimate`, or one run of a bank (`bank[i]`), made with `keep="all"`. If several gains may jump, the
    likeliest is listed, and each other that jumped with a probability above .5 and has moved by three standard deviations.

    Returns a tuple of `DetectedChange`s, in the order of their detection. Raises `InputError` for a result without alarms.

    >>> model = StateSpace([[0.5]], [[1.0]], Q=[[0.0]], R=[[0.01]], dt=1)
    >>> record = Record([0.0, 1.0, 1.5, 1.75, 1.4, 1.2], np.ones(6), dt=1)
    >>> watched = ChangeDetection(UnknownGain(model, Prior([1.0], [[0.0]])), jump=1.0)
    >>> [change] = diagnostics.changes(estimate(watched, record, prior=Prior([0.0], [[0.0]])))
    >>> change.sentence
    'gain changed from 1 to 0.525 ± 0.063 at 3 ± 0.25 s, detected at 4 s.'
    """
    if not isinstance(result, Estimate) or "alarm" not in result.extra:
        expected = (
            f"keep = {'all'!r}" if isinstance(result, Estimate) else "one result of the bank, as in changes(bank[0])"
        )
        checks.refuse(
            f"`result` must be the estimate of a ChangeDetection, with {expected}. Got {checks.short(result)}."
        )
    alarms = np.flatnonzero(result.extra["alarm"])
    ends = [*(alarms[1:] - 1), len(result.gain) - 1]
    median, sigma = result.gain_standing
    return tuple(
        _change(result, int(alarm), int(end), gain, median, sigma)
        for alarm, end in zip(alarms, ends, strict=False)
        for gain in _jumped(result, int(alarm), int(end), median, sigma)
    )


def _jumped(result: Estimate, alarm: int, end: int, median: np.ndarray, sigma: np.ndarray) -> list[int]:
    """The gain that jumped likeliest, and the others that probably jumped and have moved significantly."""
    probability, before = result.extra["jumped"][alarm], max(int(result.extra["onset"][alarm]) - 1, 0)
    moved = np.abs(median[end] - median[before]) > SIGNIFICANT * np.hypot(sigma[end], sigma[before])
    order = np.argsort(-probability, kind="stable")
    return [int(i) for i in order if i == order[0] or (probability[i] > 0.5 and moved[i])]


def _change(result: Estimate, alarm: int, end: int, gain: int, median: np.ndarray, sigma: np.ndarray) -> DetectedChange:
    """The change of a gain detected at row `alarm`, as estimated at row `end`."""
    onset = int(result.extra["onset"][alarm])
    before = max(onset - 1, 0)
    times = (None, None) if result.t is None else (float(result.t[onset]), float(result.t[alarm]))
    apart = float(result.extra["onset_sigma"][alarm])
    step = None if result.t is None else (result.t[alarm] - result.t[before]) / (alarm - before)
    return DetectedChange(
        result.names.gains[gain], onset, alarm, *times,
        float(median[before, gain]), float(median[end, gain]), float(sigma[end, gain]),
        apart, None if step is None else float(apart * step),
    )  # fmt: skip
