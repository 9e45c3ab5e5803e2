"""Tune noise levels by the likelihood of records."""

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np

from .. import checks
from ..annotations import Array
from ..data.record import Record, several
from ..errors import AssumptionError
from ..frozen import replace
from ..models.complex_step import along_each, slope_of
from ..models.markov_disturbance import retuned
from ..models.nonlinear_model import NonlinearModel
from ..models.prior import Prior
from ..models.state_space import StateSpace
from ..progress import AFTER, bar
from ..protocols import Algorithm
from ..results import NoiseFit
from ..results.fits import not_converged
from .binding import bind, model_of
from .climb import MOST, Climbed, Limits, climb
from .following import along_record, channels_of
from .gaps import Given
from .named_numbers import Setup, with_innermost
from .noise_parameters import DisturbancePart, Free, Part, parts
from .slopes import Ascent, Rows, ascent_over

Found: TypeAlias = "list[Part | DisturbancePart]"
DISTINCT = 1e-10  # least eigenvalue of the scaled information of entries that the records distinguish
FALLEN = -12.0  # logarithm of a standard deviation relative to its start: e^-24 of the variance counts as zero
LARGEST = 25.0  # the same, at most
SMALL = -4.0  # below this, a variance of zero is tried
NO_WORSE = 1e-3  # of the log-likelihood
STRIDE = 1.0  # of such a logarithm in one step of the search: 2 of that of a variance


def fit_noise(
    algorithm: Algorithm[Any],
    record: Record | Sequence[Record],
    *,
    prior: Prior,
    free: Free = ("Q", "R"),
    progress: bool = True,
    gaps: Given = "auto",
) -> NoiseFit:
    """Find the noise covariances that maximise the likelihood of a record, or of several, with their standard errors.

    - `algorithm`: any filter of a model with Q and R, such as `Kalman`, `UnknownGain` or `ExtendedKalman`. Its covariances are
      the start of the search; those that are not free are fixed.
    - `record`: one record, or a list. `prior` is as in `estimate`.
    - `free`: the free covariances: names from "Q", "R", "walk" (of gains or parameters) and "disturbance" (the densities and time
      constants of `markov_disturbance`, each by itself), or a mapping from these names to
      what is free in the matrix. "diagonal": each variance by itself, with fixed correlations (the default for a diagonal
      matrix); "full": every entry (the default otherwise); "scale": one factor of the whole matrix; a list of bools, one for
      each variance; or a symmetric array of bools, one for each entry, which must form blocks. A covariance that varies in
      time is multiplied by one factor ("scale"), or by one for each variance (the default). "S", the cross noise, can be free
      together with both Q and R; the record determines it only where few noises drive many states.
    - `gaps`: what to do where the input was not recorded, as in `estimate`. The spread after a break is that of `algorithm`.
    - `progress`: whether a bar appears on stderr after a second of work, if stderr is a terminal.

    The search uses the logarithms of variances and the Cholesky factors of full matrices, so that every trial is positive
    semidefinite. Q of a continuous model remains a density. The covariance of the found numbers is the inverse of Fisher's
    information of the innovations.

    Returns a `NoiseFit`. Raises `InputError` with every fault of the call. Raises `AssumptionError` where the records do not
    distinguish the free entries; the message names the direction and the eigenvalue of the information.

    Cost: some ten passes, each that of `score` for as many numbers: 15 ms for 6 variances of n = 4, p = 2 and 1,200 rows.

    >>> model = StateSpace([[0.9]], Q=[[1.0]], R=[[1.0]], dt=1)
    >>> drawn = simulate(StateSpace([[0.9]], Q=[[0.2]], R=[[0.5]], dt=1), seed=1, steps=500)
    >>> fit = fit_noise(Kalman(model), drawn.record, prior=Prior([0.0], [[1.0]]))
    >>> fit.names, bool(np.all(abs(fit.parameters - [0.2, 0.5]) < 3 * fit.sigma))
    (('Q[x1]', 'R[y1]'), True)
    """
    algorithm = _read(algorithm, progress)
    found, each, runs = _prepare(algorithm, record, prior, free, gaps)

    def build(along: Algorithm[Any]) -> Callable[[np.ndarray], Setup]:
        return lambda θ: Setup(tuned(along, found, θ), prior)

    def at(θ: np.ndarray) -> Ascent:
        return ascent_over([build(along) for along in each], θ, runs)

    begin = np.concatenate([part.begin() for part in found])
    with bar("steps, at most", MOST, shown=progress, after=AFTER) as advance:
        climbed = climb(at, begin, _limits(found), advance)
    if not np.isfinite(climbed.end.log_likelihood):
        raise AssumptionError("the likelihood is not finite at the start: the model may be unstable and unobserved.")
    climbed, at_zero = _fallen(at, found, climbed)
    return _assembled(algorithm, found, climbed, at_zero)


def _read(given: object, progress: bool) -> Algorithm[Any]:
    faults = checks.Faults()
    faults.flag("progress", progress)
    faults.finish()
    algorithm: Any = given
    model = algorithm.innermost.model if isinstance(given, Algorithm) else None
    noises = isinstance(model, StateSpace | NonlinearModel) and model.R is not None
    if not (noises and algorithm.has_innovation_covariance):
        checks.refuse(
            f"fit_noise needs an algorithm of a model with noises, such as Kalman(model). Got {checks.short(algorithm)}."
        )
    return algorithm


def _prepare(
    algorithm: Algorithm[Any], record: Record | Sequence[Record], prior: Prior, free: Free, gaps: Given
) -> tuple[Found, list[Algorithm[Any]], list[Rows]]:
    """The free covariances, and for each record the algorithm along it and the rows."""
    faults = checks.Faults()
    found = parts(algorithm, free, faults)
    records = several("record", record, faults)
    faults.finish()
    each = [along_record(algorithm, one) for one in records]
    if channels_of(algorithm):
        for name in set(model_of(each[0]).varying) & set(free):
            faults.add(f"`{name}` must be a single matrix to be fitted: it follows a channel of the record.")
    faults.finish()
    return found, each, [Rows.of(bind(along, one, prior, gaps=gaps)) for along, one in zip(each, records, strict=True)]


def tuned(algorithm: Algorithm[Any], found: Found, θ: np.ndarray) -> Any:
    """The algorithm with the covariances of θ, which may be complex."""
    given: dict[str, Array] = {}
    for part, at in _slices(found):
        given |= part.covariances(θ[at])
    walk = {"walk": given.pop("walk")} if "walk" in given else {}
    disturbance: Any = given.pop("disturbance", None)
    inner: Any = algorithm.innermost
    model = replace(inner.model, **{name: _within(M, getattr(inner.model, name)) for name, M in given.items()})
    model = model if disturbance is None else retuned(model, *disturbance)
    return with_innermost(algorithm, replace(inner, model=model, **walk))


def _within(M: Array, whole: Array | None) -> Any:
    """The covariance of a model with M as its first rows (and columns), where disturbances have further ones."""
    if whole is None or whole.shape == M.shape:
        return M
    larger = np.array(whole, np.result_type(whole, M))
    larger[tuple(slice(size) for size in M.shape)] = M
    return larger


def _slices(found: Found) -> list[tuple[Part | DisturbancePart, slice]]:
    ends = np.cumsum([part.size for part in found])
    return [(part, slice(int(end) - part.size, int(end))) for part, end in zip(found, ends, strict=True)]


def _limits(found: Found) -> Limits:
    """Logarithms are bounded and move by a limited stride; other entries of a Cholesky factor are free."""
    logarithm = np.concatenate([part.logarithms for part in found])
    far = np.where(logarithm, LARGEST, np.inf)
    return Limits(np.where(logarithm, FALLEN, -np.inf), far, np.where(logarithm, STRIDE, np.inf))


def _fallen(at: Any, found: Found, climbed: Climbed) -> tuple[Climbed, np.ndarray]:
    """Variances that the likelihood drives to zero are set to it, where that does not lower it."""
    small = np.concatenate([part.may_vanish for part in found]) & (climbed.θ < SMALL)
    for i in np.flatnonzero(small):
        there = climbed.θ.copy()
        there[i] = FALLEN
        end = at(there)
        small[i] = end.log_likelihood >= climbed.end.log_likelihood - NO_WORSE
        climbed = climbed._replace(θ=there, end=end) if small[i] else climbed
    return climbed, small


def _assembled(algorithm: Algorithm[Any], found: Found, climbed: Climbed, at_zero: np.ndarray) -> NoiseFit:
    names = tuple(name for part in found for name in part.names)
    unknown = np.concatenate([part.undetermined(at_zero[at]) for part, at in _slices(found)])
    free = np.flatnonzero(~unknown)
    information = climbed.end.information[np.ix_(free, free)]
    _check_distinct(information, names, free, "" if climbed.converged else not_converged(climbed.steps))
    covariance = np.zeros((len(names), len(names)))
    covariance[np.ix_(free, free)] = np.linalg.inv(information)
    θ = np.where(at_zero, -np.inf, climbed.θ)
    slope = slope_of(along_each(lambda z: entries(found, z), θ)).T
    covariance = slope @ covariance @ slope.T
    covariance[unknown & ~at_zero] = covariance[:, unknown & ~at_zero] = np.nan
    zeros = tuple(name for name, zero in zip(names, at_zero, strict=True) if zero)
    return NoiseFit(
        tuned(algorithm, found, θ), entries(found, θ), covariance, climbed.end.log_likelihood, names, zeros,
        climbed.steps, climbed.converged,
    )  # fmt: skip


def entries(found: Found, θ: np.ndarray) -> np.ndarray:
    """The named entries of the covariances at θ."""
    return np.concatenate([part.entries(θ[at]) for part, at in _slices(found)])


def _check_distinct(information: np.ndarray, names: tuple[str, ...], free: np.ndarray, missed: str) -> None:
    """Raise an error where a direction of the free entries has no effect on the likelihood; `missed`: no maximum was reached."""
    if not len(free):
        return
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    flat = np.diag(information) <= DISTINCT
    values, vectors = np.linalg.eigh(information / np.outer(np.where(flat, 1.0, scale), np.where(flat, 1.0, scale)))
    if values[0] > DISTINCT:
        return
    if missed:
        raise AssumptionError(missed)
    v = vectors[:, 0] / np.where(flat, 1.0, scale)
    v = v / np.linalg.norm(v) * np.sign(v[np.argmax(np.abs(v))])
    words = " ".join(f"{x:+.2f} log {names[i]}" for x, i in zip(v, free, strict=True) if abs(x) > 0.01).lstrip("+")
    raise AssumptionError(
        f"the records do not distinguish the free entries: along {words} the likelihood does not change (smallest "
        f"eigenvalue of the scaled information {values[0]:.2g}, {DISTINCT:.0e} needed). Fix one of them, or "
        'fit one factor of a matrix ("scale").'
    )
