"""A law for the healthy plant, adapted to the remaining effect of the input."""

from collections.abc import Mapping
from dataclasses import KW_ONLY
from typing import Any

import jax.numpy as jnp
import numpy as np

from .. import checks
from ..annotations import Array
from ..frozen import frozen, set_field
from ..kernels.small import factor, gram, product, solve_lower
from ..protocols import Controller, SharedController
from ..results import Info, Names
from .state_feedback import check_inner


@frozen
class GainReconfiguration(Controller[Any]):
    """A controller that divides its demand on the plant by the estimated gain, so that a loss of effect is compensated for.

    Model: the input acts through a gain K (one, or one for each input). K^ is the estimate of K, at least `lower`, P is its
    variance, and c is the `caution`. The demand of the law on the plant is divided by K~ = K^ + c P / K^. The part of the law
    that feeds back the position of the actuator (`input_feedback`) is not divided. At c = 1, K~ is the divisor with the
    smallest expected (K/K~ - 1)²: an uncertain gain is compensated for less. At c = 0 the estimate is used as exact.

    Assumes that the gain is estimated well enough and soon. `ChangeDetection(UnknownGain(model, Prior([1.0], [[0.0]])),
    jump=0.25)` leaves K~ at 1 until a jump is certain; for a window use `Smoothed(Bounded(MovingWindow(...), 0, 1),
    .9)`. The sign must be known: a gain below `lower` counts as `lower`, so that the demand grows by 1 / `lower` at most.

    Reallocation: the `allocation` M (r, m) is the effect of each input on r quantities, such as rows of B. For the demand v
    of the law, the inputs become u = G' (G G')^-1 M v with G = M diag(K~). Then M diag(K~) u = M v, with the smallest norm of
    u. An input whose gain is at its `lower` bound counts as lost, and the others replace it. Without `allocation` each input
    is divided by its own gain, and the effect of a lost one is lost.

    Settings: `controller`, such as `StateFeedback`; `lower` > 0, one number (default .05); `caution` c >= 0 (default 1);
    `allocation` (r, m) of rank r (default None); `rate`: the largest change of 1 / K~ in a sample (default None: no limit),
    so that a false alarm does not cause a jump of the input.

    Reports `effect` (m,) or (1,), the divisor K~. Cost: five operations per gain, and r² (m + r) with an allocation.

    Reference: A. G. Sillence (1999), §5.6 and Fig. 1; `lower`, `caution`, `rate` and the allocation (a pseudo-inverse) are
    ours.

    >>> law = GainReconfiguration(StateFeedback([[1.0]]))
    >>> estimate = Info(mean=np.array([-1.0]), gain=np.array([0.5]), gain_covariance=np.array([[0.0]]))
    >>> state, u, reported = law.act(law.init(), estimate, np.zeros(0))
    >>> u.tolist(), reported["effect"].tolist()
    ([2.0], [0.5])
    """

    controller: Any
    _: KW_ONLY
    lower: Any = 0.05
    caution: Any = 1.0
    allocation: Any = None
    rate: Any = None

    def __post_init__(self):
        faults = checks.Faults()
        check_inner(self.controller, "GainReconfiguration", faults)
        lower = faults.number("lower", self.lower, above=0.0)
        caution = faults.number("caution", self.caution, lower=0.0)
        allocation = None if self.allocation is None else faults.array("allocation", self.allocation, "r m")
        rate = None if self.rate is None else faults.number("rate", self.rate, above=0.0)
        fits = isinstance(self.controller, SharedController)
        if fits and allocation is not None and not checks.is_traced(allocation):
            self._check_allocation(allocation, faults)
        faults.finish()
        set_field(self, lower=lower, caution=caution, allocation=allocation, rate=rate)

    def _check_allocation(self, M: np.ndarray, faults: checks.Faults) -> None:
        if M.shape[1] != self.size:
            faults.add(
                f"`allocation` must have a column for each of {checks.counted(self.size, 'input')}. Got {M.shape[1]}."
            )
        elif np.linalg.matrix_rank(M) < len(M):
            faults.add(
                f"`allocation` must have independent rows: these inputs cannot move {len(M)} quantities independently. Give "
                "linearly independent rows of B."
            )

    @property
    def size(self) -> int:
        """The number of inputs."""
        return self.controller.size

    @property
    def references(self) -> int:
        """The number of references."""
        return self.controller.references

    def check(self, names: Names, faults: checks.Faults) -> None:
        """Check that an estimator whose columns have these names suits this controller."""
        self.controller.check(names, faults)
        if not names.gains:
            faults.add(
                "`controller` needs an estimated gain, but the estimator has none: use UnknownGain, "
                "preferably inside ChangeDetection."
            )
        elif len(names.gains) not in (1, self.size):
            faults.add(
                f"`controller` needs one gain, or one for each of {checks.counted(self.size, 'input')}. The estimator has "
                f"{len(names.gains)}: {checks.listed(names.gains)}."
            )

    def init(self) -> Any:
        """The state of the wrapped controller. With a `rate` also 1 / K~ of each input, at full effect."""
        return self.controller.init() if self.rate is None else (self.controller.init(), jnp.ones(self.size))

    def act(self, state: Any, estimate: Info, reference: Array) -> tuple[Any, Array, Mapping[str, Array]]:
        """The input (m,), and a report of the `effect` that it assumes."""
        K = jnp.maximum(jnp.asarray(estimate.gain), self.lower)
        variance = jnp.sum(jnp.asarray(estimate.gain_covariance) * jnp.eye(K.shape[0]), axis=0)
        effect = K + self.caution * variance / K
        if self.rate is None:
            state, u, reported = self.controller.act(state, estimate, reference, self._share(effect, K))
            return state, u, {**reported, "effect": effect}
        state, inverse = state
        inverse = jnp.clip(1 / effect, inverse - self.rate, inverse + self.rate)
        state, u, reported = self.controller.act(state, estimate, reference, self._share(1 / inverse, K))
        return (state, inverse), u, {**reported, "effect": 1 / inverse}

    def _share(self, effect: Array, K: Array) -> Any:
        """The divisor of the demand, or the matrix that reallocates it between the inputs."""
        if self.allocation is None:
            return effect
        M = jnp.asarray(self.allocation)
        left = jnp.where(self.lower < K, effect, 0.0)
        G = M * left[None, :]
        L = factor(gram(G))
        wanted = solve_lower(L, solve_lower(L, M), transpose=True)  # (G G')^-1 M
        return product(G.T, wanted)
