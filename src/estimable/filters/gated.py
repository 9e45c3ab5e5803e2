"""An algorithm that rejects samples implausible under its own prediction."""

from dataclasses import field
from typing import Any, Self

import jax.numpy as jnp
from jax.scipy.special import erfinv

from .. import checks
from ..annotations import Array
from ..frozen import frozen, replace, set_field
from ..models.sampled import Clock
from ..protocols import Wrapper
from ..results import Info, Sample
from . import wrapped


@frozen
class Gated(Wrapper[Any]):
    """A wrapper around another algorithm, which treats an output as missing where its innovation is implausibly large.

    Model: that of the algorithm. Output i is rejected where its innovation e_i has e_i² > q S_ii. Here S_ii is the variance
    of e_i, and q is the quantile of the χ² distribution with one degree of freedom that a good sample stays below with
    `probability`. Each output has its own gate; the other outputs of the sample are still used. An output that cannot be
    predicted (under a diffuse prior) passes.

    Assumes that the innovation covariance is right and good samples are Gaussian. Then a fraction 1 - probability of the good
    samples is lost. A rejected sample carries no information. After a true jump of the state, all samples may be rejected,
    unless process noise lets the covariance grow. To follow jumps use `ChangeDetection`, and give Q.

    Settings: `algorithm`; `probability`, in (0, 1), that a good sample of an output passes.

    Reports in `extra`: `rejected` (outputs,), the seen outputs that were rejected.

    Cost: the correction of the algorithm is calculated twice per sample: to find the innovations, and
    without the rejected outputs.

    Reference: Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and Navigation (2001) §5.4
    (the normalised innovation).

    >>> model = StateSpace([[1.0]], C=[[1.0]], Q=[[0.1]], R=[[1.0]], dt=1)
    >>> gated = Gated(Kalman(model), 0.999)
    >>> result = estimate(gated, Record([0.0, 90.0, 0.0], dt=1), prior=Prior([0.0], [[1.0]]))
    >>> result.mean.ravel().tolist(), result.extra["rejected"].ravel().tolist()
    ([0.0, 0.0, 0.0], [False, True, False])
    """

    algorithm: Any
    probability: Any
    limit: Any = field(default=None, init=False)

    def __post_init__(self):
        faults = checks.Faults()
        wrapped.check_algorithm(self.algorithm, faults)
        if not faults.sentences and not self.algorithm.has_innovation_covariance:
            faults.add(
                "`algorithm` must report the covariance of its innovations: give AlphaBeta `sigma_a2` and `sigma_s2`."
            )
        probability = faults.number("probability", self.probability, above=0.0)
        if probability is not None and not checks.is_traced(probability) and probability >= 1:
            hint = ": a gate that every good sample passes rejects nothing" if probability == 1 else ""
            faults.add(f"`probability` must be below 1{hint}. Got {probability:g}.")
        faults.finish()
        set_field(self, probability=probability)

    def sampled(self, clock: Clock) -> Self:
        """The same gate with its algorithm sampled and its quantile computed."""
        return replace(self, algorithm=self.algorithm.sampled(clock), limit=_quantile(self.probability))

    def correct(self, state: Any, sample: Sample) -> tuple[Any, Info]:
        """Update with the plausible outputs of one sample."""
        _, foreseen = self.algorithm.correct(state, sample)
        if foreseen.innovation_covariance is None:
            name = type(self.algorithm.innermost).__name__
            checks.refuse(f"`algorithm` must report the covariance of its innovations: {name} reports none.")
        variance = jnp.sum(foreseen.innovation_covariance * jnp.eye(sample.y.shape[0]), axis=1)
        error = jnp.where(sample.seen, foreseen.innovation, 0.0)
        limit = _quantile(self.probability) if self.limit is None else self.limit
        rejected = sample.seen & (error * error > limit * variance)
        state, info = self.algorithm.correct(state, replace(sample, seen=sample.seen & ~rejected))
        return state, replace(info, extra={**(info.extra or {}), "rejected": rejected})


def _quantile(probability: Array | float):
    """The quantile of χ² with one degree of freedom."""
    return 2 * erfinv(jnp.asarray(probability)) ** 2
