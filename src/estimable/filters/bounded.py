"""A gain reported within bounds."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from .. import checks
from ..frozen import frozen, replace, set_field
from ..protocols import Wrapper
from ..results import Info, Sample
from . import wrapped


@frozen
class Bounded(Wrapper[Any]):
    """A wrapper around another algorithm, which reports its estimated gain within bounds.

    Model: that of the algorithm. The reported gain is clipped to [lower, upper]. Nothing else changes: neither the covariance
    of the gain nor the internal belief of the algorithm.

    Assumes that the true gain lies between the bounds. Then clipping always brings the estimate nearer. Otherwise it hides
    how far the gain lies outside the bounds. The clipped estimate is biased near a bound.

    Settings: `algorithm`, one that estimates a gain; `lower` and `upper`, (p,) or one number.

    Cost: two comparisons per gain and sample.

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

    def correct(self, state: Any, sample: Sample) -> tuple[Any, Info]:
        """Update with one sample, and report the gain within the bounds."""
        state, info = self.algorithm.correct(state, sample)
        inside = jnp.minimum(jnp.maximum(info.gain, self.lower), self.upper)
        quantiles = info.gain_quantiles
        if quantiles is not None:
            quantiles = jnp.minimum(jnp.maximum(quantiles, self.lower[:, None]), self.upper[:, None])
        return state, replace(info, gain=inside, gain_quantiles=quantiles)
