"""What a record says of each of several gains: a row each, and one sentence for all."""

import math
import re
from collections.abc import Sequence
from itertools import groupby
from typing import NamedTuple

from ..frozen import saved
from ..phrases import decimals, spread_of

SIGMAS = 2.0  # smaller differences are not reported as a change
NUMBERED = re.compile(r"(.*[^\W\d_])[_ ]?(\d+)")
GROUPED = {  # the verdicts that several gains share, as words
    "unchanged": "unchanged",
    "too short": "not compared, because the record is too short",
    "unknown": "not determined by the record",
}


@saved
class GainRow(NamedTuple):
    """What a record says of one gain.

    - `gain`: its name.
    - `before`, `after`: the gain just before its first change (without one: after a third of the record), and at the end;
      `before_sigma` and `after_sigma`: their standard deviations, the widths of the 95 % intervals over 3.92.
    - `changed_at`: the times of its changes in seconds; rows for a record without time (`timed` is False).
    - `effectiveness`: a gain of 1 is the full effect, so that 1 minus the gain is the part that is lost.
    - `verdict`: "lost": it was 1 until it dropped. "fell", "rose", "changed": a jump was detected. "jumped": so it was, but
      before and after differ by less than 2 standard deviations. "moved": without a jump, they differ by more than 3. "steady":
      no change, at another value than 1. "unchanged". "unknown": the record does not determine it. "too short": the record is
      too short to compare.
    - `detectable`: the loss that the record would have shown with 90 % probability; NaN where that is not known.
    """

    gain: str
    before: float
    before_sigma: float
    after: float
    after_sigma: float
    changed_at: tuple[float, ...]
    timed: bool
    effectiveness: bool
    verdict: str
    detectable: float = math.nan

    @property
    def label(self) -> str:
        """The gain as words: "motor 3" of gain_motor_3."""
        return label_of(self.gain)

    @property
    def lost(self) -> str:
        """The part of the effect that is lost at the end, in per cent, with 2 standard deviations."""
        return spread_of(100 * (1 - self.after), 100 * SIGMAS * self.after_sigma, unit=" %")

    @property
    def when(self) -> str:
        """The times of its changes, as words; empty without a change."""
        if not self.timed:
            return ", ".join(f"row {at:.0f}" for at in self.changed_at)
        return ", ".join(f"{at:.4g}" for at in self.changed_at) + (" s" if self.changed_at else "")

    @property
    def phrase(self) -> str:
        """What it did, as the rest of a sentence that begins with its label."""
        if self.verdict in GROUPED:
            return GROUPED[self.verdict]
        if self.verdict == "steady":
            return f"at {spread_of(self.after, SIGMAS * self.after_sigma)} throughout"
        at = f" at {self.when}" if self.changed_at else ", without a jump"
        if self.verdict == "lost":
            return f"lost {self.lost}{at}"
        digits = decimals(SIGMAS * self.after_sigma)
        after = spread_of(self.after, SIGMAS * self.after_sigma)
        span = f"from {self.before:.{digits}f} to {after}"
        return f"jumped{at}, by less than 2 sigma: {span}" if self.verdict == "jumped" else f"{self.verdict} {span}{at}"


def label_of(gain: str) -> str:
    """The name of a gain as words.

    >>> label_of("gain_motor_3"), label_of("gain_elevator_deg"), label_of("gain")
    ('motor 3', 'elevator_deg', 'gain')
    """
    name = gain.removeprefix("gain_") or gain
    numbered = NUMBERED.fullmatch(name)
    return " ".join(numbered.groups()) if numbered else name


def sentence_of(rows: Sequence[GainRow]) -> str:
    """All gains in one sentence: those that changed first, then those that did not, together."""
    changed = [f"{row.label} {row.phrase}" for row in rows if row.verdict not in GROUPED]
    rest = sorted((row for row in rows if row.verdict in GROUPED), key=lambda row: list(GROUPED).index(row.verdict))
    alike = [(verdict, [row.label for row in group]) for verdict, group in groupby(rest, lambda row: row.verdict)]
    return "; ".join([*changed, *(f"{_together(labels)} {GROUPED[verdict]}" for verdict, labels in alike)]) + "."


def _together(labels: list[str]) -> str:
    """Several labels in one: "motors 1, 2, 4"."""
    found = [NUMBERED.fullmatch(label) for label in labels]
    stems = {match.group(1) if match else None for match in found}
    if len(labels) > 1 and len(stems) == 1 and None not in stems:
        return f"{stems.pop()}s {', '.join(match.group(2) for match in found if match)}"
    return ", ".join(labels)
