"""Detection of gain jumps: their time and size."""

from collections.abc import Callable
from dataclasses import KW_ONLY, field
from typing import Any, Self

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from .. import checks
from ..annotations import Array, Tree
from ..frozen import frozen, replace, set_field, static
from ..kernels import jumps, mixture_quantiles, onset_grid
from ..kernels.onset_grid import Grid
from ..kernels.small import diagonal
from ..models.prior import Prior
from ..models.sampled import Clock
from ..protocols import JumpingGains, Wrapper
from ..results import Info, Interval, Sample
from .belief import Belief
from .onset_filter import OnsetFilter, averaged, learn, moved, with_room

MOST_LEVELS = 40  # 2^40 rows
TOGETHER = ("any", "never")


@frozen
class Watch:
    """The filter, the one that decides alarms (None: the same), and the onsets.

    `seconds` (r,): the seconds that an onset represents, 0 where there is none; `onsets` (r,): their rows; `profile` (labels, r):
    their log-likelihood ratios. `row`: of the sample; `onset`, `onset_sigma`, `jump` (p,) and `jumped` (p,): row of the last
    change, its standard deviation in rows, its size, and the probability of each gain that it jumped.
    """

    track: OnsetFilter
    alarm: OnsetFilter | None
    seconds: Any
    onsets: Any
    profile: Any
    row: Any
    onset: Any
    onset_sigma: Any
    jump: Any
    jumped: Any


@frozen
class ChangeDetection(Wrapper[Watch]):
    """A gain estimator that detects jumps of a gain, with their time and size.

    Model: that of the algorithm, with gains that are constant except for jumps. At any sample one of them, or all together, may
    change by a Gaussian step with mean 0 and variance `jump` times one of `scales`. For a known input the model is linear. The
    response of every later innovation to every possible jump then follows from a recursion, and the size of the jump is
    integrated over. This gives the exact likelihood ratio of a jump at each onset, against no jump. The onsets are a grid that
    coarsens with their age (`kernels.onset_grid`).

    Alarm: the likelihood ratios are summed over the possible times of the jump, each weighted by the seconds that it
    represents. The detector raises an alarm when the sum exceeds `seconds_between_false_alarms` (the Shiryaev-Roberts test).
    While no gain jumps, the sum minus the elapsed time has mean zero. The mean time to a false alarm is therefore at least
    that number. (Measured: two to four times as long.) At an alarm the belief becomes the posterior given a jump, averaged
    over its time, and the detector restarts, so that several jumps may follow each other. Without an alarm nothing changes,
    and the estimate is as smooth as that of a constant gain.

    Interval: `gain` and `gain_covariance` are those without a jump since the last alarm. `gain_quantiles` (p, 5), the quantiles
    .025, .16, .5, .84 and .975, include the jumps that have not raised an alarm, with the prior odds of one jump in
    `seconds_between_changes`; `jump_probability` is their probability. The median and the outer quantiles are the answer: the
    standard deviation of that mixture is not. (A jump of .5 that is too recent to be seen has a probability of .002, and makes it
    five times as large.)

    Assumes what `UnknownGain` assumes. A wrong model looks like a jump. In a closed loop the input depends on past process noise,
    so that a wrong noise model also biases the gain. Where disturbances last, give the model `markov_disturbance`. A jump between
    two samples is attributed to one of them. For a gain that may also drift, use a `Mixture` of detectors with different `walk`s.

    Settings:

    - `algorithm`: an `UnknownGain`, or an `ExtendedKalman` or `SecondOrderKalman` with parameters. For the latter two the
      model is linearised, and the ratios and the bound are approximate. The walk and the forgetting of the algorithm are not
      used.
    - `jump`: the variance of a jump of each gain, (p,) or one number (default None: that of the gain's prior).
    - `scales`: factors of `jump`, equally probable (default 1 and .04: jumps of full size and of a fifth of it).
    - `together`: "any" (default): one gain jumps, or all at once; "never": one at a time.
    - `slots` and `levels` of the grid of onsets (default 8 and 8: back to 2,040 samples). `levels=1`: each of the last `slots`
      samples, and no other.
    - `seconds_between_false_alarms` (default 3,600) and `seconds_between_changes` (default 60), in the unit of dt.
    - `walk`: the variance per second between the jumps, as in `UnknownGain` (default 0).
    - `persistence` (default 1): a factor of Q in a second filter, which decides alarms and the probabilities of onsets. The
      estimate itself always uses the Q of the model. With a factor above 1, fewer alarms are due to disturbances that last.

    Reports in `extra`: `statistic`, the logarithm of the sum divided by its threshold (NaN at the first sample), and `alarm`.
    Also of the last jump: `onset`, its likeliest row (-1 before the first jump), `onset_sigma`, the root mean square distance
    of the onset from that row, in rows, as known at the alarm, `jump` (p,), its size, and `jumped` (p,), the probability of each
    gain that it jumped. `diagnostics.changes` lists all jumps. At an alarm `log_likelihood` includes the likelihood ratio over
    `seconds_between_changes`.

    Cost: three times that of `UnknownGain`, and about p · slots · levels (2 (n + p)² + 40) multiplications; the quantiles cost as
    much as 200 evaluations of a normal distribution for each hypothesis.

    Reference: A. S. Willsky, H. L. Jones, IEEE Trans. Automatic Control 21 (1976) 108-112, (14)-(22), for the responses; M.
    Pollak, Annals of Statistics 13 (1985) 206-227, for the sum and its bound; P. Fearnhead, Z. Liu, J. R. Statist. Soc. B 69
    (2007) 589-605, for the belief between alarms.

    >>> model = StateSpace([[0.5]], [[1.0]], Q=[[0.0]], R=[[0.01]], dt=1)
    >>> watched = ChangeDetection(UnknownGain(model, Prior([1.0], [[0.0]])), jump=1.0)
    >>> record = Record([0.0, 1.0, 1.5, 1.75, 1.4, 1.2], np.ones(6), dt=1)
    >>> result = estimate(watched, record, prior=Prior([0.0], [[0.0]]))
    >>> result.extra["alarm"].tolist(), int(result.extra["onset"][-1])
    ([False, False, False, False, True, False], 3)
    """

    algorithm: Any
    _: KW_ONLY
    jump: Any = None
    scales: Any = (1.0, 0.04)
    together: str = static(default="any")
    slots: int = static(default=8)
    levels: int = static(default=8)
    seconds_between_false_alarms: Any = 3600.0
    seconds_between_changes: Any = 60.0
    walk: Any = 0.0
    persistence: float = static(default=1.0)
    alarm_filter: Any = field(default=None, init=False)

    def __post_init__(self):
        faults = checks.Faults()
        self._check_algorithm(faults)
        faults.choice("together", self.together, TOGETHER)
        faults.whole("slots", self.slots, 2, checks.LARGEST_ORDER)
        faults.whole("levels", self.levels, 1, MOST_LEVELS)
        seconds = faults.number("seconds_between_false_alarms", self.seconds_between_false_alarms, above=0.0)
        changes = faults.number("seconds_between_changes", self.seconds_between_changes, above=0.0)
        persistence = faults.number("persistence", self.persistence, lower=1.0)
        scales = faults.array("scales", self.scales, "scales")
        if scales is not None and not checks.is_traced(scales) and (scales.size == 0 or np.any(scales <= 0)):
            faults.add(f"`scales` must be factors of `jump` greater than 0. Got {checks.short(self.scales)}.")
        faults.finish()
        jump, walk = self._read_jump(faults), self.algorithm.read_walk(self.walk, faults)
        faults.finish()
        set_field(self, jump=jump, scales=scales, walk=walk, persistence=persistence)
        set_field(self, seconds_between_false_alarms=seconds, seconds_between_changes=changes)

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

    @property
    def grid(self) -> Grid:
        """The possible onsets."""
        return Grid(self.slots, self.levels, self._labels)

    @property
    def _labels(self) -> int:
        """The kinds of jump: one of each gain, and one of all together."""
        p = self.jump.shape[-1]
        return p + self.jump_together

    @property
    def jump_together(self) -> bool:
        """Whether a jump of all gains at once is a hypothesis."""
        return self.together == "any" and self.jump.shape[-1] > 1

    def sampled(self, clock: Clock) -> Self:
        """The same detector with its algorithm sampled, and the filter that decides alarms where that is another one."""
        self._check_clock(clock)
        base, alarm = self.algorithm.constant(self.walk, 1.0), None
        if self.persistence != 1:
            alarm = self.algorithm.constant(self.walk, self.persistence).sampled(clock)
        return replace(self, algorithm=base.sampled(clock), alarm_filter=alarm)

    def _check_clock(self, clock: Clock) -> None:
        seconds, step = self.seconds_between_changes, np.max(clock.lengths, initial=0.0)
        if not checks.is_traced(seconds) and np.any(np.asarray(seconds) <= step):
            checks.refuse(
                f"`seconds_between_changes` must be longer than a step of the record ({step:g} s). Got {np.min(seconds):g} s."
            )

    def at(self, k: int | Array) -> Self:
        """The detector at row k of a time-varying model."""
        ready = self._ready
        alarm = None if ready.alarm_filter is None else ready.alarm_filter.at(k)
        return replace(ready, algorithm=ready.algorithm.at(k), alarm_filter=alarm)

    @property
    def _ready(self) -> Self:
        """The detector with sampled filters, of constant gains."""
        return self if self.algorithm.ready is not None else self.sampled(Clock.every(self.algorithm.model.dt))

    def init(self, prior: Prior) -> Watch:
        """The belief before y[0]; no jump can precede it."""
        self, grid, p = self._ready, self.grid, self.jump.shape[0]
        none = jnp.zeros(grid.size)

        def track(algorithm: JumpingGains[Belief]) -> OnsetFilter:
            belief = algorithm.init(prior)
            response = jnp.zeros((belief.mean.shape[0], p, grid.size))
            return OnsetFilter(belief, response, jnp.zeros((p, grid.size)), jnp.zeros((p, p, grid.size)))

        return Watch(
            track(self.algorithm), None if self.alarm_filter is None else track(self.alarm_filter),
            seconds=none, onsets=none - 1, profile=jnp.full((grid.labels, grid.size), -jnp.inf), row=jnp.zeros((), int),
            onset=-jnp.ones((), int), onset_sigma=jnp.zeros(()), jump=jnp.zeros(p), jumped=jnp.zeros(p),
        )  # fmt: skip

    def correct(self, state: Watch, sample: Sample) -> tuple[Watch, Info]:
        """Update state, gain and every possible jump with one sample."""
        self = self._ready
        track, info, _, _ = learn(self.algorithm, state.track, sample)
        evidence = self._weigh(track)
        if state.alarm is None or self.alarm_filter is None:
            alarm, suspected = None, evidence
        else:
            alarm = learn(self.alarm_filter, state.alarm, sample)[0]
            suspected = self._weigh(alarm)
        verdict = jumps.judge(suspected, state.seconds)
        own = verdict if alarm is None else jumps.judge(evidence, state.seconds)
        statistic = verdict.log_sum - jnp.log(self.seconds_between_false_alarms)
        at_alarm = own.log_sum - jnp.log(self.seconds_between_changes)
        watch = replace(state, track=with_room(track), alarm=alarm and with_room(alarm), profile=verdict.profile)
        watch = lax.cond(statistic > 0, lambda w: _restarted(w, verdict, evidence, suspected), lambda w: w, watch)
        info = replace(info, log_likelihood=info.log_likelihood + jnp.where(statistic > 0, at_alarm, 0.0))
        return watch, self._tell(watch, info, statistic, verdict, evidence)

    def responses(self, state: Watch, sample: Sample) -> tuple[Array, Array]:
        """The white innovations (y,) of the filter that decides alarms, and their response (y, p, onsets) to a jump of 1 of each
        gain at each onset, before `correct` of this sample. `state.onsets`: the rows of the onsets; `state.seconds`: 0 for none.
        """
        self = self._ready
        alarm = state.alarm is not None
        _, _, G, white = learn(self.alarm_filter if alarm else self.algorithm, state.alarm or state.track, sample)
        return white, G

    def _weigh(self, track: OnsetFilter) -> jumps.Ratios:
        return jumps.weigh(track.score, track.information, self.jump, self.scales, self.jump_together)

    def _tell(self, watch: Watch, info: Info, statistic: Array, verdict: jumps.Verdict, evidence: jumps.Ratios) -> Info:
        """The algorithm's report of the current belief, and of the jumps that it may not have shown yet."""
        now, alarm = self.algorithm.tell(watch.track.belief), statistic > 0
        log_odds = verdict.log_sum - jnp.log(self.seconds_between_changes)
        unseen = jnp.where(alarm | jnp.isnan(log_odds), 0.0, jax.nn.sigmoid(log_odds))
        found = {
            "statistic": statistic, "alarm": alarm, "onset": watch.onset, "onset_sigma": watch.onset_sigma,
            "jump": watch.jump, "jumped": watch.jumped,
        }  # fmt: skip
        return replace(
            info, mean=now.mean, covariance=now.covariance, gain=now.gain, gain_covariance=now.gain_covariance,
            gain_quantiles=self._quantiles(watch, now, unseen, verdict, evidence), jump_probability=unseen,
            extra={**now.extra, **found},
        )  # fmt: skip

    def _quantiles(
        self, watch: Watch, now: Info, unseen: Array, verdict: jumps.Verdict, evidence: jumps.Ratios
    ) -> Array:
        """The quantiles of the gains with the jumps that have not raised an alarm; NaN for an undetermined gain."""
        p = self.jump.shape[0]
        jump = jumps.grouped(jumps.components(watch.track.response[-p:], evidence), verdict.probability, self.grid)
        weight = jnp.concatenate([1 - unseen[None], unseen * jump.weight])
        mean = jnp.concatenate([jnp.zeros((p, 1)), jump.shift], axis=1)
        variance = jnp.concatenate([jnp.zeros((p, 1)), jump.variance], axis=1) + diagonal(now.gain_covariance)[:, None]
        found = self.algorithm.skewed(now.gain[:, None] + mixture_quantiles.quantiles(mean, variance, weight))
        unknown = jnp.sum(watch.track.belief.diffuse[-p:] ** 2, axis=1) > 0
        return jnp.where(unknown[:, None], jnp.nan, found)

    def restarted(self, state: Watch, fresh: Callable[[Tree], Tree]) -> Watch:
        """Where the record breaks: x restarts, and no earlier jump of a gain has moved it."""

        def of(track: OnsetFilter) -> OnsetFilter:
            size = track.belief.mean.shape[0] - self.algorithm.uncertain_entries
            is_state = jnp.arange(track.belief.mean.shape[0]) < size - self.jump.shape[0]
            response = jnp.where(is_state[:, None, None], 0.0, track.response)
            return replace(track, belief=fresh(track.belief), response=response)

        return replace(state, track=of(state.track), alarm=None if state.alarm is None else of(state.alarm))

    def predict(self, state: Watch, interval: Interval) -> Watch:
        """Move to the next sample, at which a gain may have jumped."""
        self = self._ready
        row = state.row + 1
        move = onset_grid.move_to(row, state.seconds, state.profile, self.grid)
        tracks = {"track": moved(self.algorithm, state.track, interval, move)}
        if state.alarm is not None:
            tracks["alarm"] = moved(self.alarm_filter, state.alarm, interval, move)
        return replace(
            state, **tracks, row=row,
            seconds=onset_grid.moved_seconds(state.seconds, jnp.asarray(interval.dt), move),
            onsets=onset_grid.moved(state.onsets, row.astype(float), move),
        )  # fmt: skip


def _restarted(watch: Watch, verdict: jumps.Verdict, evidence: jumps.Ratios, suspected: jumps.Ratios) -> Watch:
    """At an alarm: the beliefs averaged over the jumps, and a detector that starts again."""
    jump, p = jumps.moments(evidence, verdict.probability), len(watch.jump)
    at = jump.probability
    likeliest = jnp.argmax(at)
    onset = jnp.sum(jnp.where(jnp.arange(len(at)) == likeliest, watch.onsets, 0.0))
    known = jnp.where(watch.seconds > 0, watch.onsets, onset)
    alarm = None
    if watch.alarm is not None:
        alarm = averaged(watch.alarm, jumps.moments(suspected, verdict.probability))
    return replace(
        watch, track=averaged(watch.track, jump), alarm=alarm, seconds=0 * watch.seconds,
        profile=jnp.full(watch.profile.shape, -jnp.inf), onset=onset.astype(int),
        onset_sigma=jnp.sqrt(jnp.sum(at * (known - onset) ** 2)),
        jump=jnp.sum(at[None] * jump.mean, axis=1), jumped=jumps.jumped(verdict.probability, p),
    )  # fmt: skip
