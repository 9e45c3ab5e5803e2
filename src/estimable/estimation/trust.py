"""Whether a record agrees with the model of a filter, and which errors of the model have no effect on it."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .. import checks
from ..annotations import Array, Tree
from ..data.record import Record
from ..diagnostics import changes as listed_changes
from ..diagnostics import model_tests as tests
from ..diagnostics.alarm_hints import alarm_hints
from ..diagnostics.changes import DetectedChange
from ..engines import choice
from ..engines.derivatives import Along, Sloped
from ..filters.change_detection import ChangeDetection
from ..filters.kalman_filter import Kalman
from ..filters.unknown_gain import UnknownGain
from ..frozen import frozen, replace
from ..kernels.small import diagonal, factors
from ..models.complex_step import along_each, slope_of, value_of
from ..models.prior import Prior
from ..models.sampled import sample
from ..protocols import Algorithm, Wrapper
from ..results import Direction, Estimate, Sample, Suspect, Trust, Untestable
from . import slopes
from .binding import Bound, bind
from .estimate import estimate
from .model_directions import Directions, with_further_inputs

REFUTED = 1e-6  # p-value below which a result is not to be used
HIDDEN = 0.52  # correlation with a gain from which a bias of three standard deviations escapes the score test
NOTICED = 0.01  # of the gain: a smaller shift by an error of 10 % is not listed
GAP = 0.5  # of the record: a longer one leaves nothing to judge
SMALLEST = 3.0  # standard deviations of the score of a whole limit: below it, the test of a limit says nothing
KNOWN = 0.95  # of the prior's standard deviation: a gain that keeps more is not known
UNIFORM = 3**0.5  # standard deviations of a uniform distribution in half of its width
LEVEL = 0.02


def trust(
    algorithm: Algorithm[Any],
    record: Record,
    *,
    prior: Prior,
    result: Estimate | None = None,
    level: float = LEVEL,
) -> Trust:
    """Judge whether the numbers of a filter can be believed: whether the record agrees with its model, and what no record shows.

    - `algorithm`: a filter of a `StateSpace`: `Kalman`, `UnknownGain` or a wrapper of one, such as `ChangeDetection`.
    - `record`, `prior`: as in `estimate`. `result`: its result, if it has already run.
    - `level`: the share of right models that get a warning.

    Six families of tests share that level: the size of the innovations, on both sides; their whiteness; Rao's score test of
    all errors of the model together (entries of A and B, delays of the inputs, offsets of states and sensors); the largest of
    these scores; the number of alarms of a change detector; and the largest innovations over 1 and 3 s. The tests run on the
    filter with the jumps that a change detector found, at their onsets. An offset that begins in mid-record looks like a jump of
    the gain: so the scores also test offsets of the state equations that begin with the first jump.

    The word is "believe" where the p-value is at least `level`, "check" below it, and "do not use" below 1e-6, where half of
    the record is missing, or where the record carries no information about a gain. An error that acts like the gain itself
    (the scale of B) has no effect on the innovations, and no test finds it: the verdict lists such errors with how far each
    would move the gain. Where most alarms of a detector coincide with large or fast inputs, a reason points to the actuator.

    Returns a `Trust`. Raises `InputError` with every fault of the call.

    Cost: about that of `score` with as many numbers as A and B have entries.

    Reference: C. R. Rao, Proc. Cambridge Phil. Soc. 44 (1948) 50-57; L. G. Godfrey, Misspecification Tests in Econometrics
    (1988) for the score tests.

    >>> model = StateSpace([[0.5]], [[1.0]], Q=[[0.01]], R=[[0.04]], dt=1)
    >>> u = np.sign(np.random.default_rng(0).normal(size=400))
    >>> record, prior = simulate(model, u, seed=1).record, Prior([0.0], [[1.0]])
    >>> trust(UnknownGain(model, Prior([1.0], [[0.25]])), record, prior=prior).word
    'believe'
    """
    faults = checks.Faults()
    level = faults.number("level", level, above=0.0, upper=1.0)
    faults.instance("record", record, Record)
    faults.finish()
    inner = algorithm.innermost if isinstance(algorithm, Algorithm) else algorithm
    if not isinstance(inner, Kalman | UnknownGain):
        checks.refuse(
            f"`algorithm` must be Kalman or UnknownGain, or a wrapper of one of them. Got {checks.short(algorithm)}."
        )
    result = estimate(algorithm, record, prior=prior) if result is None else result
    found = listed_changes(result) if "alarm" in result.extra else ()
    bound = bind(inner, record, prior)
    judged = _Judged.of(inner, algorithm, _as_run(found, bound), bound, prior)
    verdict = _verdict(judged, algorithm, found, bound, level)
    hints = alarm_hints(found, record) if verdict.word != "believe" else ()
    return verdict._replace(reasons=(*verdict.reasons, *hints))


@frozen
class KnownJumps:
    """`UnknownGain` whose gains jump at known rows: the factor of their walk, (T, p, p), of each row."""

    algorithm: Any
    walk_factors: Any

    def at(self, k: int | Array) -> Any:
        """The filter at row k."""
        factor = jax.lax.dynamic_index_in_dim(self.walk_factors, k, keepdims=False)
        return replace(self.algorithm.at(k), walk_factor=factor)

    def init(self, prior: Prior) -> Any:
        """The belief before y[0]."""
        return self.algorithm.init(prior)


class _Judged(NamedTuple):
    """Innovations (T, p), score and information of the directions, and the gains at the end with their slopes (d, g)."""

    ε: np.ndarray
    directions: tuple[Direction, ...]
    score: np.ndarray
    information: np.ndarray
    gain: np.ndarray
    gain_sigma: np.ndarray
    gain_slope: np.ndarray

    @staticmethod
    def of(
        inner: Kalman | UnknownGain, algorithm: Algorithm[Any], found: tuple[DetectedChange, ...], bound: Bound, prior: Prior
    ) -> "_Judged":  # fmt: skip
        """One pass over the record."""
        jumping, plain, base = _walks(inner, algorithm, found, bound), inner.model, inner.sampled(bound.clock)
        in_blocks = inner.in_blocks() if isinstance(inner, UnknownGain) else plain
        directions = Directions.of(plain, in_blocks, _when(found[0]) if found else None)
        begin = found[0].onset if found else None
        samples, intervals = with_further_inputs(bound.samples, bound.intervals, bound.clock.hold, begin)

        def build(θ: np.ndarray) -> tuple[Any, Prior]:
            ready = replace(base, ready=sample(directions.moved(θ), bound.clock))
            return ready if jumping is None else KnownJumps(ready, jumping), prior

        moved, priors = along_each(build, np.zeros(len(directions.found)))
        along, pair = Along(value_of(moved), slope_of(moved)), (value_of(priors), slope_of(priors))
        rows = _Collected(len(directions.found))
        choice.scan_in_blocks(
            "auto", along, pair, samples, intervals, axes=(0, None, 0), keep="all", select=_row, use=rows.add
        )
        gain, variance, slope = rows.last
        kept = _can_be_seen(directions.found, rows.information)
        return _Judged(
            tests.whitened(np.concatenate(rows.e), np.concatenate(rows.S)), tuple(directions.found[i] for i in kept),
            rows.score[kept], rows.information[np.ix_(kept, kept)], gain[0], np.sqrt(variance[0]), slope[kept],
        )  # fmt: skip


def _can_be_seen(directions: tuple[Direction, ...], information: np.ndarray) -> np.ndarray:
    """The directions that are tested: a limit takes at most the whole of what is beyond it. Under a square wave it acts like a
    loss of the gain, so that little information about it is left, and the least misfit of a jump would pass for a limit.
    """
    left = np.diag(information)
    return np.array([i for i, one in enumerate(directions) if one.kind != "limit" or left[i] >= SMALLEST**2], int)


def _as_run(found: tuple[DetectedChange, ...], bound: Bound) -> tuple[DetectedChange, ...]:
    """The changes with the rows that are run, from those of the record: rows inside gaps are not run."""
    if bound.gapped is None:
        return found
    rows = bound.gapped.plan.rows
    return tuple(
        one._replace(**{name: int(np.searchsorted(rows, getattr(one, name))) for name in ("onset", "detected_at")})
        for one in found
    )


def _when(change: DetectedChange) -> str:
    return f"row {change.onset}" if change.onset_s is None else f"{change.onset_s:.4g} s"


class _Collected(slopes.Sums):
    """What the blocks of rows add up to, their innovations with their covariances, and the gains at the end."""

    def __init__(self, d: int):
        super().__init__(d)
        self.e: list[np.ndarray] = []
        self.S: list[np.ndarray] = []
        self.last: tuple[np.ndarray, ...] = ()

    def add(self, kept: tuple[np.ndarray, ...], first: int) -> None:
        """A block of rows (d, rows, ..)."""
        slope, found, e, S, *gains = kept
        super().add((slope, found), first)
        self.e.append(np.array(e[0]))
        self.S.append(np.array(S[0]))
        self.last = tuple(np.array(one[:, -1]) for one in gains)


def _row(sloped: Sloped, keep: str) -> Tree:
    """The slope of the log-likelihood, the rows of its information, the innovation, and the gains with their slopes."""
    info, none = sloped.info, jnp.zeros(0)
    gains = (none, none, none) if info.gain is None else (info.gain, diagonal(info.gain_covariance), sloped.slope.gain)
    return *slopes.row(sloped, keep), info.innovation, info.innovation_covariance, *gains


def _detector(algorithm: Algorithm[Any]) -> ChangeDetection | None:
    while isinstance(algorithm, Wrapper) and not isinstance(algorithm, ChangeDetection):
        algorithm = algorithm.algorithm
    return algorithm if isinstance(algorithm, ChangeDetection) else None


def _walks(inner: Any, algorithm: Algorithm[Any], found: tuple[DetectedChange, ...], bound: Bound) -> np.ndarray | None:
    """The factor of the walk of each row: that of the detector, and the variance of a jump at each onset, which is known to some
    rows: a jump at any of them has the covariance of a walk over them."""
    detector = _detector(algorithm)
    if detector is None:
        return None
    dt = np.asarray(bound.intervals.dt)
    walk = np.broadcast_to(detector.walk, (len(dt), *detector.walk.shape)).copy()
    for change in found:
        half = round(UNIFORM * change.onset_sigma)
        rows = slice(max(change.onset - 1 - half, 0), min(change.onset + half, change.detected_at))
        walk[rows] += np.diag(detector.jump) / dt[rows].sum()
    return np.asarray(factors(walk))


def _verdict(
    judged: _Judged, algorithm: Algorithm[Any], found: tuple[DetectedChange, ...], bound: Bound, level: float
) -> Trust:
    ε = judged.ε
    dt = np.asarray(bound.intervals.dt)
    detector, single = _detector(algorithm), tests.single_scores(judged.score, judged.information)
    families = {
        "size": tests.size(ε),
        "whiteness": tests.whiteness(ε),
        "scores": tests.joint_score(judged.score, judged.information),
        "largest score": tests.shared(tests.normal(z) for z in single),
        "alarms": 1.0
        if detector is None
        else tests.alarms(len(found), float(dt[:-1].sum()), float(detector.seconds_between_false_alarms)),
        "bursts": tests.bursts(ε, float(np.median(dt))),
    }
    p = tests.shared(families.values())
    suspects = _suspects(judged, single, level / len(families))
    reasons = _reasons(families, suspects, ε, level, len(found))
    blind = _blind(judged, algorithm, bound.samples)
    word = "do not use" if blind or p < REFUTED else "check" if p < level else "believe"
    hidden = tuple(_untestable(judged, algorithm))
    return Trust(word, p, families, suspects if word != "believe" else (), (*blind, *reasons), hidden)


def _suspects(judged: _Judged, single: np.ndarray, level: float) -> tuple[Suspect, ...]:
    """The directions with a significant score, the largest first."""
    order = np.argsort(-np.abs(single))
    d = len(single)
    return tuple(
        Suspect(
            judged.directions[i], float(judged.score[i] / judged.information[i, i]),
            float(judged.information[i, i] ** -0.5), float(single[i]),
        )
        for i in order if judged.information[i, i] > 0 and d * tests.normal(float(single[i])) < level
    )  # fmt: skip


def _reasons(
    families: dict[str, float], suspects: tuple[Suspect, ...], ε: np.ndarray, level: float, alarms: int
) -> tuple[str, ...]:
    """A sentence for each family that fails, the most useful first."""
    failed = {name for name, p in families.items() if len(families) * p < level}
    mean = np.nanmean(ε**2) if np.isfinite(ε).any() else 1.0
    size = f"the mean squared innovation is {mean:.3g} where a right model gives 1"
    found = []
    if suspects and failed & {"scores", "largest score"}:
        names = " or ".join(one.direction.of_size(one.size, one.sigma) for one in suspects[:3])
        found.append(f"the record contradicts it; {names} would explain most of that")
    elif "scores" in failed:
        found.append("the record contradicts its matrices, in no single entry")
    if "alarms" in failed:
        found.append(f"{checks.counted(alarms, 'change')} of the gain are more than jumps of a gain would explain")
    if "size" in failed:
        found.append(f"{size}: Q or R is too {'small' if mean > 1 else 'large'}")
    if "whiteness" in failed:
        found.append("the innovations depend on earlier ones: a disturbance that lasts, or a mode, is not in the model")
    if "bursts" in failed:
        found.append("the innovations are too large for a while: something happened that is not in the model")
    return tuple(found)


def _blind(judged: _Judged, algorithm: Algorithm[Any], samples: Sample) -> tuple[str, ...]:
    """Why the record carries no information about a gain, where it carries none."""
    seen, found = np.asarray(samples.seen).any(axis=1), []
    if 1 - seen.mean() > GAP:
        found.append(f"{100 * (1 - seen.mean()):.0f} % of the rows have no output")
    inner = algorithm.innermost
    if isinstance(inner, UnknownGain):
        before = np.sqrt(np.diagonal(inner.gain.covariance))
        for name, σ, σ0 in zip(inner.names.gains, judged.gain_sigma, before, strict=True):
            if σ0 > 0 and σ > KNOWN * σ0:
                found.append(
                    f"the record carries no information about {name}: its sigma is that of its prior, {σ0:.2g}"
                )
    return tuple(found)


def _untestable(judged: _Judged, algorithm: Algorithm[Any]) -> Any:
    """Errors that the gain absorbs: an error φ moves the gain by b φ, and is seen with the information I that is left.

    With s² = I + (b / σ)² the information about φ were the gain known, its correlation with the gain is b / (σ s).
    """
    inner = algorithm.innermost
    if not isinstance(inner, UnknownGain):
        return
    left = np.diag(judged.information)
    shown = []
    for g, name in enumerate(inner.names.gains):
        b, σ = judged.gain_slope[:, g], max(float(judged.gain_sigma[g]), 1e-300)
        for i, one in enumerate(judged.directions):
            if one.kind not in "AB":
                continue
            ρ, shift = b[i] / σ / np.sqrt(max(left[i] + (b[i] / σ) ** 2, 1e-300)), 0.1 * b[i]
            if abs(ρ) > HIDDEN and abs(shift) > NOTICED * max(abs(float(judged.gain[g])), NOTICED):
                shown.append(Untestable(one, name, float(ρ), float(shift)))
    yield from sorted(shown, key=lambda one: -abs(one.shift))
