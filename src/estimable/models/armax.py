"""The ARMAX model: ARX with a moving average in the noise."""

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
class ARMAX(EquationNoise):
    """A linear system in polynomial form, with coloured noise that passes through the poles of the plant.

    Model: A_i(z) y_i[k] = Σ_j B_ij(z) u_j[k] + C_i(z) e_i[k], for each output i and input j. The polynomials are
    A_i = 1 + a_i1 z^-1 + .., C_i = 1 + c_i1 z^-1 + .. and B_ij = z^-delay (b_ij0 + ..). The noise e is white, and that of one
    output is independent of that of another. The orders na, nb and nc are degrees: Ljung's (na, nb, nc, nk) is
    (na, nb - 1, nc, delay = nk) here.

    Settings: `a` (p, na), `b` (p, m, nb+1), `c` (p, nc), or (na,), (nb+1,), (nc,) for one output and input; `delay` in steps;
    `noise_variance` of e: one number or (p,); `dt` in seconds, greater than 0; `inputs` and `outputs` name the channels.

    Reference: L. Ljung, System Identification (1999), (4.14).

    >>> ARMAX([-0.5], [1.0], [0.3], noise_variance=0.1, dt=1).parameter_names
    ('a1', 'b0', 'c1')
    """

    a: Any
    b: Any
    c: Any
    _: KW_ONLY
    delay: int = static(default=0)
    noise_variance: Any
    dt: float = static()
    inputs: Any = static(default=None)
    outputs: Any = static(default=None)

    PARTS = ("a", "b", "c")

    def __post_init__(self):
        plant = self.plant
        faults = checks.Faults()
        faults.learn("p", plant.p, f"`a` has {checks.counted(plant.p, 'row')}")
        c = faults.array("c", [self.c] if checks.depth(self.c) == 1 else self.c, "p nc")
        faults.finish()
        set_field(
            self, a=plant.a, b=plant.b, c=c, noise_variance=plant.noise_variance, dt=plant.dt, inputs=plant.inputs,
            outputs=plant.outputs,
        )  # fmt: skip

    @property
    def nc(self) -> int:
        """Degree of C."""
        return self.c.shape[-1]

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of θ: a1, b0, c1, ..; with the channels if there are several."""
        rows, alone = [], len(self.inputs) == len(self.outputs) == 1
        for y in self.outputs:
            rows += parameter_names(self.na, self.nb, self.inputs, (y,)) if not alone else []
            rows += parameter_names(self.na, self.nb, self.inputs, self.outputs) if alone else []
            rows += [f"c{i + 1}" + ("" if alone else f"_{y}") for i in range(self.nc)]
        return tuple(rows)

    def to_state_space(self, hold: str = "zero_order") -> StateSpace:
        """The same system in innovations form: x[k+1] = A x[k] + B u[k] + K e[k], y[k] = C x[k] + D u[k] + e[k].

        `hold`: that of the records to filter.

        >>> ARMAX([-0.5], [1.0], [0.3], noise_variance=0.1, dt=1).to_state_space().G.tolist()
        [[0.8]]
        """
        A, B, C, D = polynomials.companion(self.a, self.b, self.delay, self.nc)
        p = len(self.a)
        n, K = len(A) // p, np.zeros((len(A), p))
        for i in range(p):
            K[i * n : (i + 1) * n, i] = np.pad(self.c[i], (0, n - self.nc)) - np.pad(self.a[i], (0, n - self.na))
        Σ = np.diag(self.noise_variance)
        model = StateSpace(A, B, C, D, G=K, Q=Σ, R=Σ, S=Σ, dt=self.dt, inputs=self.inputs, outputs=self.outputs)
        return between_samples(model, hold)
