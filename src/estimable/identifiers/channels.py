"""What an identifier knows of a record before it has seen one: its channels, and no model."""

from typing import NamedTuple


class Channels(NamedTuple):
    """Names of the channels, and whether u[k] can enter y[k]; read by the drivers in the place of a model."""

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    direct: bool

    dt = None  # that of the record
    steps = None
    S = None
    B_end = None
    operating_point = None
    is_continuous = False

    @property
    def m(self) -> int:
        """Number of inputs."""
        return len(self.inputs)

    @property
    def p(self) -> int:
        """Number of outputs."""
        return len(self.outputs)

    def feeds_through(self, inputs: list[int]) -> bool:
        """Whether u[k] can enter y[k], whichever columns are asked for."""
        return self.direct
