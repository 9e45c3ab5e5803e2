"""Several algorithms, records or priors as one, with a leading batch axis."""

from typing import Annotated, Any

from ..frozen import frozen, static


@frozen
class Stacked:
    """`size` objects of one kind; every leaf of `items` has a leading batch axis. Made by `stack`."""

    items: Annotated[Any, "size"]
    size: int = static()

    def __repr__(self) -> str:
        return f"Stacked({self.size} of {type(self.items).__name__})"

    def __len__(self) -> int:
        return self.size
