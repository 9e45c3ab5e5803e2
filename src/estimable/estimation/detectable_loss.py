"""The smallest loss of a gain that a record would have shown."""

import itertools
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .. import checks
from ..annotations import Array
from ..data.record import Record
from ..engines import choice
from ..filters.change_detection import ChangeDetection, Watch
from ..frozen import frozen, replace, static
from ..kernels import jumps
from ..models.prior import Prior
from ..results import DetectableLoss, Info, Interval, Sample
from .binding import bind
from .stateless import Stateless

DRAWS = 200
LOSSES = np.geomspace(0.005, 2.0, 19)  # in units of the gain
JUDGED = 80  # rows at which an alarm is looked for, at most
TOGETHER = 100  # looks that are computed side by side
FEWEST = 4  # of them in each of several intervals
MOST = 200  # intervals
ADDED = 0.01  # of the information: what comes later adds less
BEGIN = 1 / 3  # of the record, where the loss begins if it is not said


def detectable_loss(
    algorithm: ChangeDetection,
    record: Record,
    *,
    prior: Prior,
    start: float | None = None,
    end: float | None = None,
    power: Sequence[float] = (0.5, 0.9),
    every: float | None = None,
    seed: int = 0,
) -> DetectableLoss:
    """Find how small a loss of a gain this record would have shown: the answer to "no change is detected".

    - `algorithm`: a `ChangeDetection`. `record`, `prior`: as in `estimate`. The outputs of the record are not used, except for
      which of them were seen.
    - `start` and `end`, in seconds: the loss begins at `start` (default: after a third of the record) and must raise an alarm
      before `end` (default: the end).
    - `power`: the probabilities of an alarm, for which the loss is found.
    - `every`, in seconds: also find, for each interval of this length, the loss that begins with it and raises an alarm before it
      ends (`intervals` of the result, default None: none). They show when the input is informative.
    - `seed`: of the drawn noise.

    The responses of the innovations to a jump at each onset follow from the inputs alone. White innovations are drawn, a jump
    adds its response, and the detector's own sum of likelihood ratios decides. In a closed loop a true loss also moves the
    input, which the record cannot show: the result is then too careful, mostly. (Measured against flights: errors up to .14 of
    the power.) The onset is that of the detector's grid which is nearest to `start`.

    Returns a `DetectableLoss`. Raises `InputError` with every fault of the call.

    Cost: a pass of the detector, and some 200 draws of its sums: half a second for 1,700 rows, twice that with intervals.

    Reference: A. S. Willsky, H. L. Jones, IEEE Trans. Automatic Control 21 (1976) 108-112, for the responses.

    >>> model = StateSpace([[0.5]], [[1.0]], Q=[[0.01]], R=[[0.01]], dt=1)
    >>> u = np.sign(np.sin(np.arange(200.0)))
    >>> watched = ChangeDetection(UnknownGain(model, Prior([1.0], [[0.01]])))
    >>> record, prior = simulate(model, u, seed=1).record, Prior([0.0], [[1.0]])
    >>> found = detectable_loss(watched, record, prior=prior)
    >>> bool(0.05 < found.loss[0, 1] < 0.4)
    True
    """
    t, levels, spans = _read(algorithm, record, start, end, power, every)
    bound = bind(replace(algorithm, seconds_between_false_alarms=np.asarray(np.inf)), record, prior)
    _, run = choice.scan(
        "auto", Responding(bound.algorithm), prior, bound.samples, bound.intervals, keep="all", select=_responses
    )
    rows = _Responses(*(np.asarray(part) for part in run.info))
    losses = [_Jump.between(rows, *span) for span in spans]
    whole, *intervals = _found(algorithm, rows, losses, t, levels, seed)
    return whole._replace(intervals=tuple(intervals))


@frozen
class Responding:
    """A detector that reports the responses of its innovations to every possible jump."""

    detector: Any

    def at(self, k: int | Array) -> "Responding":
        """The same at row k."""
        return Responding(self.detector.at(k))

    def init(self, prior: Prior) -> Watch:
        """The belief before y[0]."""
        return self.detector.init(prior)

    def correct(self, state: Watch, sample: Sample) -> tuple[Watch, Info]:
        """The state after a sample, and the responses."""
        _, G = self.detector.responses(state, sample)
        after, info = self.detector.correct(state, sample)
        found = {"G": G, "onsets": state.onsets, "seconds": state.seconds}
        return after, Info(log_likelihood=0.0 * info.log_likelihood, outcome=0 * info.outcome, extra=found)

    def predict(self, state: Watch, interval: Interval) -> Watch:
        """The state at the next row."""
        return self.detector.predict(state, interval)


def _responses(info: Info, keep: str) -> tuple[Array, Array, Array]:
    return info.extra["G"], info.extra["onsets"], info.extra["seconds"]


class _Responses(NamedTuple):
    """Row by row: the responses G (T, y, p, r) of white innovations, the onsets (T, r) and their seconds, 0 for none."""

    G: np.ndarray
    onsets: np.ndarray
    seconds: np.ndarray

    def before(self, k: int) -> tuple[np.ndarray, np.ndarray]:
        """The place at row k - 1 of each onset of row k, and whether it was there."""
        ids, earlier = self.onsets[k], np.where(self.seconds[k - 1] > 0, self.onsets[k - 1], -1)
        order = np.argsort(earlier, kind="stable")
        place = order[np.minimum(np.searchsorted(earlier[order], ids), len(order) - 1)]
        return place, (earlier[place] == ids) & (self.seconds[k] > 0)

    def of(self, onset: float) -> np.ndarray:
        """The responses to a jump at one onset: (T, y, p), zero before it."""
        here = (self.onsets == onset) & (self.seconds > 0)
        G = np.take_along_axis(self.G, np.argmax(here, axis=1)[:, None, None, None], axis=-1)[..., 0]
        return np.where(here.any(axis=1)[:, None, None], G, 0.0)


class _Jump(NamedTuple):
    """A loss at the row `onset` that must show by the row `last`, and the response (T, y, p) of the innovations to it."""

    onset: int
    last: int
    response: np.ndarray

    @staticmethod
    def between(rows: _Responses, first: int, last: int) -> "_Jump":
        """The loss at the onset of the detector's grid which is nearest to a row."""
        watched = rows.onsets[last][rows.seconds[last] > 0]
        watched = watched[watched >= 1]
        onset = float(watched[np.argmin(np.abs(watched - first))]) if len(watched) else float(first)
        response = rows.of(onset)
        response[last + 1 :] = 0.0
        return _Jump(int(onset), last, response)


def _read(
    algorithm: ChangeDetection, record: Record, start: float | None, end: float | None,
    power: Sequence[float], every: float | None,
) -> tuple[np.ndarray, np.ndarray, list[tuple[int, int]]]:  # fmt: skip
    """Times, powers, and the first and last row between which the loss must show, then those of each interval."""
    faults = checks.Faults()
    faults.instance("algorithm", algorithm, ChangeDetection)
    faults.instance("record", record, Record)
    levels = faults.array("power", list(power) if isinstance(power, tuple) else power, "powers")
    if levels is not None and (levels.size == 0 or np.any((levels <= 0) | (levels >= 1))):
        faults.add(f"`power` must be probabilities between 0 and 1. Got {checks.short(power)}.")
    for name, value in (("start", start), ("end", end)):
        if value is not None:
            faults.number(name, value, unit="seconds")
    if every is not None:
        every = faults.number("every", every, above=0.0, unit="seconds")
    faults.finish()
    assert levels is not None
    t = np.arange(len(record), dtype=float) if record.t is None else np.asarray(record.t)
    begin = t[0] + BEGIN * (t[-1] - t[0]) if start is None else start
    stop = t[-1] if end is None else end
    if not t[0] <= begin < stop <= t[-1] + 1e-9 * abs(t[-1]):
        checks.refuse(
            f"`start` and `end` must be times of the record, {t[0]:g} to {t[-1]:g} s, the first before the second. "
            f"Got {begin:g} and {stop:g}."
        )
    whole = int(np.searchsorted(t, begin)), int(np.searchsorted(t, stop, side="right")) - 1
    return t, levels, [whole, *([] if every is None else _intervals(t, every))]


def _intervals(t: np.ndarray, every: float) -> list[tuple[int, int]]:
    """The first and last row of each interval of a record; a shorter rest at its end belongs to none."""
    step, seconds = float(np.median(np.diff(t))), float(t[-1] - t[0])
    if every < 2 * step or seconds > MOST * every:
        checks.refuse(
            f"`every` must be at least two steps of the record ({2 * step:.3g} s), and long enough for at most {MOST} intervals "
            f"({seconds / MOST:.3g} s). Got {every:g}."
        )
    edges = t[0] + every * np.arange(int(seconds / every + 1e-9) + 1)
    ends = np.searchsorted(t, edges - 1e-9 * every)
    return [(int(first), int(last)) for first, last in itertools.pairwise(ends) if last > first]


def _found(
    algorithm: ChangeDetection, rows: _Responses, losses: list[_Jump], t: np.ndarray, levels: np.ndarray, seed: int
) -> list[DetectableLoss]:
    """The smallest loss for each onset."""
    gains, found = algorithm.names.gains, []
    for jump, crossed in zip(losses, _alarms(algorithm, rows, losses, seed), strict=True):
        start = float(t[jump.onset])
        loss, delay = _smallest(np.append(t - start, np.inf)[crossed], crossed <= jump.last, levels)
        learnt = np.cumsum(np.sum(jump.response**2, axis=1), axis=0)
        with np.errstate(divide="ignore"):
            floor = learnt[-1] ** -0.5
        until = np.where(learnt[-1] > 0, t[np.argmax(learnt >= (1 - ADDED) * learnt[-1], axis=0)], start)
        powers = tuple(map(float, levels))
        found.append(DetectableLoss(start, float(t[jump.last]), powers, loss, floor, until, delay, gains))
    return found


def _smallest(after: np.ndarray, seen: np.ndarray, levels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The loss of each gain that is seen with each probability, and the median time to its alarm: (p, levels), from the times
    `after` the onset of the alarms of each draw and loss, and whether they were `seen` in time."""
    loss, delay = np.full((2, len(seen), len(levels)), np.inf)
    for g in range(len(seen)):
        share = np.maximum.accumulate(seen[g].mean(axis=0))
        for i in np.flatnonzero(share[-1] >= levels):
            loss[g, i] = np.exp(np.interp(levels[i], share, np.log(LOSSES)))
            near = int(np.argmin(np.abs(np.log(LOSSES / loss[g, i]))))
            alarms = after[g, seen[g, :, near], near]
            delay[g, i] = np.median(alarms) if alarms.size else np.inf
    return loss, delay


def _alarms(algorithm: ChangeDetection, rows: _Responses, losses: list[_Jump], seed: int) -> list[np.ndarray]:
    """The first judged row with an alarm, for each onset: (p, draws, losses); T where there is none."""
    T, y, p, r = rows.G.shape
    looks = [JUDGED, *[max(JUDGED // len(losses), FEWEST)] * (len(losses) - 1)]
    score, information, from_jump = np.zeros((DRAWS, p, r)), np.zeros((p, p, r)), [np.zeros((p, p, r))] * len(losses)
    first, waiting = [np.full((p, DRAWS, len(LOSSES)), T) for _ in losses], list[_Look]()
    for k in range(_begin(rows, losses), max(jump.last for jump in losses) + 1):
        place, there = rows.before(k)
        G, noise = rows.G[k], np.random.default_rng([seed, k]).normal(size=(DRAWS, y))
        score = np.where(there, score[..., place], 0.0) + np.einsum("ypr,dy->dpr", G, noise)
        information = np.where(there, information[..., place], 0.0) + np.einsum("ypr,yqr->pqr", G, G)
        for i, jump in enumerate(losses):
            if not jump.onset <= k <= jump.last:
                continue
            moved = np.einsum("yg,ypr->gpr", jump.response[k], G)
            from_jump[i] = np.where(there, from_jump[i][..., place], 0.0) + moved
            if (k - jump.onset) % max((jump.last - jump.onset) // looks[i], 1) == 0 or k == jump.last:
                waiting.append(_Look(i, k, score, from_jump[i], information, rows.seconds[k]))
        if len(waiting) >= TOGETHER:
            _look(algorithm, waiting, first)
            waiting = []
    _look(algorithm, waiting, first)
    return first


class _Look(NamedTuple):
    """A look at the detector's sums: the loss, the row, and what the sums are made of there."""

    loss: int
    row: int
    score: np.ndarray
    from_jump: np.ndarray
    information: np.ndarray
    seconds: np.ndarray


def _look(algorithm: ChangeDetection, looks: list[_Look], first: list[np.ndarray]) -> None:
    """Write the rows of the alarms that these looks, in the order of their rows, find first."""
    if not looks:
        return
    crossed = _log_sums(algorithm, *map(np.stack, list(zip(*looks, strict=True))[2:])) > np.log(
        algorithm.seconds_between_false_alarms
    )
    for look, alarms in zip(looks, crossed, strict=True):
        found = first[look.loss]
        found[...] = np.where(alarms.swapaxes(0, 1), np.minimum(found, look.row), found)


def _begin(rows: _Responses, losses: list[_Jump]) -> int:
    """The oldest onset that the detector watches when the first loss begins; it cannot be row 0."""
    onset = min(jump.onset for jump in losses)
    return max(int(rows.onsets[onset][rows.seconds[onset] > 0].min(initial=onset)), 1)


def _log_sums(
    algorithm: ChangeDetection, score: np.ndarray, from_jump: np.ndarray, information: np.ndarray, seconds: np.ndarray
) -> np.ndarray:
    """The log of the detector's sum for each judged row, draw, gain that jumps, and loss: (rows, draws, p, losses)."""
    jump, scales = (np.broadcast_to(one, (len(score), len(one))) for one in (algorithm.jump, algorithm.scales))
    judging = Judging(jump, scales, from_jump, information, seconds, algorithm.jump_together)
    samples = Sample(None, np.ones((*score.shape[:2], 1), bool), None, extra=score)
    _, run = choice.scan_bank(
        "auto", judging, None, samples, Interval(None, None), axes=(0, 0, None), keep="all", select=_extra
    )
    return np.nan_to_num(np.asarray(run.info), nan=-np.inf)


@frozen
class Judging(Stateless):
    """The log of a detector's sum at one row, for a jump of each gain and of each size. A sample is a draw of the scores.

    `from_jump` (g, p, r): what a jump of 1 of gain g adds to the scores. `information`, `seconds`: those of the onsets.
    """

    jump: Any
    scales: Any
    from_jump: Any
    information: Any
    seconds: Any
    together: bool = static()

    def correct(self, state: tuple[()], sample: Sample) -> tuple[tuple[()], Info]:
        """The sums of one draw, (g, losses)."""

        def of(score: Array) -> Array:
            """The log of the sum for one score (p, r)."""
            evidence = jumps.weigh(score, self.information, self.jump, self.scales, self.together)
            return jumps.judge(evidence, self.seconds).log_sum

        moved = sample.extra[None, None] - LOSSES[None, :, None, None] * self.from_jump[:, None]
        return state, Info(
            log_likelihood=jnp.zeros(()), outcome=jnp.zeros((), int), extra=jax.vmap(jax.vmap(of))(moved)
        )


def _extra(info: Info, keep: str) -> Any:
    return info.extra
