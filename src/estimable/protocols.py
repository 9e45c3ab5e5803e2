"""What the drivers ask of an algorithm, a gain algorithm, an identifier, a controller, a link and a plant."""

from typing import Any, Protocol, runtime_checkable


@runtime_checkable
class Resumable(Protocol):
    """A run that can be saved: `progress` is a record of all that it is, and `progress.resumed()` makes it again."""

    @property
    def progress(self) -> Any:
        """All that the run is now."""
        ...
