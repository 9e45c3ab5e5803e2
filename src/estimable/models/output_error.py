"""The output-error model: polynomials A and B for each output, and white noise on the measured outputs."""

from collections.abc import Sequence
from dataclasses import KW_ONLY
from typing import Any

import numpy as np

from .. import checks
from ..annotations import Numbers
from ..frozen import frozen, set_field, static
from ..kernels import output_error_response as kernel
from . import polynomials
from .state_space import StateSpace, between_samples


@frozen
class OutputError(polynomials.Polynomials):
    """A linear system in polynomial form, with noise on the measured outputs only.

    Model: y_i[k] = level_i + x°_i[k] + v_i[k] with x°_i[k] = Σ_j B_ij(z)/A_i(z) u°_j[k], for each output i and input j. x° is the
    output without noise, and u° the input that the actuator applied. The polynomials are A_i = 1 + a_i1 z^-1 + .. + a_i,na
    z^-na and B_ij = z^-delay (b_ij0 + .. + b_ij,nb z^-nb). The noise v is white, and that of one output is independent of
    that of another. The orders na and nb are degrees: Ljung's (na, nb, nk) is (na, nb - 1, delay = nk) here.

    Settings: `a` (p, na), or (na,) for one output; `b` (p, m, nb+1), or (nb+1,) for one output and one input; `delay` in
    steps, the same for all; `noise_variance` of v: one number or (p,), in squared units of the outputs; `dt` in seconds,
    greater than 0; `level` (p,): a constant that is added to each output (default None: none); `inputs` and `outputs` name
    the channels (default u1.., y1..).

    Reference: H. Fang (2009), (3.1), (3.2), (3.5).

    >>> plant = OutputError([0.523, 0.349], [0.440, 0.762], noise_variance=0.1, dt=1)
    >>> plant.parameter_names, plant.is_stable
    (('a1', 'a2', 'b0', 'b1'), True)
    """

    a: Any
    b: Any
    _: KW_ONLY
    delay: int = static(default=0)
    noise_variance: Any
    dt: float = static()
    level: Any = None
    inputs: Any = static(default=None)
    outputs: Any = static(default=None)

    def __post_init__(self):
        faults = checks.Faults()
        b = faults.array("b", _raised(self.b, 3), "p m lags")
        a = faults.array("a", _raised(self.a, 2), "p na")
        faults.whole("delay", self.delay, 0, checks.LARGEST_ORDER)
        dt = faults.number("dt", self.dt, above=0.0, unit="seconds")
        for axis, what in (("p", "an output"), ("lags", "at least b0")):
            if faults.sizes.get(axis) == 0:
                faults.add(f"`b` must be (p, m, nb+1) with {what}. Got {np.shape(self.b)}.")
        noise = read_variance("noise_variance", self.noise_variance, faults)
        level = None if self.level is None else faults.array("level", np.atleast_1d(self.level), "p")
        names = {
            "inputs": faults.names("inputs", self.inputs, "m", "u"),
            "outputs": faults.names("outputs", self.outputs, "p", "y"),
        }
        faults.finish()
        set_field(self, a=a, b=b, noise_variance=noise, dt=dt, level=level, **names)

    @staticmethod
    def of_parameters(
        parameters: Numbers,
        *,
        na: int,
        nb: int,
        delay: int = 0,
        noise_variance: Numbers,
        dt: float,
        level: Numbers | None = None,
        inputs: Sequence[str] | None = None,
        outputs: Sequence[str] | None = None,
    ) -> "OutputError":
        """The model with a given vector of parameters, (p (na + m (nb+1)),).

        The vector holds the parameters of one output after the other: first its a, then its b for each input.

        >>> OutputError.of_parameters([0.5, 1.0, 2.0], na=1, nb=1, noise_variance=1.0, dt=1).b.tolist()
        [[[1.0, 2.0]]]
        """
        faults = checks.Faults()
        faults.whole("na", na, 0, checks.LARGEST_ORDER)
        faults.whole("nb", nb, 0, checks.LARGEST_ORDER)
        m, p = (1 if names is None else len(faults.names(argument, names, "", ""))
                for argument, names in (("inputs", inputs), ("outputs", outputs)))  # fmt: skip
        if not faults.sentences:
            size = p * (na + m * (nb + 1))
            faults.learn(
                "d", size, f"na = {na}, nb = {nb}, {checks.counted(m, 'input')}, {checks.counted(p, 'output')}"
            )
        given = faults.array("parameters", parameters, "d")
        faults.finish()
        rows = given.reshape(p, na + m * (nb + 1))
        return OutputError(
            rows[:, :na], rows[:, na:].reshape(p, m, nb + 1), delay=delay, noise_variance=noise_variance, dt=dt,
            level=level, inputs=inputs, outputs=outputs,
        )  # fmt: skip

    @property
    def m(self) -> int:
        """Number of inputs."""
        return self.b.shape[-2]

    @property
    def p(self) -> int:
        """Number of outputs."""
        return self.b.shape[-3]

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of θ: a1, b0, ..; with the channels if there are several."""
        return parameter_names(self.na, self.nb, self.inputs, self.outputs)

    @property
    def poles(self) -> tuple[np.ndarray, ...]:
        """The roots of each A_i in z."""
        return tuple(np.roots(np.concatenate([[1.0], row])) for row in self.a)

    @property
    def is_stable(self) -> bool:
        """Whether every pole lies inside the unit circle."""
        return all(np.all(np.abs(poles) < 1) for poles in self.poles)

    def response(self, u: Numbers) -> np.ndarray:
        """The outputs x° (T, p) without noise, from rest, under the applied input u (T, m) or (T,).

        >>> OutputError([-0.5], [1.0], noise_variance=0.0, dt=1).response([1.0, 0.0, 0.0]).ravel().tolist()
        [1.0, 0.5, 0.25]
        """
        faults = checks.Faults()
        faults.learn("m", self.m, f"the model has {checks.counted(self.m, 'input')}")
        given = faults.numbers("u", u)
        inputs: Any = None if given is None else faults.array("u", given[:, None] if given.ndim == 1 else given, "T m")
        faults.finish()
        x = np.stack([kernel.response(a, b, self.delay, inputs) for a, b in zip(self.a, self.b, strict=True)], axis=1)
        return x if self.level is None else x + self.level

    def to_state_space(self, hold: str = "zero_order") -> StateSpace:
        """The same system as a `StateSpace` without process noise: one observable companion form for each output.

        `hold`: that of the records to filter.

        >>> OutputError([0.5], [1.0, 2.0], noise_variance=0.1, dt=1).to_state_space().A.tolist()
        [[-0.5]]
        """
        A, B, C, D = polynomials.companion(self.a, self.b, self.delay)
        model = StateSpace(
            A, B, C, D, Q=np.zeros_like(A), R=np.diag(self.noise_variance), dt=self.dt,
            inputs=self.inputs, outputs=self.outputs,
            operating_point=None if self.level is None else {"states": np.zeros(len(A)), "outputs": self.level},
        )  # fmt: skip
        return between_samples(model, hold)


def past_states(model: OutputError) -> StateSpace:
    """The same system with past outputs x° and past inputs as its states, which do not change when the parameters jump.

    >>> past_states(OutputError([0.5], [1.0, 2.0], noise_variance=0.1, dt=1)).A.tolist()
    [[-0.5, 2.0], [0.0, 0.0]]
    """
    p, m, na, lags = model.p, model.m, model.na, model.nb + model.delay
    n = p * na + m * lags
    A, B, C, D = np.zeros((n, n)), np.zeros((n, m)), np.zeros((p, n)), np.zeros((p, m))
    for i in range(p):
        C[i, i * na : (i + 1) * na] = -model.a[i]
        for j in range(m):
            b = np.pad(model.b[i, j], (model.delay, 0))
            D[i, j], C[i, p * na + j * lags : p * na + (j + 1) * lags] = b[0], b[1:]
        A[i * na + 1 : (i + 1) * na, i * na : (i + 1) * na - 1] = np.eye(max(na - 1, 0))
        if na:
            A[i * na], B[i * na] = C[i], D[i]
    for j in range(m if lags else 0):
        rows = slice(p * na + j * lags, p * na + (j + 1) * lags)
        A[rows, rows], B[rows.start, j] = np.eye(lags, k=-1), 1.0
    return StateSpace(
        A, B, C, D, Q=np.zeros((n, n)), R=np.diag(model.noise_variance), dt=model.dt, inputs=model.inputs,
        outputs=model.outputs,
    )  # fmt: skip


def parameter_names(na: int, nb: int, inputs: tuple[str, ...], outputs: tuple[str, ...]) -> tuple[str, ...]:
    """a1.., b0.. for one output and one input; with several, a1_y1.., b0_y1_u1..: output by output, input by input.

    >>> parameter_names(1, 0, ("u1", "u2"), ("y1",))
    ('a1_y1', 'b0_y1_u1', 'b0_y1_u2')
    """
    alone = len(inputs) == len(outputs) == 1
    names = []
    for y in outputs:
        names += [f"a{i + 1}" + ("" if alone else f"_{y}") for i in range(na)]
        names += [f"b{j}" + ("" if alone else f"_{y}_{u}") for u in inputs for j in range(nb + 1)]
    return tuple(names)


def read_variance(name: str, value: Numbers, faults: checks.Faults) -> Any:
    """Variances of the outputs, (p,); one number applies to each."""
    if checks.is_traced(value):
        return value
    if checks.depth(value) == 0:
        number = faults.number(name, value, lower=0.0)
        return None if number is None else np.full(faults.sizes.get("p", 1), number)
    variances = faults.array(name, value, "p")
    if variances is not None and np.any(variances < 0):
        faults.add(f"`{name}` must hold variances of at least 0. Got {checks.short(value)}.")
        return None
    return variances


def _raised(value: Numbers, axes: int) -> Any:
    """A 1-D list, for one output (and one input), with the missing axes added in front."""
    try:
        array = np.asarray(value)
    except ValueError:
        return value
    return array.reshape((1,) * (axes - 1) + array.shape) if array.ndim == 1 and array.dtype.kind in "fiub" else value
