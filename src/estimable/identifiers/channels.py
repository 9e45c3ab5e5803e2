"""The channels of a record: all that an identifier has before its data, instead of a model."""

from typing import NamedTuple


class Channels(NamedTuple):
    """Names of the channels, and whether u[k] can enter y[k]; the drivers read them instead of a model."""

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
        """Whether u[k] can enter y[k], the same for all columns."""
        return self.direct
