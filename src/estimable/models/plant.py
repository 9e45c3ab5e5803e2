"""A model, linear or not, as the steps of a nonlinear filter use it: the next state and the output of a state."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from ..annotations import Array
from ..frozen import frozen, replace, static
from ..kernels.small import apply, factors, product
from . import angles
from .nonlinear_model import NonlinearModel
from .sampled import Clock, SampledModel, is_diagonal, sample
from .state_space import StateSpace
from .uncertainty import ModelUncertainty, tangents


@frozen
class Functions:
    """A `NonlinearModel` with noises scaled from unit white ones: w = white e, v = V e'. θ are the parameters of the model.

    `moving`: the input moves linearly between samples. The state's origin is zero. `independent`: V is diagonal.
    `period`, `state_period`: those of outputs and states which are angles, 0 for the others. `uncertain`: the places in θ of
    the parameters that are considered, and `sigma` (q,) their standard deviations.
    """

    f: Any = static()
    h: Any = static()
    noise_input: Any = static()
    substeps: int | None = static()
    continuous: bool = static()
    moving: bool = static()
    θ: Any
    G: Any
    white: Any
    V: Any
    independent: bool = static(default=False)
    period: tuple[float, ...] | None = static(default=None)
    state_period: tuple[float, ...] | None = static(default=None)
    uncertain: tuple[int, ...] = static(default=())
    sigma: Any = None

    def at(self, k: int | Array) -> "Functions":
        """The plant at row k, which is the same for all rows."""
        return self

    @property
    def added(self) -> None:
        """None: a nonlinear model has no such states."""
        return None

    @property
    def origin(self):
        """The origin of the states, (n,)."""
        return jnp.zeros(self.n)

    @property
    def n(self) -> int:
        """Number of states."""
        return self.G.shape[0]

    def output(self, x: Array, θ: Array, u: Array):
        """y without its noise, (p,)."""
        return self.h(x, u, θ)

    def next_state(self, x: Array, θ: Array, interval: Any):
        """x at the next sample without noise, (n,)."""
        return self.f(x, interval.u, θ)

    def derivative(self, interval: Any):
        """f(x, θ, t): dx/dt at t seconds after the sample."""

        def f(x: Array, θ: Array, t: Array | float):
            u = interval.u
            return self.f(x, u + (interval.u_end - u) * (t / interval.dt) if self.moving else u, θ)

        return f

    def noise(self, x: Array, θ: Array, u: Array):
        """W (n, q): the noise on x+ (or on dx/dt) is W e."""
        G = self.G if self.noise_input is None else self.noise_input(x, u, θ)
        return product(G, self.white)


@frozen
class Matrices:
    """A `SampledModel` as a plant: its states are deviations from the operating point, θ its uncertain entries."""

    model: SampledModel

    noise_input = state_period = None
    continuous = False

    @property
    def θ(self) -> np.ndarray:
        """The uncertain entries, deviations from the model: zeros."""
        return np.zeros(0 if self.model.tangents is None else self.model.tangents.count)

    @property
    def uncertain(self) -> tuple[int, ...]:
        """The places of the uncertain entries in θ: all."""
        return tuple(range(len(self.θ)))

    @property
    def sigma(self) -> Any:
        """Their standard deviations (q,)."""
        return None if self.model.tangents is None else self.model.tangents.sigma

    def _with(self, θ: Array) -> SampledModel:
        return self.model if self.model.tangents is None else self.model.tangents.moved(self.model, θ)

    def at(self, k: int | Array) -> "Matrices":
        """The plant at row k of a time-varying model."""
        return Matrices(self.model.at(k))

    @property
    def origin(self):
        """The origin of the states, (n,)."""
        return self.model.point.states

    @property
    def added(self):
        """The variances of disturbances at the start, (d,), or None."""
        return self.model.added

    @property
    def n(self) -> int:
        """Number of states."""
        return self.model.A.shape[-1]

    @property
    def V(self):
        """The factor of the measurement noise, (p, p)."""
        return self.model.V

    @property
    def period(self) -> tuple[float, ...] | None:
        """The period of each output which is an angle."""
        return self.model.period

    @property
    def independent(self) -> bool:
        """Whether each output has its own independent noise."""
        return self.model.independent

    def output(self, x: Array, θ: Array, u: Array):
        """y without its noise, (p,)."""
        model = self._with(θ)
        return apply(model.C, x) + apply(model.D, u - model.point.inputs) + model.point.outputs

    def next_state(self, x: Array, θ: Array, interval: Any):
        """x at the next sample without noise, (n,)."""
        model = self._with(θ)
        moved = apply(model.A, x) + apply(model.B, interval.u - model.point.inputs)
        return moved if model.B_end is None else moved + apply(model.B_end, interval.u_end - model.point.inputs)

    def noise(self, x: Array, θ: Array, u: Array):
        """W (n, q): the noise on x+ is W e."""
        return self.model.W


def plant(
    model: StateSpace | NonlinearModel, clock: Clock, uncertainty: ModelUncertainty | None = None
) -> Functions | Matrices:
    """`model`, prepared for the steps of `clock`, with what is uncertain in it."""
    if isinstance(model, StateSpace):
        ready = sample(model, clock)
        if uncertainty is not None:
            ready = replace(ready, tangents=tangents(model, uncertainty, clock, lambda model: model))
        return Matrices(ready)
    sigma = {} if uncertainty is None else uncertainty.of_parameters(model)
    G = model.G if model.noise_input is None else jnp.zeros((model.n, model.Q.shape[-1]))
    return Functions(
        model.f, model.h, model.noise_input, model.substeps, model.is_continuous, clock.hold == "first_order",
        model.parameters, G, factors(model.Q), factors(model.R), is_diagonal(model.R),
        angles.periods(model.angles, model.outputs), angles.periods(model.angles, model.states),
        tuple(map(model.parameter_names.index, sigma)), np.array(list(sigma.values())) if sigma else None,
    )  # fmt: skip
