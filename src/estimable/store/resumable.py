"""What a run must have so that it can be saved."""

from typing import Any, Protocol, runtime_checkable


@runtime_checkable
class Resumable(Protocol):
    """A run that can be saved: `progress` is a record of its complete state, and `progress.resumed()` restores it."""

    @property
    def progress(self) -> Any:
        """The current state of the run."""
        ...
