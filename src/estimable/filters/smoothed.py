"""A gain averaged over time."""

from typing import Any

import jax.numpy as jnp

from .. import checks
from ..frozen import frozen, replace, set_field
from ..models.prior import Prior
from ..protocols import Wrapper
from ..results import Info, Interval, Sample
from . import wrapped


@frozen
class Average:
    """The state of the wrapped algorithm, and the gain (p,) averaged so far."""

    state: Any
    gain: Any


@frozen
class Smoothed(Wrapper[Average]):
    """A wrapper around another algorithm, which averages its estimated gain exponentially over time.

    Model: that of the algorithm, which estimates the gain K^[k]. The reported gain is K~[k] = a K~[k-1] + (1 - a) K^[k] with
    a = `weight`. It starts at the mean of the gain's prior. Nothing else changes: neither the covariance of the gain nor the
    internal belief of the algorithm.

    Assumes that the gain changes slowly compared with 1 / (1 - a) samples. The average lags behind a jump by as much: k
    samples after it, the fraction a^k of the jump is still missing. If the errors of the estimate are already correlated over
    many samples, as those of a recursive filter, averaging adds the lag and removes little noise.

    Settings: `algorithm`, one that estimates a gain; `weight` a in [0, 1), (p,) or one number; 0.9 in the reference.

    Cost: two multiplications per gain and sample.

    Reference: A. G. Sillence (1999) (85).

    >>> model = StateSpace([[0.5]], [[1.0]], Q=[[0.0]], R=[[0.01]], dt=1)
    >>> smoothed = Smoothed(UnknownGain(model, Prior([1.0], [[0.0]])), 0.9)
    >>> estimate(smoothed, Record([0.0, 2.0], [1.0, 1.0], dt=1), prior=Prior([0.0], [[0.0]])).gain.ravel().tolist()
    [1.0, 1.0]
    """

    algorithm: Any
    weight: Any

    def __post_init__(self):
        faults = checks.Faults()
        wrapped.check_gain(self.algorithm, "Smoothed", faults)
        faults.finish()
        weight = wrapped.per_gain("weight", self.weight, self.algorithm, faults)
        if weight is not None and not checks.is_traced(weight) and not ((weight >= 0) & (weight < 1)).all():
            hint = " With 1 the estimate would never move." if (weight == 1).any() else ""
            faults.add(f"`weight` must be at least 0 and below 1. Got {checks.short(self.weight)}.{hint}")
        faults.finish()
        set_field(self, weight=weight)

    def init(self, prior: Prior) -> Average:
        """The algorithm's state before y[0], and the prior mean of the gain."""
        return Average(self.algorithm.init(prior), jnp.asarray(self.algorithm.innermost.gain.mean))

    def correct(self, state: Average, sample: Sample) -> tuple[Average, Info]:
        """Update with one sample, and report the averaged gain."""
        inner, info = self.algorithm.correct(state.state, sample)
        gain = self.weight * state.gain + (1 - self.weight) * info.gain
        return Average(inner, gain), replace(info, gain=gain, gain_quantiles=None)  # those are of the newest gain

    def predict(self, state: Average, interval: Interval) -> Average:
        """Move to the next sample."""
        return replace(state, state=self.algorithm.predict(state.state, interval))
