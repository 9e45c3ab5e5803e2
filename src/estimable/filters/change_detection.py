"""Detection of gain jumps: their time and size."""

from dataclasses import KW_ONLY
from typing import Any, Self

import jax
import jax.numpy as jnp
import numpy as np

from .. import checks
from ..annotations import Array
from ..frozen import frozen, replace, set_field, static
from ..kernels import jumps
from ..kernels.small import factor, product
from ..models.prior import Prior
from ..models.sampled import Clock
from ..protocols import JumpingGains, Wrapper
from ..results import Info, Interval, Sample
from .belief import Belief


@frozen
class Watch:
    """The belief given no recent jump, and the effect of each possible jump.

    The H = length × p possible jumps are ordered newest first, gain by gain: `response` (n+p, H), of the mean to a jump of 1;
    `score` and `information` (H,), of its size; `weight` (H,), the seconds it represents, 0 where there is none.
    `drift_response`, between `correct` and `predict` of a model with cross noise: that of the drift. `row`: of the sample;
    `onset`, `onset_sigma` and `jump` (p,): row of the last change, its standard deviation in rows, and its size.
    """

    belief: Belief
    response: Any
    score: Any
    information: Any
    weight: Any
    row: Any
    onset: Any
    onset_sigma: Any
    jump: Any
    drift_response: Any = None


@frozen
class ChangeDetection(Wrapper[Watch]):
    """A gain estimator that detects jumps of a gain, with their time and size.

    Model: that of the algorithm, with gains that are constant except for jumps. At any sample one of them may change by a
    Gaussian step with mean 0 and variance `jump`. For a known input the model is linear. The response of every later
    innovation to every possible jump then follows from a recursion, and the size of the jump is integrated over. This gives
    the exact likelihood ratio of a jump at each of the last `length` samples, against no jump.

    Alarm: the likelihood ratios are summed over the possible times of the jump, each weighted by the seconds that it
    represents. The detector raises an alarm when the sum exceeds `seconds_between_false_alarms` (the Shiryaev-Roberts test).
    While no gain jumps, the sum minus the elapsed time has mean zero. The mean time to a false alarm is therefore at least
    that number. (Measured: two to four times as long.) At an alarm the belief becomes the posterior given a jump, averaged
    over its time, and the detector restarts, so that several jumps may follow each other. Without an alarm nothing changes,
    and the estimate is as smooth as that of a constant gain.

    Assumes what `UnknownGain` assumes. A wrong model looks like a jump. In particular, process noise Q that represents
    unmodelled dynamics is correlated in time, unlike white noise; `persistence` is the duration of this correlation. Gains
    that jump together are found one after the other. A jump between two samples is attributed to one of them. A drifting gain
    needs a `walk`; where it drifts fast, use `UnknownGain` with that walk alone.

    Settings:

    - `algorithm`: an `UnknownGain`, or an `ExtendedKalman` or `SecondOrderKalman` with parameters. For the latter two the
      model is linearised, and the ratios and the bound are approximate. The walk and the forgetting of the algorithm are not
      used.
    - `jump`: the variance of a jump of each gain, (p,) or one number (default None: that of the gain's prior).
    - `length`: how many samples back a jump may lie (default 60).
    - `seconds_between_false_alarms` (default 3,600), in the unit of dt.
    - `walk`: the variance per second between the jumps, as in `UnknownGain` (default 0).
    - `persistence`: the number of samples for which process noise lasts. Q is multiplied by it
      (default 15; 1 where Q is white).

    Reports in `extra`: `statistic`, the logarithm of the sum divided by its threshold (NaN at the first sample), and `alarm`.
    Also of the last jump: `onset`, its likeliest row (-1 before the first jump), `onset_sigma`, the root mean square distance
    of the onset from that row, in rows, as known at the alarm, and `jump` (p,), its size. `diagnostics.changes` lists all
    jumps.

    Cost: three times that of `UnknownGain`, and about p length (2 (n + p)² + 40) multiplications.

    Reference: A. S. Willsky, H. L. Jones, IEEE Trans. Automatic Control 21 (1976) 108-112, (14)-(22), for the responses; M.
    Pollak, Annals of Statistics 13 (1985) 206-227, for the sum and its bound.

    >>> model = StateSpace([[0.5]], [[1.0]], Q=[[0.0]], R=[[0.01]], dt=1)
    >>> watched = ChangeDetection(UnknownGain(model, Prior([1.0], [[0.0]])), jump=1.0, length=10)
    >>> record = Record([0.0, 1.0, 1.5, 1.75, 1.4, 1.2], np.ones(6), dt=1)
    >>> result = estimate(watched, record, prior=Prior([0.0], [[0.0]]))
    >>> result.extra["alarm"].tolist(), int(result.extra["onset"][-1])
    ([False, False, False, False, True, False], 3)
    """

    algorithm: Any
    _: KW_ONLY
    jump: Any = None
    length: int = static(default=60)
    seconds_between_false_alarms: Any = 3600.0
    walk: Any = 0.0
    persistence: Any = 15.0

    def __post_init__(self):
        faults = checks.Faults()
        self._check_algorithm(faults)
        faults.whole("length", self.length, 2, checks.LARGEST_ORDER)
        seconds = faults.number("seconds_between_false_alarms", self.seconds_between_false_alarms, above=0.0)
        persistence = faults.number("persistence", self.persistence, lower=1.0)
        faults.finish()
        jump, walk = self._read_jump(faults), self.algorithm.read_walk(self.walk, faults)
        faults.finish()
        set_field(self, jump=jump, seconds_between_false_alarms=seconds, walk=walk)
        set_field(self, persistence=persistence if checks.is_traced(persistence) else np.asarray(persistence))

    def _check_algorithm(self, faults: checks.Faults) -> None:
        if not isinstance(self.algorithm, JumpingGains):
            faults.add(
                "`algorithm` must be an UnknownGain, or an ExtendedKalman or SecondOrderKalman with parameters. Got "
                f"{checks.short(self.algorithm)}. A jump can be detected only in a gain that the algorithm estimates."
            )
        elif self.algorithm.gain is None:
            faults.add("`algorithm` estimates no parameter: give it `parameters`, so that their jumps can be detected.")

    def _read_jump(self, faults: checks.Faults) -> Any:
        gain = self.algorithm.gain
        if checks.is_traced(self.jump, gain):
            return self.jump
        given = np.diagonal(gain.covariance) if self.jump is None else self.jump
        given = [given] * gain.size if isinstance(given, int | float) else given
        faults.learn("gains", gain.size, f"`gain` is a prior of {checks.counted(gain.size, 'gain')}")
        jump = faults.array("jump", given, "gains")
        if jump is not None and np.any(jump <= 0):
            source = "The prior of the gain has" if self.jump is None else "Got"
            faults.add(f"`jump` must be variances of a jump, greater than 0. {source} {checks.short(jump.tolist())}.")
        return jump

    def sampled(self, clock: Clock) -> Self:
        """The same detector with its algorithm sampled."""
        Q = self.algorithm.model.Q
        lasting = self.persistence.reshape(self.persistence.shape + (1,) * (Q.ndim - self.persistence.ndim))
        return replace(self, algorithm=self.algorithm.constant(self.walk, lasting).sampled(clock))

    def at(self, k: int | Array) -> Self:
        """The detector at row k of a time-varying model."""
        return replace(self, algorithm=self._ready.at(k))

    @property
    def _ready(self) -> Any:
        """The algorithm as used here: with a constant gain and process noise that lasts."""
        if self.algorithm.ready is not None:
            return self.algorithm
        return self.sampled(Clock.every(self.algorithm.model.dt)).algorithm

    def init(self, prior: Prior) -> Watch:
        """The belief before y[0]; no jump can precede it."""
        belief, p = self._ready.init(prior), self.jump.shape[0]
        none = jnp.zeros(self.length * p)
        response = jnp.zeros((belief.mean.shape[0], self.length * p))
        return Watch(
            belief, response, none, none, none,
            row=jnp.zeros((), int), onset=-jnp.ones((), int), onset_sigma=jnp.zeros(()), jump=jnp.zeros(p),
        )  # fmt: skip

    def correct(self, state: Watch, sample: Sample) -> tuple[Watch, Info]:
        """Update state, gain and every possible jump with one sample."""
        belief, info = self._ready.correct(state.belief, sample)
        J, J_drift, E, white = self._sensitivities(state.belief, sample)
        score, information = jumps.learn(state.response, state.score, state.information, E, white)
        watch = replace(
            state, belief=belief, score=score, information=information, response=product(J, state.response),
            drift_response=None if J_drift is None else product(J_drift, state.response),
        )  # fmt: skip
        verdict = jumps.judge(score, information, jnp.concatenate([self.jump] * self.length), state.weight)
        statistic = verdict.log_sum - jnp.log(self.seconds_between_false_alarms)
        watch = self._restart(watch, verdict, statistic > 0)
        return watch, self._tell(watch, info, statistic)

    def _sensitivities(self, belief: Belief, sample: Sample):
        """Derivatives with respect to the predicted mean: of the updated mean, of the drift, and of the whitened innovations;
        and these innovations."""

        def after(mean: Array):
            moved, post = self._ready.condition(replace(belief, mean=mean), sample, belief)
            informed = ~jnp.isnan(post.error)
            white = jnp.where(informed, post.error, 0.0) / jnp.sqrt(jnp.where(informed, post.variance, 1.0))
            return (moved.mean, moved.drift_mean, white), white

        (J, J_drift, E), white = jax.jacfwd(after, has_aux=True)(belief.mean)
        return J, J_drift, E, white

    def _restart(self, watch: Watch, verdict: jumps.Verdict, alarm: Array) -> Watch:
        """At an alarm: the belief averaged over the onsets, and a detector that starts again."""
        belief, n = watch.belief, watch.belief.mean.shape[0]
        response = watch.response
        if watch.drift_response is not None:
            response = jnp.concatenate([response, watch.drift_response])
        shift, spread = jumps.mixture(response, verdict)
        shift = jnp.where(alarm, shift, 0.0)
        wider = jnp.where(alarm, factor(spread), 0.0)
        belief = replace(
            belief, mean=belief.mean + shift[:n], factor=jnp.concatenate([belief.factor, wider[:n]], axis=1)
        )
        if belief.drift_mean is not None:
            belief = replace(
                belief, drift_mean=belief.drift_mean + shift[n:],
                drift_factor=jnp.concatenate([belief.drift_factor, wider[n:]], axis=1),
            )  # fmt: skip
        by_onset = (self.length, self.jump.shape[0])
        by_age = jnp.sum(verdict.probability.reshape(by_onset), axis=1)
        likeliest = jnp.argmax(by_age)
        apart = jnp.sqrt(jnp.sum(by_age * (jnp.arange(self.length) - likeliest).astype(float) ** 2))
        size = jnp.sum((verdict.probability * verdict.ν).reshape(by_onset), axis=0)
        return replace(
            watch, belief=belief,
            onset=jnp.where(alarm, watch.row - likeliest, watch.onset), jump=jnp.where(alarm, size, watch.jump),
            onset_sigma=jnp.where(alarm, apart, watch.onset_sigma),
            **{name: jnp.where(alarm, 0.0, getattr(watch, name)) for name in ("score", "information", "weight")},
        )  # fmt: skip

    def _tell(self, watch: Watch, info: Info, statistic: Array) -> Info:
        """The algorithm's report of the current belief."""
        now = self._ready.tell(watch.belief)
        found = {
            "statistic": statistic, "alarm": statistic > 0,
            "onset": watch.onset, "onset_sigma": watch.onset_sigma, "jump": watch.jump,
        }  # fmt: skip
        return replace(
            info, mean=now.mean, covariance=now.covariance, gain=now.gain, gain_covariance=now.gain_covariance,
            extra={**now.extra, **found},
        )  # fmt: skip

    def predict(self, state: Watch, interval: Interval) -> Watch:
        """Move to the next sample, at which a gain may have jumped."""

        def after(mean: Array, drift_mean: Array):
            return self._ready.predict(replace(state.belief, mean=mean, drift_mean=drift_mean), interval).mean

        belief, p = state.belief, self.jump.shape[0]
        Φ = jax.jacfwd(after)(belief.mean, belief.drift_mean)
        response = product(Φ, state.response)
        if state.drift_response is not None:
            response = response + product(jax.jacfwd(after, 1)(belief.mean, belief.drift_mean), state.drift_response)
        n = belief.mean.shape[0]
        new = jnp.eye(n)[:, n - p :]
        nothing = jnp.zeros(p)

        def shifted(first: Array, rest: Array):
            return jnp.concatenate([first, rest[..., :-p]], axis=-1)

        return replace(
            state, belief=self._ready.predict(belief, interval), response=shifted(new, response),
            score=shifted(nothing, state.score), information=shifted(nothing, state.information),
            weight=shifted(jnp.full(p, interval.dt / p), state.weight), row=state.row + 1, drift_response=None,
        )  # fmt: skip
