"""A nonlinear state-space model defined by plain functions."""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY
from typing import Any

import jax
import numpy as np

from .. import checks, forks
from ..annotations import Array, Numbers
from ..frozen import frozen, set_field, static
from . import angles
from .state_space import StateSpace


@frozen
class NonlinearModel:
    """A nonlinear model with noise, discrete (dt > 0) or continuous (dt = 0).

    Discrete: x[k+1] = f(x[k], u[k], θ) + G w[k], y[k] = h(x[k], u[k], θ) + v[k]. Q is the covariance of w, and R that of v.
    Continuous: dx/dt = f(x, u, θ) + G w, where Q is a density (per second). y[k] is a sample as before, and R its covariance.

    Settings:

    - `f` and `h`: functions of three arrays x (n,), u (m,), θ (k,), written with `jax.numpy`. They return (n,) and (p,).
    - `Q` (q, q) and `R` (p, p): the noise covariances.
    - `G`: a matrix (n, q), or a function G(x, u, θ) of that shape. None: noise enters every state.
    - `dt`: the step in seconds, 0 for a continuous model.
    - `parameters`: {name: value} of θ, in its order. A filter can estimate them together with the state.
    - `states`, `inputs`, `outputs`: names of the channels. `states` is required if `G` is given; by default there are no
      inputs, and the outputs are y1...
    - `angles`: which states and outputs are angles, as in `StateSpace`. f and h may wrap them, as arctan2 does, or not.
    - `substeps`: the number of Runge-Kutta steps (of order 4) from one sample to the next of a continuous model, which can
      run as machine code. None: an adaptive method of diffrax (the extra `ode`) with a relative tolerance of 1e-9.

    Raises `InputError` with all faults at once: functions with wrong arguments or shapes, or that JAX cannot trace.

    >>> import jax.numpy as jnp
    >>> pendulum = NonlinearModel(
    ...     lambda x, u, θ: jnp.array([x[1], -θ[0] * jnp.sin(x[0])]), lambda x, u, θ: x[:1],
    ...     Q=0.01 * np.eye(2), R=[[0.1]], dt=0, parameters={"stiffness": 9.81}, substeps=4)
    >>> pendulum.n, pendulum.m, pendulum.p, pendulum.states
    (2, 0, 1, ('x1', 'x2'))
    """

    f: Any = static()
    h: Any = static()
    _: KW_ONLY
    Q: Any
    R: Any
    G: Any = None
    dt: float = static()
    states: Any = static(default=None)
    inputs: Any = static(default=())
    outputs: Any = static(default=None)
    parameters: Any = None
    substeps: int | None = static(default=None)
    angles: Any = static(default=())
    noise_input: Any = static(default=None, init=False)
    parameter_names: tuple[str, ...] = static(default=(), init=False)

    def __post_init__(self):
        faults = checks.Faults()
        dt = faults.number("dt", self.dt, lower=0.0, unit="seconds")
        Q, R = faults.covariance("Q", self.Q, "q q"), faults.covariance("R", self.R, "p p")
        names = _read_names(self, faults)
        G, noise_input = (None, self.G) if callable(self.G) else (self.G, None)
        if noise_input is None and "n" in faults.sizes and not faults.sentences:
            G = faults.array("G", np.eye(faults.sizes["n"]) if G is None else G, "n q")
        turns = angles.read(self.angles, names["states"] + names["outputs"], "a state or an output", faults)
        parameter_names, θ = _read_parameters(self.parameters, faults)
        if self.substeps is not None:
            faults.whole("substeps", self.substeps, 1, checks.LARGEST_ORDER)
        if dt == 0 and self.substeps is None:
            _need_solver(faults)
        if not faults.sentences:
            _check_functions(self, noise_input, len(θ), faults)
        faults.finish()
        set_field(
            self,
            dt=dt,
            Q=Q,
            R=R,
            G=G,
            noise_input=noise_input,
            parameters=θ,
            parameter_names=parameter_names,
            angles=turns,
            **names,
        )

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.states)

    @property
    def size_source(self) -> str:
        """The source of the number of states, for messages."""
        return f"the model has {checks.listed(self.states)}"

    @property
    def m(self) -> int:
        """Number of inputs."""
        return len(self.inputs)

    @property
    def p(self) -> int:
        """Number of outputs."""
        return len(self.outputs)

    def feeds_through(self, inputs: list[int]) -> bool:
        """Whether an input enters an output directly, that is, whether h uses u. `inputs` selects columns of u."""
        arguments = [jax.ShapeDtypeStruct((size,), np.float64) for size in (self.n, self.m, self.parameters.shape[-1])]
        jaxpr = jax.make_jaxpr(self.h)(*arguments).jaxpr
        return any(jaxpr.invars[1] is atom for equation in jaxpr.eqns for atom in equation.invars)

    def linearised(self, x: Numbers, u: Numbers = (), *, parameters: Numbers | None = None) -> StateSpace:
        """The linear model about the operating point x (n,), u (m,), from the derivatives of f and h there.

        `parameters` (k,): θ; None: those of the model. The linear model is meant for an equilibrium. At any other state the
        constant drift f(x, u, θ) is omitted.

        >>> slow = NonlinearModel(lambda x, u, θ: -θ * x**2 + u, lambda x, u, θ: x, Q=[[0.1]], R=[[1.0]], dt=0, inputs=["u"],
        ...                       parameters={"θ": 3.0}, substeps=1)
        >>> slow.linearised([0.5], [0.75]).A.tolist()
        [[-3.0]]
        """
        faults = checks.Faults()
        for letter, size, what in (("n", self.n, "state"), ("m", self.m, "input")):
            faults.learn(letter, size, f"the model has {checks.counted(size, what)}")
        faults.learn("k", len(self.parameters), f"it has {checks.counted(len(self.parameters), 'parameter')}")
        at, u = faults.array("x", x, "n"), faults.array("u", u, "m")
        θ = faults.array("parameters", self.parameters if parameters is None else parameters, "k")
        faults.finish()
        (A, B), (C, D) = ([np.asarray(slope) for slope in _slopes(g, at, u, θ)] for g in (self.f, self.h))
        G = self.G if self.noise_input is None else np.asarray(self.noise_input(at, u, θ))
        point = {"states": at, "inputs": u, "outputs": np.asarray(self.h(at, u, θ))}
        return StateSpace(
            A, B, C, D, Q=self.Q, R=self.R, G=G, dt=self.dt, states=self.states, inputs=self.inputs, outputs=self.outputs,
            operating_point=point, angles=self.angles,
        )  # fmt: skip

    @property
    def is_continuous(self) -> bool:
        """Whether dt = 0."""
        return self.dt == 0

    varying = False
    steps = None  # it has no time-varying matrices
    B_end = S = None
    operating_point = None
    scheduled_by = ()

    def check_at(self, x: np.ndarray, u: np.ndarray, faults: checks.Faults) -> None:
        """f, h and G must be finite at the prior mean x (n,) and the first input u (m,); traced values are not checked."""
        if checks.is_traced(x, u, self.parameters):
            return
        functions = {"f": self.f, "h": self.h} | ({} if self.noise_input is None else {"G": self.noise_input})
        for name, function in functions.items():
            value = np.asarray(function(*map(jax.numpy.asarray, (x, u, self.parameters))))
            if not np.all(np.isfinite(value)):
                faults.add(
                    f"`{name}` is not finite at the prior mean: {name}({_numbers(x)}, {_numbers(u)}, "
                    f"{_numbers(self.parameters)}) = {_numbers(value)}. Start where it is defined, or rewrite it."
                )


@forks.jit(static_argnums=0)
def _slopes(g: Callable, x: Numbers, u: Numbers, θ: Array) -> Any:
    """The derivatives of g(x, u, θ) by x and by u."""
    return jax.jacfwd(g, argnums=(0, 1))(x, u, θ)


def _numbers(values: Array) -> str:
    return "[" + ", ".join(f"{v:.6g}" for v in np.ravel(values)) + "]"


def _read_names(model: NonlinearModel, faults: checks.Faults) -> dict:
    """Names of states, inputs and outputs; without names there are as many states as process noises."""
    if model.states is None and model.G is not None:
        faults.add("`states` must name the states if `G` is given: nothing else determines their number.")
    elif model.states is None and "q" in faults.sizes:
        faults.learn("n", faults.sizes["q"], "without `G`, noise enters every state, and `Q` determines their number")
    states = faults.names("states", model.states, "n", "x")
    if states:
        faults.learn("n", len(states), f"`states` names {len(states)}")
        if model.G is None:
            faults.learn("q", len(states), "without `G`, noise enters every state")
            if faults.sizes.get("q") != len(states):
                faults.add(
                    f"`Q` must be (n, n) = ({len(states)}, {len(states)}) without `G`: noise then enters every state, "
                    f"and `states` names {len(states)}. Got {np.shape(model.Q)}."
                )
    elif model.states is not None and not faults.sentences:
        faults.add("`states` must name at least one state.")
    inputs = faults.names("inputs", model.inputs, "m", "u")
    faults.learn("m", len(inputs), f"`inputs` names {len(inputs)}")
    return {"states": states, "inputs": inputs, "outputs": faults.names("outputs", model.outputs, "p", "y")}


def _read_parameters(given: Mapping[str, float] | None, faults: checks.Faults) -> tuple[tuple[str, ...], np.ndarray]:
    if given is None:
        return (), np.zeros(0)
    if not isinstance(given, Mapping) or not all(isinstance(name, str) for name in given):
        faults.add(
            f"`parameters` must be a mapping of names to numbers, such as {{'drag': 0.3}}. Got {checks.short(given)}."
        )
        return (), np.zeros(0)
    values = faults.array("parameters", list(given.values()), "k") if given else np.zeros(0)
    return tuple(given), values


def _need_solver(faults: checks.Faults) -> None:
    try:
        import diffrax  # noqa: F401  only to see whether it is installed
    except ImportError:
        faults.add(
            "the model is continuous: give `substeps` (Runge-Kutta steps from one sample to the next), or install the extra "
            "`ode` (diffrax) for an adaptive integrator."
        )


def _check_functions(model: NonlinearModel, noise_input: Callable | None, k: int, faults: checks.Faults) -> None:
    """Check that each function takes (x, u, θ), can be traced, and returns an array of the right shape."""
    n, m, p, q = (faults.sizes[axis] for axis in "nmpq")
    wanted: list[tuple[str, Any, tuple[int, ...], str]] = [
        ("f", model.f, (n,), "one entry for each state"),
        ("h", model.h, (p,), "one entry for each row of `R`"),
    ]
    if noise_input is not None:
        wanted.append(("G", noise_input, (n, q), "one row for each state, one column for each noise"))
    arguments = [jax.ShapeDtypeStruct((size,), np.float64) for size in (n, m, k)]
    for name, function, shape, because in wanted:
        if not callable(function):
            faults.add(f"`{name}` must be a function {name}(x, u, θ). Got {checks.short(function)}.")
        elif not _takes_three(function):
            faults.add(
                f"`{name}` must take three arguments, {name}(x, u, θ), even if it does not use them. "
                f"Got {name}{inspect.signature(function)}."
            )
        else:
            _check_result(name, function, arguments, shape, because, faults)


def _check_result(
    name: str, function: Callable, arguments: list, shape: tuple, because: str, faults: checks.Faults
) -> None:
    sizes = ", ".join(f"{letter} {a.shape}" for letter, a in zip("xuθ", arguments, strict=True))
    try:
        result = jax.eval_shape(function, *arguments)
    except Exception as error:  # any exception of the user's function
        first = str(error).strip().splitlines()[0].rstrip(".") if str(error).strip() else "it has no message"
        traced = isinstance(error, jax.errors.JAXTypeError)
        cure = " Write it with jax.numpy, and with jnp.where instead of if." if traced else ""
        faults.add(f"`{name}` cannot be traced at {sizes}: {type(error).__name__}: {first}.{cure}")
        return
    if not hasattr(result, "shape") or result.shape != shape:
        got = result.shape if hasattr(result, "shape") else checks.short(result)
        faults.add(f"`{name}` must return an array {shape}: {because}. At {sizes} it returns {got}.")


def _takes_three(function: Callable) -> bool:
    try:
        inspect.signature(function).bind(0, 0, 0)
    except TypeError:
        return False
    except ValueError:  # a function in C has no signature to read
        return True
    return True
