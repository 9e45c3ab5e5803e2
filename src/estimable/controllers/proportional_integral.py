"""State feedback with the integral of the tracking error."""

from collections.abc import Mapping
from dataclasses import KW_ONLY
from typing import Any

import jax.numpy as jnp

from .. import checks
from ..annotations import Array
from ..frozen import frozen, set_field
from ..kernels.small import apply
from ..models.controlled import read_limits
from ..protocols import SharedController
from ..results import Info, Names
from .state_feedback import check_states, demand, of_input, read_law, shared


@frozen
class ProportionalIntegral(SharedController[Array]):
    """A linear control law with an integral: u = N r - F x^ - J z - L i, where z is the integral of the error r - M x^.

    Here r is the reference, x^ the estimated state, and i the measured positions of the actuators. M x^ are the states that
    should follow the reference. The integral removes a constant error of these states.

    Settings: `feedback` F, `reference_gain` N, `input_feedback` L and `operating_point` as in `StateFeedback`;
    `integral` J (m, r); `tracked`
    M (r, n); `dt` in seconds; `limits` (2,) or (2, m): the smallest and the largest input (default None). Where an input is at
    its limit, an error that would drive it further is not integrated (anti-windup).

    Cost: m (n + 2 r + m) + r n multiplications. Reference: A. G. Sillence (1999), ch. 3; the integral by Euler's rule.

    >>> law = ProportionalIntegral([[0.0]], reference_gain=[[0.0]], integral=[[-1.0]], tracked=[[1.0]], dt=0.5)
    >>> state, u, _ = law.act(law.init(), Info(mean=np.array([0.0])), np.array([2.0]))
    >>> law.act(state, Info(mean=np.array([0.0])), np.array([2.0]))[1].tolist()
    [1.0]
    """

    feedback: Any
    _: KW_ONLY
    reference_gain: Any
    integral: Any
    tracked: Any
    dt: Any
    input_feedback: Any = None
    operating_point: Any = None
    limits: Any = None

    @property
    def size(self) -> int:
        """The number of inputs."""
        return self.feedback.shape[-2]

    @property
    def references(self) -> int:
        """The number of references."""
        return self.reference_gain.shape[-1]

    def check(self, names: Names, faults: checks.Faults) -> None:
        """Check that the estimator has the states that are fed back."""
        check_states(self.feedback, names, faults)

    def __post_init__(self):
        faults = checks.Faults()
        law = read_law(self, faults)
        law["integral"] = faults.array("integral", self.integral, "m r")
        law["tracked"] = faults.array("tracked", self.tracked, "r n")
        law["dt"] = faults.number("dt", self.dt, above=0.0, unit="seconds")
        law["limits"] = read_limits(self.limits, faults)
        faults.finish()
        set_field(self, **law)

    def init(self) -> Array:
        """The integral, zero."""
        return jnp.zeros(self.references)

    def act(
        self, state: Array, estimate: Info, reference: Array, effect: Array | float = 1.0
    ) -> tuple[Array, Array, Mapping[str, Array]]:
        """The input (m,). Its demand on the plant, N r - F x^ - J z, is divided by `effect`."""
        J = jnp.asarray(self.integral)
        u = shared(demand(self, estimate, reference) - apply(J, state), effect) - of_input(self, estimate)
        error = jnp.asarray(reference) - apply(jnp.asarray(self.tracked), jnp.asarray(estimate.mean))
        if self.limits is None:
            return state + self.dt * error, u, {}
        within = jnp.clip(u, self.limits[0], self.limits[1])
        push = -(u - within)[:, None] * J * error[None, :]  # positive: integrating this error drives u further out
        winds = jnp.max(push, axis=0) > 0
        return state + jnp.where(winds, 0.0, self.dt * error), within, {}
