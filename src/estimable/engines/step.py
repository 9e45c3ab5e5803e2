"""One row of a run, the same for every engine: correct, select, predict; and the names of its outputs."""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol, TypeVar

from ..annotations import AnyRecord, Array, Tree

Part = TypeVar("Part")
Select = Callable[[Any, str], Tree]  # from an info and `keep` to the selected outputs
Use = Callable[[Any, int], Any]  # takes the outputs of a block of rows, and its first row


class Samples(AnyRecord, Protocol):
    """The samples of a run, row by row: the mask of seen outputs, and all other data that the algorithm takes."""

    @property
    def seen(self) -> Array:
        """Whether each output was measured: (rows, outputs), or (runs, rows, outputs)."""
        ...


class Stepping(AnyRecord, Protocol):
    """The object that an engine runs: an algorithm, or anything with the same three steps and `at`."""

    def at(self, k: int | Array) -> "Stepping":
        """The same object at row k."""
        ...

    def init(self, prior: Tree) -> Any:
        """The state before the first row."""
        ...

    def correct(self, state: Tree, sample: Tree) -> tuple[Any, Any]:
        """The state after a sample, and an info with `log_likelihood` (or None) and `outcome`."""
        ...

    def predict(self, state: Tree, interval: Tree) -> Any:
        """The state at the next row."""
        ...


class Row(NamedTuple):
    """The outputs of a row: the next state, the selected part of the info, the log-likelihood of the sample, and the outcome."""

    state: Any
    kept: Any
    log_likelihood: Any
    outcome: Any


def step(
    algorithm: Stepping, k: int | Array, state: Tree, sample: Tree, interval: Tree, keep: str, select: Select
) -> Row:
    """Row k."""
    now = algorithm.at(k)
    state, info = now.correct(state, sample)
    log_likelihood = math.nan if info.log_likelihood is None else info.log_likelihood  # no number is right
    return Row(now.predict(state, interval), select(info, keep), log_likelihood, info.outcome)


def named(outputs: Sequence[Part], states: int) -> Row:
    """The flat outputs of a row by name; the first `states` belong to the state."""
    *arrays, log_likelihood, outcome = outputs
    return Row(tuple(arrays[:states]), tuple(arrays[states:]), log_likelihood, outcome)
