"""A filter with a given, constant gain."""

from dataclasses import field
from typing import Any, Self

import jax.numpy as jnp

from .. import checks
from ..annotations import Array
from ..frozen import frozen, replace, set_field
from ..kernels import joseph as kernel
from ..models.prior import Prior
from ..models.sampled import Clock
from ..models.state_space import StateSpace
from ..protocols import Algorithm
from ..results import Info, Interval, Names, Sample, outcome_code
from .belief import Belief
from .kalman_filter import Kalman


@frozen
class FixedGain(Algorithm[Belief]):
    """A filter with a given gain. It reports the true covariance of its error, not that of the optimal filter.

    Model: x[k+1] = A x[k] + B u[k] + G w[k], y[k] = C x[k] + D u[k] + v[k], as that of `Kalman`. At each sample the mean
    moves by K (y - C x - D u), over the seen outputs, with the given gain K. The covariance becomes (I - K C) P
    (I - K C)' + K R K'.

    Assumes that A, B, C and D are right. For the covariance Q and R must be right too. It then holds for any gain, also for
    one that was tuned for other noises or made robust, and then shows its accuracy under the noises of this model. Where the
    error grows, so does the covariance. `log_likelihood` is the sum for the one-step predictions. It is that of the record
    only for the Kalman gain, since the innovations of another gain are correlated in time. While directions of the state are
    diffuse, the filter works as `Kalman`: two samples start a tracker of position and velocity.

    Settings: `model`, a `StateSpace` with R; `filter` (n, p), the gain K: `kalman_gain(model).filter`, that of
    `trans_kalman`, or any other. The gain applies to a sample, so a continuous model must be discretised before its gain is
    computed.

    Cost: that of `Kalman`, which gives the innovations, and n p (2 n + p) multiplications.

    Reference: R. W. Bass (2005); R. S. Bucy, P. D. Joseph, Filtering for Stochastic Processes (1968), ch. XVI.

    >>> model = StateSpace([[1.0]], Q=[[0.0]], R=[[1.0]], dt=1)
    >>> result = estimate(FixedGain(model, [[0.5]]), Record([4.0, 4.0], dt=1), prior=Prior([0.0], [[1.0]]))
    >>> result.mean.ravel().tolist(), result.covariance.ravel().tolist()  # Kalman: [2.0, 2.667], [0.5, 0.333]
    ([2.0, 3.0], [0.5, 0.375])
    """

    model: StateSpace
    filter: Any
    kalman: Kalman | None = field(default=None, init=False)

    def __post_init__(self):
        faults = checks.Faults()
        if faults.instance("model", self.model, StateSpace):
            faults.learn("n", self.model.n, self.model.size_source)
            faults.learn("p", self.model.p, f"the model has {checks.counted(self.model.p, 'output')}")
        set_field(self, filter=faults.array("filter", self.filter, "n p"))
        faults.finish()

    @property
    def names(self) -> Names:
        """Names of states, inputs and outputs."""
        return Names(self.model.states, self.model.inputs, self.model.outputs)

    def sampled(self, clock: Clock) -> Self:
        """The same filter with its model discretised for the steps of `clock` and its noises factored."""
        return replace(self, kalman=Kalman(self.model).sampled(clock), model=None)

    def at(self, k: int | Array) -> Self:
        """The filter at row k of a time-varying model."""
        return replace(self, kalman=self._kalman_filter.at(k))

    @property
    def _kalman_filter(self) -> Kalman:
        """The Kalman filter of the same model."""
        return Kalman(self.model).sampled(Clock.every(self.model.dt)) if self.kalman is None else self.kalman

    def init(self, prior: Prior) -> Belief:
        """The belief about x[0], before y[0]."""
        return self._kalman_filter.init(prior)

    def correct(self, state: Belief, sample: Sample) -> tuple[Belief, Info]:
        """Update the belief with one sample."""
        return correct_by(self.filter, self._kalman_filter, state, sample)

    def predict(self, state: Belief, interval: Interval) -> Belief:
        """Move to the next sample."""
        return self._kalman_filter.predict(state, interval)


def correct_by(K: Array, kalman: Kalman, state: Belief, sample: Sample) -> tuple[Belief, Info]:
    """The belief after one sample with the gain K (n, p), and its report; `kalman` supplies the innovations."""
    optimal, info = kalman.correct(state, sample)
    after = _moved(jnp.asarray(K), kalman, state, sample, optimal)
    reported = kalman.tell(after)
    code = outcome_code(info.outcome == 2, after.mean, after.factor, after.diffuse)
    return after, replace(
        info,
        mean=reported.mean,
        covariance=reported.covariance,
        diffuse_covariance=reported.diffuse_covariance,
        outcome=code,
    )


def _moved(K: Array, kalman: Kalman, state: Belief, sample: Sample, optimal: Belief) -> Belief:
    """The belief after a sample; that of the Kalman filter while a direction is diffuse."""
    moved, drift = kernel.correct(state.gaussian, K, kalman.measurement(sample), sample.y, sample.seen)
    after = Belief(*moved, *(drift or ()))
    if state.diffuse.shape[1] == 0:
        return after
    learning = jnp.any(state.diffuse != 0)
    pairs = ((getattr(optimal, name), getattr(after, name)) for name in Belief.__dataclass_fields__)
    return Belief(*(None if new is None else jnp.where(learning, old, new) for old, new in pairs))
