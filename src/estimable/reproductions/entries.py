"""The record of a reproduction, and its result."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ..annotations import Numbers

DRAWS = 200


class ReproducedRow(NamedTuple):
    """One number: the published value (None: not printed) and ours, the mean and 1 sigma over `draws`.

    A number without random draws has sigma None and draws 0. Draws in which the quantity does not exist (it never settled)
    are omitted from all three.
    """

    quantity: str
    unit: str
    published: float | None
    mean: float
    sigma: float | None = None
    draws: int = 0


class Reproduced(NamedTuple):
    """The result of `compute`: the rows, a function that draws the figure (or None), and remarks."""

    rows: tuple[ReproducedRow, ...]
    figure: Callable[[], Any] | None = None
    remarks: tuple[str, ...] = ()


class Reproduction(NamedTuple):
    """One table or figure of a source: `compute(draws)` recomputes it, or is None for the given `reason`."""

    name: str
    source: str
    title: str
    compute: Callable[[int], Reproduced] | None = None
    reason: str = ""

    @property
    def status(self) -> str:
        """ "done", or the reason why not."""
        return "done" if self.compute is not None else self.reason


def drawn(quantity: str, unit: str, published: float | None, values: Numbers) -> ReproducedRow:
    """The row of a quantity that each draw has: mean and 1 sigma over those that are finite.

    >>> drawn("gain", "", 0.5, [0.0, 1.0, 2.0, float("nan")])
    ReproducedRow(quantity='gain', unit='', published=0.5, mean=1.0, sigma=1.0, draws=3)
    """
    given = np.asarray(values, float)
    finite = given[np.isfinite(given)]
    sigma = float(finite.std(ddof=1)) if len(finite) > 1 else None
    return ReproducedRow(
        quantity, unit, published, float(finite.mean()) if len(finite) else float("nan"), sigma, len(finite)
    )
