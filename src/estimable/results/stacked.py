"""Several algorithms, records or priors as one, with a leading batch axis."""

from typing import Annotated, Any

from ..frozen import frozen, static


@frozen
class Stacked:
    """The result of `stack`: several objects of one kind, stacked into one.

    `size` is their number B. `items` is one object of that kind, whose arrays have a leading axis of length B.
    """

    items: Annotated[Any, "size"]
    size: int = static()

    def __repr__(self) -> str:
        return f"Stacked({self.size} of {type(self.items).__name__})"

    def __len__(self) -> int:
        return self.size
