"""The common part of models whose noise passes through the poles of the plant."""

from typing import Any

from .output_error import OutputError
from .polynomials import Polynomials


class EquationNoise(Polynomials):
    """A plant B/A with noise on its equation."""

    delay: int
    noise_variance: Any
    dt: float
    inputs: Any
    outputs: Any

    @property
    def plant(self) -> OutputError:
        """B/A as an output-error model: the same response, without an offset."""
        return OutputError(
            self.a, self.b, delay=self.delay, noise_variance=self.noise_variance, dt=self.dt, inputs=self.inputs,
            outputs=self.outputs,
        )  # fmt: skip

    @property
    def is_stable(self) -> bool:
        """Whether every pole lies inside the unit circle."""
        return self.plant.is_stable
