"""Whether a result can be believed: the verdict of `trust`."""

from typing import NamedTuple

from ..frozen import saved

NAMED = 3  # most entries that the verdict names; `untestable` has all


@saved
class Direction(NamedTuple):
    """A way in which a model may be wrong.

    - `name`: such as "A[q, alpha]", "delay of elevator", "offset of dq/dt" or "offset of alpha".
    - `kind`: "A", "B" (both in parts of the entry), "delay" (seconds), "limit" (the lost part of an input beyond half of its
      range), "state offset", "late offset" (of a state equation, from the first detected change on) or "sensor offset" (units of
      the channel).
    - `at`: the indices of its channels.
    """

    name: str
    kind: str
    at: tuple[int, ...]

    def of_size(self, size: float, sigma: float) -> str:
        """An error of this kind, as words."""
        if self.kind in "AB":
            return f"{self.name} wrong by {100 * size:+.2g} ± {100 * sigma:.2g} %"
        if self.kind == "delay":
            return f"a {self.name} of {1e3 * size:+.3g} ± {1e3 * sigma:.2g} ms"
        if self.kind == "limit":
            return f"a {self.name} (beyond half of its range, {100 * size:.2g} ± {100 * sigma:.2g} % of the effect is lost)"
        return f"an {self.name} of {size:+.3g} ± {sigma:.2g}"


@saved
class Suspect(NamedTuple):
    """What a record says of one direction: its size (score / information) with its standard deviation, and its z."""

    direction: Direction
    size: float
    sigma: float
    z: float


@saved
class Untestable(NamedTuple):
    """A direction whose error hides in a gain.

    - `gain`: the gain that it moves. `correlation`: Fisher's correlation of the error with that gain; near ±1 no test of this
      record sees the error.
    - `shift`: by how much an error of 10 % moves the gain.
    """

    direction: Direction
    gain: str
    correlation: float
    shift: float

    @property
    def sentence(self) -> str:
        """The error and its effect, as a sentence."""
        return (
            f"This record cannot test {self.direction.name}: an error of 10 % moves {self.gain} by {self.shift:+.2g}."
        )


@saved
class Trust(NamedTuple):
    """The result of `trust`: whether the numbers of a filter can be believed.

    - `word`: "believe", "check" or "do not use". `sentence`: the verdict as one sentence.
    - `p`: the p-value of all families of tests together: a right model has a smaller one with this probability.
    - `families`: the p-value of each family by name.
    - `suspects`: the directions whose score is significant, the largest first. `reasons`: why the word is not "believe".
    - `untestable`: errors of the model that hide in a gain, the largest shift first.
    """

    word: str
    p: float
    families: dict[str, float]
    suspects: tuple[Suspect, ...] = ()
    reasons: tuple[str, ...] = ()
    untestable: tuple[Untestable, ...] = ()

    @property
    def sentence(self) -> str:
        """The verdict as one sentence."""
        if self.word == "believe":
            if not self.untestable:
                return "Believe: the record agrees with the model."
            names = tuple(dict.fromkeys(one.direction.name for one in self.untestable))
            what = ", ".join(names) if len(names) <= NAMED else f"{len(names)} entries such as {names[0]}"
            return f"Believe, if {what} {'is' if len(names) == 1 else 'are'} right: the record agrees."
        lead = "Check the model" if self.word == "check" else "Do not use these numbers"
        return f"{lead}: {self.reasons[0]}" + ("" if self.reasons[0].endswith(".") else ".")
