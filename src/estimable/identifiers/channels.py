"""What an identifier knows of a record before it has seen one: its channels, and no model."""

from typing import Any, NamedTuple

import numpy as np


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

    @property
    def D(self) -> Any:
        """Which inputs may enter which outputs directly, (p, m)."""
        return np.full((self.p, self.m), float(self.direct))
