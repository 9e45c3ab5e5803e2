"""The ARX model: polynomials A and B for each output, and white noise on the equation."""

from dataclasses import KW_ONLY
from typing import Any

import numpy as np

from .. import checks
from ..frozen import frozen, set_field, static
from . import polynomials
from .equation_noise import EquationNoise
from .output_error import parameter_names
from .state_space import StateSpace, between_samples


@frozen
class ARX(EquationNoise):
    """A linear system in polynomial form, with noise that passes through the poles of the plant.

    Model: A_i(z) y_i[k] = Σ_j B_ij(z) u_j[k] + c_i + e_i[k], for each output i and input j. The polynomials are
    A_i = 1 + a_i1 z^-1 + .. + a_i,na z^-na and B_ij = z^-delay (b_ij0 + .. + b_ij,nb z^-nb). The noise e is white, and that
    of one output is independent of that of another. c is a constant offset. The orders na and nb are degrees: Ljung's
    (na, nb, nk) is (na, nb - 1, delay = nk) here.

    Settings: `a` (p, na), or (na,) for one output; `b` (p, m, nb+1), or (nb+1,) for one output and one input; `delay` in
    steps; `noise_variance` of e: one number or (p,), in squared units of the outputs; `dt` in seconds, greater than 0;
    `offset` c (p,), or None for signals that are deviations; `inputs` and `outputs` name the channels.

    Reference: L. Ljung, System Identification (1999), (4.7).

    >>> ARX([-0.5], [1.0], noise_variance=0.1, dt=1).parameter_names
    ('a1', 'b0')
    """

    a: Any
    b: Any
    _: KW_ONLY
    delay: int = static(default=0)
    noise_variance: Any
    dt: float = static()
    offset: Any = None
    inputs: Any = static(default=None)
    outputs: Any = static(default=None)

    PARTS = ("a", "b", "offset")

    def __post_init__(self):
        plant = self.plant
        faults = checks.Faults()
        faults.learn("p", plant.p, f"`a` has {checks.counted(plant.p, 'row')}")
        offset = None if self.offset is None else faults.array("offset", np.atleast_1d(self.offset), "p")
        faults.finish()
        set_field(
            self, a=plant.a, b=plant.b, noise_variance=plant.noise_variance, dt=plant.dt, offset=offset,
            inputs=plant.inputs, outputs=plant.outputs,
        )  # fmt: skip

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of θ: a1, b0, ..; with the channels if there are several."""
        return arx_names(self.na, self.nb, self.inputs, self.outputs, self.offset is not None)

    def to_state_space(self, hold: str = "zero_order") -> StateSpace:
        """The same system in innovations form, in absolute units: x[k+1] = A x[k] + B u[k] + K e[k],
        y[k] = C x[k] + D u[k] + e[k].

        `hold`: that of the records to filter.

        Raises `InputError` if there is an offset and A has a root at 1: the outputs then have no level.

        >>> ARX([-0.5], [1.0], noise_variance=0.1, dt=1).to_state_space().G.tolist()
        [[0.5]]
        """
        A, B, C, D = polynomials.companion(self.a, self.b, self.delay)
        n, p = len(A) // len(self.a), len(self.a)
        K = np.zeros((len(A), p))
        for i in range(p):
            K[i * n : i * n + self.na, i] = -self.a[i]
        Σ = np.diag(self.noise_variance)
        model = StateSpace(
            A, B, C, D, G=K, Q=Σ, R=Σ, S=Σ, dt=self.dt, inputs=self.inputs, outputs=self.outputs,
            operating_point=self._level(len(A)),
        )  # fmt: skip
        return between_samples(model, hold)

    def _level(self, n: int) -> Any:
        """The operating point of the outputs without input: c_i / A_i(1)."""
        if self.offset is None:
            return None
        at_one = 1 + self.a.sum(axis=1)
        if np.any(np.abs(at_one) < 1e-12):
            checks.refuse("the model has an offset and a pole at 1: its output is a ramp and has no level.")
        return {"states": np.zeros(n), "outputs": self.offset / at_one}


def arx_names(na: int, nb: int, inputs: tuple[str, ...], outputs: tuple[str, ...], offset: bool) -> tuple[str, ...]:
    """a1.., b0.., c for one output and one input; with several, output by output.

    >>> arx_names(1, 0, ("u1",), ("y1",), True)
    ('a1', 'b0', 'c')
    """
    names, alone = parameter_names(na, nb, inputs, outputs), len(inputs) == len(outputs) == 1
    if not offset:
        return names
    each = len(names) // len(outputs)
    rows = [(*names[i * each : (i + 1) * each], "c" if alone else f"c_{y}") for i, y in enumerate(outputs)]
    return tuple(name for row in rows for name in row)
