"""A small movement of the inputs while a gain is not known well enough."""

from collections.abc import Mapping
from dataclasses import KW_ONLY
from typing import Any

import jax.numpy as jnp
import numpy as np

from .. import checks
from ..analysis.gain_information import gain_information
from ..annotations import Array, Numbers
from ..frozen import frozen, set_field, static
from ..models.state_space import StateSpace
from ..protocols import SharedController
from ..results import Info, Names
from .state_feedback import check_inner

RELEASE = 0.7  # of the wanted sigma, below which the dither ends, so that it does not restart at the next sample


@frozen
class Dither(SharedController[Any]):
    """A controller that adds a small square wave to its inputs while a gain is not known well enough.

    Model: u = u_law + a s[k] while the dither is on, with a the `amplitude`, and s a square wave of ±1 that starts with +1.
    The dither switches on when the standard deviation of any gain exceeds `sigma`, and off when all are below .7 `sigma`. In
    straight and level flight the inputs carry no information about a gain. The variance of the gain then grows with its walk,
    until a dither is needed.

    Assumes that the variance of a gain grows while there is no information, as in `UnknownGain(..., walk=...)`. In
    `ChangeDetection` without a walk it does not grow. If the gain is well known in advance, no dither is added.

    Settings: `controller`, such as `StateFeedback`; `amplitude` (m,) or one number, in units of the input
    (`Dither.sized` computes it); `period`, an even number of samples: a dither near the natural frequency of the plant is the
    most informative for its size; `sigma`, the wanted standard deviation of each gain. Inside `GainReconfiguration` the
    dither is not divided by the gain, because its information does not depend on the gain.

    Reports `dither` (m,), the part that was added. Cost: one comparison per gain.

    Reference: A. G. Sillence (1999), §6.3, asks for a dither; the rule is ours.

    >>> law = Dither(StateFeedback([[0.0]]), amplitude=0.5, period=4, sigma=0.1)
    >>> uncertain = Info(mean=np.array([0.0]), gain=np.array([1.0]), gain_covariance=np.array([[0.04]]))
    >>> state, u, _ = law.act(law.init(), uncertain, np.zeros(0))
    >>> u.tolist()
    [0.5]
    """

    controller: Any
    _: KW_ONLY
    amplitude: Any
    period: int = static()
    sigma: Any

    def __post_init__(self):
        faults = checks.Faults()
        check_inner(self.controller, "Dither", faults)
        faults.finish()
        m = self.controller.size
        faults.learn("m", m, f"the controller has {checks.counted(m, 'input')}")
        given = [self.amplitude] * m if checks.depth(self.amplitude) == 0 else self.amplitude
        amplitude = faults.array("amplitude", given, "m")
        faults.whole("period", self.period, 2)
        if isinstance(self.period, int) and self.period % 2:
            faults.add(
                f"`period` must be an even number of samples: half of it up, half of it down. Got {self.period}."
            )
        sigma = faults.number("sigma", self.sigma, above=0.0)
        faults.finish()
        set_field(self, amplitude=amplitude, sigma=sigma)

    @staticmethod
    def sized(
        controller: SharedController[Any],
        model: StateSpace,
        *,
        sigma: float,
        seconds: float,
        period: int,
        dt: float,
        directions: Numbers | str | None = None,
        each: Numbers | None = None,
    ) -> "Dither":
        """A dither of the amplitude that reduces the standard deviation of every gain to `sigma` within `seconds`.

        The amplitude is computed for inputs that are otherwise zero, and without prior knowledge of the gains. `model` and
        `directions`: those of the `UnknownGain`, with constant gains. `each` (m,): the relative sizes of the inputs
        (default: all equal). The inputs act without an actuator. Behind an actuator of bandwidth ω, multiply the amplitude by
        sqrt(1 + (2 pi / (period dt ω))²), which compensates for its attenuation. Raises `AssumptionError` where no amplitude
        is enough.

        >>> model = StateSpace([[0.5]], [[1.0]], Q=[[0.0]], R=[[0.01]], dt=0.1)
        >>> law = Dither.sized(StateFeedback([[0.0]]), model, sigma=0.05, seconds=5.0, period=4, dt=0.1)
        >>> 0.1 < float(law.amplitude[0]) < 0.5
        True
        """
        faults = checks.Faults()
        check_inner(controller, "Dither", faults)
        dt = faults.number("dt", dt, above=0.0, unit="seconds")
        seconds = faults.number("seconds", seconds, above=0.0, unit="seconds")
        sigma = faults.number("sigma", sigma, above=0.0)
        faults.whole("period", period, 2)
        faults.instance("model", model, StateSpace)
        if dt and seconds and seconds / dt > checks.MOST_ROWS:
            faults.add(
                f"`seconds` must be at most {checks.MOST_ROWS:,} samples of `dt`. Got {seconds:g} s of {dt:g} s."
            )
        faults.finish()
        rows = max(2, round(seconds / dt))
        faults.learn("m", controller.size, f"the controller has {checks.counted(controller.size, 'input')}")
        shape = np.ones(controller.size) if each is None else np.asarray(faults.array("each", each, "m"))
        faults.finish()
        wave = np.where(np.arange(rows) % period < period / 2, 1.0, -1.0)[:, None] * shape
        found = gain_information(
            model, np.zeros_like(wave), directions=directions, dither=wave, dt=dt if model.is_continuous else None
        )
        return Dither(controller, amplitude=found.amplitude_for(sigma) * shape, period=period, sigma=sigma)

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
            faults.add("`controller` dithers until a gain is known, but the estimator estimates none: use UnknownGain.")

    def init(self) -> Any:
        """The state of the wrapped controller, whether the dither is on, and for how many samples."""
        return self.controller.init(), jnp.zeros((), bool), jnp.zeros((), int)

    def act(
        self, state: Any, estimate: Info, reference: Array, effect: Array | float = 1.0
    ) -> tuple[Any, Array, Mapping[str, Array]]:
        """The input (m,), and a report of the `dither` in it."""
        inner, on, count = state
        P = jnp.asarray(estimate.gain_covariance)
        worst = jnp.max(jnp.sum(P * jnp.eye(P.shape[0]), axis=0))
        on = (worst > self.sigma**2) | (on & (worst > (RELEASE * self.sigma) ** 2))
        inner, u, reported = self.controller.act(inner, estimate, reference, effect)
        added = jnp.where(on, jnp.where(count < self.period // 2, 1.0, -1.0), 0.0) * self.amplitude
        count = jnp.where(on, jnp.where(count + 1 < self.period, count + 1, 0), 0)
        return (inner, on, count), u + added, {**reported, "dither": added}
