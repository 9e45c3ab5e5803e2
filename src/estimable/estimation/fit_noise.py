# pyright: reportMissingTypeStubs=false, reportUnknownArgumentType=false, reportUnknownLambdaType=false
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
"""Tune noise levels by the likelihood of records."""

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np

from .. import checks
from ..annotations import Array
from ..data.record import Record, several
from ..engines import xla
from ..errors import AssumptionError
from ..filters.kalman_filter import Kalman
from ..filters.unknown_gain import UnknownGain
from ..filters.unknown_input import UnknownInput
from ..frozen import replace
from ..models.prior import Prior
from ..protocols import Algorithm
from ..results import Interval, NoiseFit, Sample
from .binding import bind, select
from .noise_parameters import Free, Part, noise_of, parts

Noise: TypeAlias = Callable[..., tuple[Any, ...]]
Terms: TypeAlias = list[tuple[Any, Any, Any, Any, Noise]]  # algorithm, prior, samples, intervals, noise: of each kind
Likelihood: TypeAlias = Callable[[np.ndarray], tuple[float, np.ndarray]]  # of minus its logarithm, and of its gradient
Tunable: TypeAlias = Kalman | UnknownGain | UnknownInput

STEP = 1e-4  # of a logarithm, for differences of gradients: the error is then 1e-8 of the information
DISTINCT = 1e-7  # eigenvalue of the scaled information above which it exceeds the error of differences
FALLEN = -12.0  # logarithm of a standard deviation relative to its start: e^-24 of the variance counts as zero
SMALL = -4.0  # below this, a variance of zero is tried
NO_WORSE = 1e-3  # of the log-likelihood
ITERATIONS = 200


def fit_noise(
    algorithm: Algorithm[Any],
    record: Record | Sequence[Record],
    *,
    prior: Prior,
    free: Free = ("Q", "R"),
) -> NoiseFit:
    """The noise covariances that maximise the likelihood of a record (or several), with their standard errors.

    `algorithm`: `Kalman` or `UnknownGain`; its covariances are the start of the search, and those not free are fixed.
    `record`: one, or a list. `free`: the free covariances of "Q", "R" and (for UnknownGain) "walk"; or a mapping from them
    to "diagonal" (each variance by itself, with fixed correlations; the default for a diagonal matrix), "full" (every entry;
    the default otherwise), "scale" (one factor), or bools, one per variance. Variances are found as logarithms and full
    matrices by their Cholesky factor, so that every trial is positive semidefinite; a continuous Q remains a density.

    Raises `InputError` with every fault of the call; `AssumptionError` where the records do not distinguish the free entries:
    it names the direction and the eigenvalue of the information.

    Cost: some tens of gradients of the log-likelihood, each about 4 times a run of the filter.

    >>> model = StateSpace([[0.9]], Q=[[1.0]], R=[[1.0]], dt=1)
    >>> drawn = simulate(StateSpace([[0.9]], Q=[[0.2]], R=[[0.5]], dt=1), seed=1, steps=500)
    >>> fit = fit_noise(Kalman(model), drawn.record, prior=Prior([0.0], [[1.0]]))
    >>> fit.names, bool(np.all(abs(fit.parameters - [0.2, 0.5]) < 3 * fit.sigma))
    (('Q[x1]', 'R[y1]'), True)
    """
    algorithm = _read(algorithm)
    found, terms = _prepare(algorithm, record, prior, free)
    value, begin = likelihood(found, terms)
    θ, iterations = _climb(value, begin)
    at_zero = _fallen(value, found, θ)
    θ = np.where(at_zero, FALLEN, θ)
    covariance, best = _covariance(value, found, θ, at_zero), -float(value(θ)[0])
    θ = np.where(at_zero, -np.inf, θ)
    parameters, slope = (np.asarray(a) for a in (entries(found, θ), jax.jacobian(lambda t: entries(found, t))(θ)))
    names = tuple(name for part in found for name in part.names)
    tuned = _tuned(algorithm, found, θ)
    zeros = tuple(name for name, zero in zip(names, at_zero, strict=True) if zero)
    return NoiseFit(tuned, parameters, slope @ covariance @ slope.T, best, names, zeros, iterations)


def _read(algorithm: Algorithm[Any]) -> Tunable:
    if not isinstance(algorithm, Tunable):
        checks.refuse(
            f"fit_noise needs an algorithm of a model with noises, such as Kalman(model). Got {checks.short(algorithm)}."
        )
    return algorithm


def _prepare(
    algorithm: Tunable,
    record: Record | Sequence[Record],
    prior: Prior,
    free: Free,
) -> tuple[list[Part], Terms]:
    """The free covariances, and for each kind of record (algorithm, prior, samples, intervals, noise)."""
    faults = checks.Faults()

    found = parts(algorithm, free, faults)
    records = several("record", record, faults)
    faults.finish()
    terms = []
    for one in records:
        bound = bind(algorithm, one, prior)
        noise = noise_of(algorithm.model, one.clock(algorithm.model.dt or None))
        terms.append((bound.algorithm, prior, bound.samples, bound.intervals, noise))
    return found, _together(terms)


def _together(terms: Terms) -> Terms:
    """Records of the same shape and sampling stacked, so that they run at once."""
    groups: dict[Any, Terms] = {}
    for term in terms:
        leaves, structure = jax.tree_util.tree_flatten(term[0].ready)
        key = (str(structure), tuple(np.asarray(leaf).tobytes() for leaf in leaves), term[2].y.shape)
        groups.setdefault(key, []).append(term)

    def stacked(group: Terms, i: int) -> Any:
        return jax.tree_util.tree_map(lambda *leaves: np.stack(leaves), *(term[i] for term in group))

    return [(g[0][0], g[0][1], stacked(g, 2), stacked(g, 3), g[0][4]) for g in groups.values()]


def likelihood(found: list[Part], terms: Terms) -> tuple[Likelihood, np.ndarray]:
    """(θ -> minus the log-likelihood and its gradient), and the initial θ."""
    return _function(found, [term[4] for term in terms], [term[:4] for term in terms]), np.concatenate(
        [part.begin() for part in found]
    )


def _function(found: list[Part], noises: list[Noise], data: list[Any]) -> Likelihood:
    def value(θ: Array, data: list[Any]) -> Any:
        return -sum(_one(found, θ, noise, *term) for noise, term in zip(noises, data, strict=True))

    compiled = jax.jit(jax.value_and_grad(value))

    def evaluated(θ: np.ndarray) -> tuple[float, np.ndarray]:
        total, slope = compiled(jnp.asarray(θ), data)
        return float(total), np.asarray(slope)

    return evaluated


def _one(
    found: list[Part],
    θ: Array,
    noise: Noise,
    algorithm: Tunable,
    prior: Prior,
    samples: Sample,
    intervals: Interval,
):
    """Log-likelihood of the records of one kind at θ."""
    ready = with_noise(found, θ, noise, algorithm)
    axes = (None, 0, None)
    return jnp.sum(
        xla.scan_bank(ready, prior, samples, intervals, axes=axes, keep="likelihood", select=select).log_likelihood
    )


def with_noise(found: list[Part], θ: Array, noise: Noise, algorithm: Tunable):
    """The sampled algorithm with the covariances of θ."""
    from ..kernels.small import factors

    given = _matrices(found, θ)
    V, Ω, W = noise(given.get("Q"), given.get("R"))
    algorithm = replace(algorithm, ready=replace(algorithm.ready, V=V, Ω=Ω, W=W))
    return replace(algorithm, walk_factor=factors(given["walk"])) if "walk" in given else algorithm


def _slices(found: list[Part]) -> list[tuple[Part, slice]]:
    ends = np.cumsum([part.size for part in found])
    return [(part, slice(int(end) - part.size, int(end))) for part, end in zip(found, ends, strict=True)]


def _matrices(found: list[Part], θ: Array) -> dict[str, Any]:
    return {part.field: part.matrix(θ[at]) for part, at in _slices(found)}


def entries(found: list[Part], θ: Array):
    """The named entries of the covariances at θ."""
    return jnp.concatenate([part.entries(θ[at]) for part, at in _slices(found)])


def _tuned(algorithm: Tunable, found: list[Part], θ: Array):
    """The user's algorithm with the covariances of θ."""
    given = {field: np.asarray(M) for field, M in _matrices(found, θ).items()}
    noises = {field: M for field, M in given.items() if field != "walk"}
    changes = {"model": replace(algorithm.model, **noises)}
    return replace(algorithm, **changes, **({"walk": given["walk"]} if "walk" in given else {}))


def _climb(value: Likelihood, begin: np.ndarray) -> tuple[np.ndarray, int]:
    """The θ of maximum likelihood: a quasi-Newton search, then Newton steps until they are far below the errors."""
    from scipy.optimize import minimize

    scale = max(abs(value(begin)[0]), 1.0)

    def scaled(θ: np.ndarray) -> tuple[float, np.ndarray]:
        total, slope = value(θ)
        return (total / scale, slope / scale) if np.isfinite(total) else (1e30, 0 * slope)

    bounds = [(FALLEN - 1.0, 25.0) if b == 0 else (None, None) for b in begin]
    found = minimize(scaled, begin, jac=True, method="L-BFGS-B", bounds=bounds,
                     options={"maxiter": ITERATIONS, "ftol": 1e-15, "gtol": 1e-9})  # fmt: skip
    if not np.isfinite(found.fun) or found.fun >= 1e30:
        raise AssumptionError(
            "the likelihood is not finite where the search ended: the model may be unstable and unobserved."
        )
    return found.x, int(found.nit)


def _fallen(value: Likelihood, found: list[Part], θ: np.ndarray) -> np.ndarray:
    """The variances that the likelihood drives to zero: setting them to zero does not lower it."""
    small = np.concatenate([np.full(part.size, part.kind != "full") & (θ[at] < SMALL) for part, at in _slices(found)])
    for i in np.flatnonzero(small):
        small[i] = value(np.where(np.arange(len(θ)) == i, FALLEN, θ))[0] <= value(θ)[0] + NO_WORSE
    return small


def _covariance(value: Likelihood, found: list[Part], θ: np.ndarray, at_zero: np.ndarray) -> np.ndarray:
    """The inverse of the observed information about θ; zero for variances at zero."""
    free = np.flatnonzero(~at_zero)
    information = np.zeros((len(θ), len(θ)))
    for i in free:
        step = STEP * (np.arange(len(θ)) == i)
        information[i] = (value(θ + step)[1] - value(θ - step)[1]) / (2 * STEP)
    information = (information + information.T)[np.ix_(free, free)] / 2
    _check_distinct(information, [name for part in found for name in part.names], free)
    covariance = np.zeros((len(θ), len(θ)))
    covariance[np.ix_(free, free)] = np.linalg.inv(information)
    return covariance


def _check_distinct(information: np.ndarray, names: list[str], free: np.ndarray) -> None:
    """Raise an error where a direction of the free entries has no effect on the likelihood."""
    if not len(free):
        return
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    flat = np.diag(information) <= DISTINCT
    values, vectors = np.linalg.eigh(information / np.outer(np.where(flat, 1.0, scale), np.where(flat, 1.0, scale)))
    if values[0] > DISTINCT:
        return
    v = vectors[:, 0] / np.where(flat, 1.0, scale)
    v = v / np.linalg.norm(v) * np.sign(v[np.argmax(np.abs(v))])
    words = " ".join(f"{x:+.2f} log {names[i]}" for x, i in zip(v, free, strict=True) if abs(x) > 0.01).lstrip("+")
    raise AssumptionError(
        f"the records do not distinguish the free entries: along {words} the likelihood does not change (smallest "
        f"eigenvalue of the scaled information {values[0]:.2g}, {DISTINCT:.0e} needed). Fix one of them, or use a scale."
    )
