"""The smallest loss of a gain that a record would have shown."""

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .. import checks, forks
from ..annotations import Array
from ..data.record import Record
from ..engines import choice
from ..filters.change_detection import ChangeDetection, Watch
from ..frozen import frozen, replace
from ..kernels import jumps
from ..models.prior import Prior
from ..results import DetectableLoss, Info, Interval, Sample
from .binding import bind

DRAWS = 200
LOSSES = np.geomspace(0.005, 2.0, 19)  # in units of the gain
JUDGED = 80  # rows at which an alarm is looked for, at most
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
    seed: int = 0,
) -> DetectableLoss:
    """Find how small a loss of a gain this record would have shown: the answer to "no change is detected".

    - `algorithm`: a `ChangeDetection`. `record`, `prior`: as in `estimate`. The outputs of the record are not used, except for
      which of them were seen.
    - `start` and `end`, in seconds: the loss begins at `start` (default: after a third of the record) and must raise an alarm
      before `end` (default: the end).
    - `power`: the probabilities of an alarm, for which the loss is found.
    - `seed`: of the drawn noise.

    The responses of the innovations to a jump at each onset follow from the inputs alone. White innovations are drawn, a jump
    adds its response, and the detector's own sum of likelihood ratios decides. In a closed loop a true loss also moves the
    input, which the record cannot show: the result is then too careful, mostly. (Measured against flights: errors up to .14 of
    the power.) The onset is that of the detector's grid which is nearest to `start`.

    Returns a `DetectableLoss`. Raises `InputError` with every fault of the call.

    Cost: a pass of the detector, and some 200 draws of its sums: half a second for 1,700 rows.

    Reference: A. S. Willsky, H. L. Jones, IEEE Trans. Automatic Control 21 (1976) 108-112, for the responses.

    >>> model = StateSpace([[0.5]], [[1.0]], Q=[[0.01]], R=[[0.01]], dt=1)
    >>> u = np.sign(np.sin(np.arange(200.0)))
    >>> watched = ChangeDetection(UnknownGain(model, Prior([1.0], [[0.01]])))
    >>> record, prior = simulate(model, u, seed=1).record, Prior([0.0], [[1.0]])
    >>> found = detectable_loss(watched, record, prior=prior)
    >>> bool(0.05 < found.loss[0, 1] < 0.4)
    True
    """
    first, last, levels = _read(algorithm, record, start, end, power)
    bound = bind(replace(algorithm, seconds_between_false_alarms=np.asarray(np.inf)), record, prior)
    _, run = choice.scan(
        "auto", Responding(bound.algorithm), prior, bound.samples, bound.intervals, keep="all", select=_responses
    )
    rows = _Responses(*(np.asarray(part) for part in run.info))
    t = np.arange(len(record), dtype=float) if record.t is None else np.asarray(record.t)
    return _found(algorithm, rows, t, first, last, levels, seed)


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


def _read(
    algorithm: ChangeDetection, record: Record, start: float | None, end: float | None, power: Sequence[float]
) -> tuple[int, int, np.ndarray]:
    """The rows between which the loss must show, and the powers."""
    faults = checks.Faults()
    faults.instance("algorithm", algorithm, ChangeDetection)
    faults.instance("record", record, Record)
    levels = faults.array("power", list(power) if isinstance(power, tuple) else power, "powers")
    if levels is not None and (levels.size == 0 or np.any((levels <= 0) | (levels >= 1))):
        faults.add(f"`power` must be probabilities between 0 and 1. Got {checks.short(power)}.")
    for name, value in (("start", start), ("end", end)):
        if value is not None:
            faults.number(name, value, unit="seconds")
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
    return int(np.searchsorted(t, begin)), int(np.searchsorted(t, stop, side="right")) - 1, levels


def _found(
    algorithm: ChangeDetection, rows: _Responses, t: np.ndarray, first: int, last: int, levels: np.ndarray, seed: int
) -> DetectableLoss:
    watched = rows.onsets[last][rows.seconds[last] > 0]
    watched = watched[watched >= 1]
    p, gains = rows.G.shape[2], algorithm.names.gains
    if not len(watched):
        none = np.full((p, len(levels)), np.inf)
        until = np.full(p, float(t[first]))
        return DetectableLoss(
            float(t[first]), float(t[last]), tuple(map(float, levels)), none, none[:, 0], until, none, gains
        )
    onset = float(watched[np.argmin(np.abs(watched - first))])
    response = rows.of(onset)
    response[last + 1 :] = 0.0
    threshold = float(np.log(algorithm.seconds_between_false_alarms))
    crossed = _alarms(algorithm, rows, response, int(onset), last, threshold, seed)
    dt = t[np.minimum(crossed, len(t) - 1)] - t[int(onset)]
    seen = crossed <= last
    loss, delay = np.full((p, len(levels)), np.inf), np.full((p, len(levels)), np.inf)
    for g in range(p):
        share = np.maximum.accumulate(seen[g].mean(axis=0))
        for i, level in enumerate(levels):
            if share[-1] >= level:
                loss[g, i] = np.exp(np.interp(level, share, np.log(LOSSES)))
                near = int(np.argmin(np.abs(np.log(LOSSES / loss[g, i]))))
                delay[g, i] = np.median(dt[g, seen[g, :, near], near]) if seen[g, :, near].any() else np.inf
    J = np.einsum("typ,tyq->pq", response, response)
    floor = np.array([J[g, g] ** -0.5 if J[g, g] > 0 else np.inf for g in range(p)])
    learnt = np.cumsum(np.einsum("tyg->tg", response**2), axis=0)
    until = t[np.argmax(learnt >= (1 - ADDED) * learnt[-1], axis=0)]
    until = np.where(learnt[-1] > 0, until, t[int(onset)])
    return DetectableLoss(
        float(t[int(onset)]), float(t[last]), tuple(map(float, levels)), loss, floor, until, delay, gains
    )


def _alarms(
    algorithm: ChangeDetection,
    rows: _Responses,
    response: np.ndarray,
    onset: int,
    last: int,
    threshold: float,
    seed: int,
) -> np.ndarray:
    """The first judged row with an alarm: (p, draws, losses); T where there is none."""
    T, y, p, r = rows.G.shape
    rng = np.random.default_rng(seed)
    every = max((last - onset) // JUDGED, 1)
    score, from_jump, information = np.zeros((DRAWS, p, r)), np.zeros((p, p, r)), np.zeros((p, p, r))
    first = np.full((p, DRAWS, len(LOSSES)), T)
    begin = max(int(rows.onsets[last][rows.seconds[last] > 0].min(initial=onset)), 1) if last > 0 else 1
    judge = forks.jit(partial(_log_sums, algorithm))
    for k in range(min(begin, onset), last + 1):
        place, there = rows.before(k) if k else (np.arange(r), np.zeros(r, bool))
        G = rows.G[k]
        score = np.where(there, score[..., place], 0.0) + np.einsum("ypr,dy->dpr", G, rng.normal(size=(DRAWS, y)))
        information = np.where(there, information[..., place], 0.0) + np.einsum("ypr,yqr->pqr", G, G)
        from_jump = np.where(there, from_jump[..., place], 0.0) + np.einsum("yg,ypr->gpr", response[k], G)
        if k >= onset and ((k - onset) % every == 0 or k == last):
            sums = np.asarray(judge(score, from_jump, information, rows.seconds[k]))
            first = np.where((sums > threshold) & (first == T), k, first)
    return first


def _log_sums(algorithm: ChangeDetection, score: Array, from_jump: Array, information: Array, seconds: Array) -> Array:
    """The log of the detector's sum for each gain that jumps, draw and loss: (p, draws, losses)."""

    def one(score: Array) -> Array:
        evidence = jumps.weigh(score, information, algorithm.jump, algorithm.scales, algorithm.jump_together)
        return jumps.judge(evidence, seconds).log_sum

    def of_draw(score: Array, moved: Array) -> Array:
        return jax.vmap(lambda loss: one(score - loss * moved))(jnp.asarray(LOSSES))

    found = jax.vmap(lambda moved: jax.vmap(lambda one: of_draw(one, moved))(score))(from_jump)
    return jnp.nan_to_num(found, nan=-jnp.inf)
