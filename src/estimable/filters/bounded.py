"""A gain that is kept between bounds."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from .. import checks
from ..frozen import frozen, replace, set_field
from ..models.prior import Prior
from ..models.sampled import Clock
from ..results import Info, Interval, Names, Sample
from . import wrapped


@frozen
class Bounded:
    """An algorithm whose estimated gain is reported within bounds.

    Model: that of the algorithm. The gain that it reports is clipped to [lower, upper]; nothing else is changed, neither
    the covariance of the gain nor what the algorithm believes and goes on with.

    Assumes that the true gain lies between the bounds. Then clipping brings the estimate nearer, whatever the estimate
    was; otherwise it hides by how much the bounds are missed. The clipped estimate is biased near a bound.

    Settings: `algorithm`, one that estimates a gain; `lower` and `upper`, (p,) or one number.

    Cost: two comparisons a gain.

    Reference: A. G. Sillence (1999) §5.5.

    >>> model = StateSpace([[0.5]], [[1.0]], Q=[[0.0]], R=[[0.01]], dt=1)
    >>> bounded = Bounded(UnknownGain(model, Prior([1.0], [[1.0]])), 0.0, 1.0)
    >>> estimate(bounded, Record([0.0, 2.0], [1.0, 1.0], dt=1), prior=Prior([0.0], [[0.0]])).gain.ravel().tolist()
    [1.0, 1.0]
    """

    algorithm: Any
    lower: Any
    upper: Any

    def __post_init__(self):
        faults = checks.Faults()
        wrapped.check_gain(self.algorithm, "Bounded", faults)
        faults.finish()
        lower, upper = (
            wrapped.per_gain(name, getattr(self, name), self.algorithm, faults) for name in ("lower", "upper")
        )
        if lower is not None and upper is not None and not checks.is_traced(lower, upper) and np.any(lower > upper):
            faults.add(f"`lower` must not be above `upper`. Got {lower.tolist()} and {upper.tolist()}.")
        faults.finish()
        set_field(self, lower=lower, upper=upper)

    @property
    def names(self) -> Names:
        """Names of states, inputs, outputs and gains."""
        return self.algorithm.names

    def sampled(self, clock: Clock) -> "Bounded":
        """The same bounds on the algorithm sampled."""
        return replace(self, algorithm=self.algorithm.sampled(clock))

    def at(self, k) -> "Bounded":
        """The same bounds on the algorithm at row k of a time-varying model."""
        return replace(self, algorithm=self.algorithm.at(k))

    def init(self, prior: Prior) -> Any:
        """What the algorithm believes before y[0]."""
        return self.algorithm.init(prior)

    def correct(self, state: Any, sample: Sample) -> tuple[Any, Info]:
        """Learn from one sample, and report the gain within the bounds."""
        state, info = self.algorithm.correct(state, sample)
        return state, replace(info, gain=jnp.minimum(jnp.maximum(info.gain, self.lower), self.upper))

    def predict(self, state: Any, interval: Interval) -> Any:
        """Move to the next sample."""
        return self.algorithm.predict(state, interval)
