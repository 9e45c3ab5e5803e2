"""Steps without a state: what they report of a row depends on that row alone."""

from typing import Any, Self

from ..annotations import Array
from ..results import Interval


class Stateless:
    """The base of what an engine runs row by row without a state; a subclass has `correct`."""

    def at(self, k: int | Array) -> Self:
        """The same at row k."""
        return self

    def init(self, prior: Any) -> tuple[()]:
        """No state."""
        return ()

    def predict(self, state: tuple[()], interval: Interval) -> tuple[()]:
        """No change."""
        return state
