"""Maximum likelihood for one output of an output-error model, over several records."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ..diagnostics.cramer_rao import UNTOLD, scale_of, undetermined
from ..kernels import impulse_start
from ..kernels import output_error_response as kernel
from ..kernels.auxiliary_model import stabilise
from ..kernels.coloured_noise import beyond, colour, moments, times
from ..kernels.impulse_start import Datum

CONVERGED = (
    1e-13  # relative change of the parameters, of the sum of squares, and angle to the gradient, that end a search
)
ROUNDS = 50  # of fit and noise variance, at most, where only some samples have their own
SETTLED = 1e-9  # relative change of that variance that ends them
LEAST = 1e-32  # of the mean square of an output: the square of the rounding unit
FAR = 1e100  # value of a residual that overflows: a search steps back from it


class Orders(NamedTuple):
    """Degrees of A and B, the delay, and the number of impulses z that represent the past before row 0 of a record."""

    na: int
    nb: int
    delay: int
    past: int


class OneOutput(NamedTuple):
    """The fit: θ (d,), the noise's variance, the information of θ with the past marginalised, residuals, log-likelihood;
    whether the search has converged; and the covariance of θ under the spectrum of the residuals."""

    parameters: np.ndarray
    noise_variance: float
    information: np.ndarray
    residuals: tuple[np.ndarray, ...]
    log_likelihood: float
    converged: bool = True
    covariance: np.ndarray | None = None


def fit_output(orders: Orders, data: Sequence[Datum], starts: Sequence[Any], noise_variance: float | None) -> OneOutput:
    """The best of the searches from `starts` (d,) and from a linearly fitted impulse response."""
    first = impulse_start.start(orders.na, orders.nb, orders.delay, data)
    starts = [first, *starts]
    if all(datum.sigma is None for datum in data):
        return _best(orders, data, starts, noise_variance)
    return _weighed(orders, data, starts, noise_variance)


def _best(orders: Orders, data: Sequence[Datum], starts: Sequence[Any], noise_variance: float | None) -> OneOutput:
    ends = [_search(orders, data, θ) for θ in starts if θ is not None]
    best, _, converged = min(ends, key=lambda end: end[1])
    return _assembled(orders, data, best, noise_variance)._replace(converged=converged)


def _weighed(orders: Orders, data: Sequence[Datum], starts: Sequence[Any], noise_variance: float | None) -> OneOutput:
    """The fit with samples of known standard deviations; the others have a variance in common, which is estimated in turn."""
    own = [np.full(len(one.y), np.nan) if one.sigma is None else one.sigma for one in data]
    other = [np.isnan(σ) & one.seen for σ, one in zip(own, data, strict=True)]
    N, count = (sum(int(mask.sum()) for mask in masks) for masks in ([one.seen for one in data], other))
    estimated = count > 0 and noise_variance is None

    def mean_square(values: Sequence[np.ndarray]) -> float:
        return sum(float(np.sum(one[mask] ** 2)) for one, mask in zip(values, other, strict=True)) / max(count, 1)

    def at(r: float, starts: Sequence[Any]) -> OneOutput:
        filled = [np.where(np.isnan(σ), np.sqrt(max(r, 1e-200)), σ) for σ in own]
        return _best(orders, [one._replace(sigma=σ) for one, σ in zip(data, filled, strict=True)], starts, 1.0)

    r = mean_square([one.y for one in data]) if noise_variance is None else noise_variance
    found = at(r, starts)
    for _ in range(ROUNDS if estimated else 0):
        before, r = r, mean_square(found.residuals) / max(1 - len(found.parameters) / N, 1 / N)
        if abs(r - before) <= SETTLED * r:
            break
        found = at(r, [found.parameters])
    if not count:
        r = float(np.mean(np.concatenate([σ[one.seen] ** 2 for σ, one in zip(own, data, strict=True)])))
    return found._replace(noise_variance=r)


def _search(orders: Orders, data: Sequence[Datum], θ: np.ndarray) -> tuple[np.ndarray, float, bool]:
    """θ and all pasts at the end of one search, the sum of squares there, and whether the search has converged."""
    from scipy.optimize import least_squares

    θ = np.asarray(θ, float).copy()
    θ[: orders.na] = np.asarray(stabilise(θ[: orders.na])) if orders.na else θ[: orders.na]
    start = np.concatenate([θ, np.zeros(orders.past * len(data))])
    seen = sum(int(datum.seen.sum()) for datum in data)
    rows = max(len(start) - seen, 0)  # MINPACK needs as many data as unknowns: zero rows add no information

    def residual(x: np.ndarray):
        return np.append(_residuals(orders, data, x), np.zeros(rows))

    def slopes(x: np.ndarray):
        return np.vstack([_slopes(orders, data, x), np.zeros((rows, len(x)))])

    end = least_squares(
        residual,
        start,
        jac=slopes,  # type: ignore[arg-type]
        method="lm",
        x_scale="jac",
        xtol=CONVERGED,
        ftol=CONVERGED,
        gtol=CONVERGED,
    )
    return end.x, float(end.cost), end.status > 0


def _parts(orders: Orders, datum: Datum, i: int, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """a, b and the past of record i."""
    m = datum.u.shape[1]
    d = orders.na + m * (orders.nb + 1)
    return (
        x[: orders.na],
        x[orders.na : d].reshape(m, orders.nb + 1),
        x[d + i * orders.past : d + (i + 1) * orders.past],
    )


def _responses(orders: Orders, data: Sequence[Datum], x: np.ndarray) -> list[np.ndarray]:
    parts = [_parts(orders, datum, i, x) for i, datum in enumerate(data)]
    return [kernel.response(a, b, orders.delay, datum.u, z) for datum, (a, b, z) in zip(data, parts, strict=True)]


def _residuals(orders: Orders, data: Sequence[Datum], x: np.ndarray) -> np.ndarray:
    responses = _responses(orders, data, x)
    e = np.concatenate([
        (out - datum.y)[datum.seen] / _sizes(datum) for out, datum in zip(responses, data, strict=True)
    ])  # fmt: skip
    return np.clip(e, -FAR, FAR)


def _sizes(datum: Datum) -> Any:
    """The standard deviations of the samples that were seen; 1 where all are alike."""
    return 1.0 if datum.sigma is None else datum.sigma[datum.seen]


def _slopes(orders: Orders, data: Sequence[Datum], x: np.ndarray) -> np.ndarray:
    """The derivative of the residuals, (N, d + pasts)."""
    blocks = []
    for i, (datum, response) in enumerate(zip(data, _responses(orders, data, x), strict=True)):
        a, b, _ = _parts(orders, datum, i, x)
        ψ = kernel.slopes(a, b, orders.delay, datum.u, response)
        pasts = np.zeros((len(datum.y), orders.past * len(data)))
        pasts[:, i * orders.past : (i + 1) * orders.past] = kernel.initial_slopes(a, len(datum.y), orders.past)
        blocks.append((np.concatenate([ψ, pasts], axis=1)[datum.seen].T / _sizes(datum)).T)
    return np.clip(np.concatenate(blocks), -FAR, FAR)


def _assembled(orders: Orders, data: Sequence[Datum], x: np.ndarray, noise_variance: float | None) -> OneOutput:
    e, J = _residuals(orders, data, x), _slopes(orders, data, x)
    d = len(x) - orders.past * len(data)
    determined = len(x) - undetermined(J.T @ J).shape[1]
    spare = max(len(e) - determined, 1)
    r = float(e @ e / spare) if noise_variance is None else noise_variance
    size = max((float(np.mean(datum.y[datum.seen] ** 2)) for datum in data if datum.seen.any()), default=0.0)
    r = max(r, LEAST * size, 1e-200)  # noise-free data: the rounding error
    scales = sum(float(np.sum(np.log(_sizes(datum)))) for datum in data)
    log_likelihood = -0.5 * (len(e) * np.log(2 * np.pi * r) + float(e @ e) / r) - scales
    residuals = tuple(datum.y - out for datum, out in zip(data, _responses(orders, data, x), strict=True))
    M = marginal(J.T @ J / r, d)
    Σ = coloured_covariance(M, J, e, times([datum.seen for datum in data]), r)
    return OneOutput(x[:d], r, M, residuals, log_likelihood, covariance=Σ)


def coloured_covariance(M: np.ndarray, J: np.ndarray, e: np.ndarray, at: np.ndarray, r: float) -> np.ndarray:
    """The covariance of the first d unknowns, M (d, d) their information for white residuals of variance r."""
    white, own = covariance(M), beyond(J[:, : len(M)], J[:, len(M) :])
    return white @ moments(own, at, colour(e, at)) @ white / r


def covariance(M: np.ndarray) -> np.ndarray:
    """The inverse of the information along the determined directions; zero along the rest."""
    scale = scale_of(M)
    values, vectors = np.linalg.eigh(M * np.outer(scale, scale))
    determined = values > UNTOLD * values.max(initial=0.0)
    return (vectors[:, determined] / values[determined]) @ vectors[:, determined].T * np.outer(scale, scale)


def marginal(M: np.ndarray, d: int) -> np.ndarray:
    """The information about the first d unknowns when the others are estimated too: M11 - M12 M22^+ M21."""
    if len(M) == d:
        return M
    scale = scale_of(M)
    scaled = M * np.outer(scale, scale)
    inner = np.linalg.pinv(scaled[d:, d:], rcond=1e-12, hermitian=True)
    left = scaled[:d, :d] - scaled[:d, d:] @ inner @ scaled[d:, :d]
    back = np.where(scale[:d] > 0, 1 / np.where(scale[:d] > 0, scale[:d], 1.0), 0.0)
    return left * np.outer(back, back)
