# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
"""Verdicts as sentences, with the numbers that show them."""

from typing import Any, Protocol

import numpy as np

from .. import checks, phrases

DIRECTIONS = 4  # listed at most
TERMS = 6  # of a direction, listed at most
SHOWN = 0.005  # entries below this part of the largest are not shown


class _DirectionVerdict(Protocol):
    """The members of a verdict that its sentences use; `verdicts` documents them."""

    @property
    def verdict(self) -> str: ...
    @property
    def distance(self) -> float: ...
    @property
    def directions(self) -> Any: ...
    @property
    def states(self) -> tuple[str, ...]: ...


class _StructureVerdict(_DirectionVerdict, Protocol):
    """Those of `Observability` and `Reachability`."""

    @property
    def channels(self) -> tuple[str, ...]: ...
    @property
    def horizon(self) -> Any: ...
    @property
    def unstable_directions(self) -> Any: ...


def words(direction: np.ndarray, names: tuple[str, ...]) -> str:
    """A direction in the names of the states.

    >>> words(np.array([0.894, -0.447, 0.0]), ("alpha", "q", "h")), words(np.array([0.0, 1.0]), ("alpha", "q"))
    ('0.89 alpha - 0.45 q', 'q')
    """
    largest = np.abs(direction).max()
    entries = [i for i in np.argsort(-np.abs(direction), kind="stable") if abs(direction[i]) > SHOWN * largest]
    if len(entries) == 1:
        return names[entries[0]]
    shown = sorted(entries[:TERMS])
    text = "".join(
        f"{' - ' if direction[i] < 0 else ' + '}{abs(direction[i]):.2g} {names[i]}" for i in shown
    ).removeprefix(" + ")
    text = f"-{text[3:]}" if text.startswith(" - ") else text
    return text + (f" + .. ({checks.counted(len(entries) - TERMS, 'more term')})" if len(entries) > TERMS else "")


def estimability_sentences(found: Any) -> tuple[str, ...]:
    """The directions that past outputs, and then present ones, reveal; the known ones; and the least known one."""
    outputs = _and(found.outputs)
    sentences = []
    if found.verdict == "yes":
        sentences.append(f"Every direction of the state is revealed by {outputs}.")
    else:
        sentences += _hidden(found, outputs)
    sentences += _known(found)
    if found.verdict == "no" and found.filter_verdict != "no":
        sentences.append(
            "The present output reveals the rest: the filter determines it, the one-step predictor cannot (a delay)."
        )
    return (*sentences, *(_least(found, outputs) if found.verdict == "yes" else ()))


def regulability_sentences(found: Any) -> tuple[str, ...]:
    """The states from which control can lower the cost."""
    inputs = _and(found.inputs)
    if found.verdict == "yes":
        sentences = [f"From every state, {inputs} can lower the cost."]
    elif found.verdict == "borderline":
        sentences = [f"From some state, {inputs} can lower the cost only by an amount that rounding could hide."]
    else:
        several = [f"From x0 along {words(g, found.states)}, {inputs} cannot lower the cost." for g in found.directions]
        sentences = _few(several) or ([] if len(found.known_directions) else ["No state has a cost."])
    sentences += [f"{words(g, found.states)} costs nothing to begin with." for g in found.known_directions[:DIRECTIONS]]
    return tuple(sentences)


def _hidden(found: Any, outputs: str) -> list[str]:
    if found.verdict == "borderline":
        least = found.correlation_directions[:1]
        what = words(least[0], found.states) if len(least) else "some direction"
        return [
            f"{what} is revealed by {outputs} only barely: a relative change of {found.distance:.1e} of the model hides it."
        ]
    return _few([f"{words(g, found.states)} is not revealed by {outputs}." for g in found.directions])


def _known(found: Any) -> list[str]:
    return _few([f"{words(g, found.states)} is already known: its variance is zero." for g in found.known_directions])


def _least(found: Any, outputs: str) -> list[str]:
    """The least known direction, if any is known."""
    ρ2 = found.squared_correlations
    if len(ρ2) == 0:
        return []
    g = words(found.correlation_directions[0], found.states)
    return [f"{g} is the least known: past samples reduce its variance by {_percent(ρ2[0])}."]


def _percent(share: float) -> str:
    """A share in percent, with enough digits to differ from 100 %.

    >>> _percent(0.456), _percent(3e-5), _percent(0.99999)
    ('45.6 %', '0.003 %', '99.999 %')
    """
    if share > 0.99:
        return f"{100 - float(f'{100 * (1 - share):.1g}'):.9g} %"
    return f"{100 * share:.3g} %"


def _few(sentences: list[str]) -> list[str]:
    more = len(sentences) - DIRECTIONS
    return sentences[:DIRECTIONS] + ([f"And {checks.counted(more, 'more direction')}."] if more > 0 else [])


def _and(names: tuple[str, ...]) -> str:
    """Names as a list in a sentence.

    >>> _and(("a",)), _and(("a", "b")), _and(("a", "b", "c"))
    ('a', 'a and b', 'a, b and c')
    """
    if len(names) > phrases.LISTED:
        return f"{len(names)} outputs"
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def structure_sentences(found: _StructureVerdict) -> tuple[str, ...]:
    """The directions that never show, or are not moved, and whether they die out."""
    outputs = type(found).__name__ == "Observability"
    channels = _and(found.channels) if found.channels else "any input"
    within = "" if found.horizon is None else " within the horizon"
    if found.verdict == "yes":
        return (f"Every direction of the state {'shows in' if outputs else 'is moved by'} {channels}{within}.",)
    if found.verdict == "borderline":
        how = "shows in" if outputs else "is moved by"
        part = f"a relative size of {found.distance:.1e}, which rounding could hide"
        return (f"some direction {how} {channels} only with {part}.",)
    does = f"never shows in {channels}" if outputs else f"is not moved by {channels}"
    sentences = _few([f"{words(g, found.states)} {does}{within}." for g in found.directions])
    return (*sentences, *(() if found.horizon is not None else _decay(found)))


def _decay(found: _StructureVerdict) -> list[str]:
    """Whether the hidden directions die out."""
    if len(found.unstable_directions) == 0:
        return ["It dies out by itself." if len(found.directions) == 1 else "All of it dies out by itself."]
    return _few([f"{words(g, found.states)} does not die out by itself." for g in found.unstable_directions])
