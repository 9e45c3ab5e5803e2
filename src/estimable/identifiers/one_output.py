"""Maximum likelihood for one output of an output-error model, over several records."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ..diagnostics.cramer_rao import UNTOLD, scale_of, undetermined
from ..kernels import impulse_start, response_at_stamps
from ..kernels import output_error_response as kernel
from ..kernels.auxiliary_model import stabilise
from ..kernels.coloured_noise import Colour, beyond, colour, moments, times
from ..kernels.impulse_start import Datum
from ..kernels.levenberg_marquardt import Found, search, within
from .validation import Pole

ROUNDS = 50  # of fit and noise variance, at most, where only some samples have their own
SETTLED = 1e-9  # relative change of that variance that ends them
LEAST = 1e-32  # of the mean square of an output: the square of the rounding unit
FAR = 1e100  # value of a residual that overflows: a search steps back from it
BOUND = 0.999  # of the modulus of a pole
INTEGRATOR_BOUND = 1.05  # where it is tested whether a pole is 1
CONSISTENT = 2.0  # standard deviations below 1, up to which a pole is an integrator
GROWING = 4.0  # and above 1: beyond, the plant is unstable


class Orders(NamedTuple):
    """Degrees of A and B, the delay, the number of impulses z that represent the past before row 0 of a record, and the number
    of coefficients of the level c_0 + c_1 k (0, 1 or 2). A = F A' with a known factor F.
    """

    na: int
    nb: int
    delay: int
    past: int
    level: int = 0
    F: tuple[float, ...] = (1.0,)

    @property
    def free(self) -> int:
        """The degree of A'."""
        return self.na + 1 - len(self.F)

    def parameters(self, m: int) -> tuple[np.ndarray, np.ndarray]:
        """θ = L η + θ0 of the unknowns η = (a', b)."""
        size = m * (self.nb + 1)
        L, θ0 = np.zeros((self.na + size, self.free + size)), np.zeros(self.na + size)
        θ0[: len(self.F) - 1] = self.F[1:]
        for i in range(self.free):
            L[i : i + len(self.F), i] = self.F
        L[self.na :, self.free :] = np.eye(size)
        return L, θ0


class OneOutput(NamedTuple):
    """The fit: θ (d,), the noise's variance, the information of the unknowns η of the plant, residuals, log-likelihood;
    whether the search has converged; the covariance of θ under the spectrum of the residuals; the coefficients of the level
    and their standard deviations (2, level); a pole at its bound; L = dθ/dη (None: they are the same); and the end of the
    search."""

    parameters: np.ndarray
    noise_variance: float
    information: np.ndarray
    residuals: tuple[np.ndarray, ...]
    log_likelihood: float
    converged: bool = True
    covariance: np.ndarray | None = None
    level: np.ndarray = np.zeros((2, 0))
    pole: Pole | None = None
    L: np.ndarray | None = None
    end: "EndOfSearch | None" = None

    @property
    def slopes(self) -> np.ndarray:
        """dθ/dη."""
        return np.eye(len(self.parameters)) if self.L is None else self.L


class EndOfSearch(NamedTuple):
    """The end of a search: the task, its unknowns x, the residuals e (N,) of the seen rows, their derivatives J, and their
    times `at`."""

    task: "Fitted"
    x: np.ndarray
    e: np.ndarray
    J: np.ndarray
    at: np.ndarray


class Fitted(NamedTuple):
    """One output's orders and data, for its residuals and their derivatives at x = (a', b, level, pasts)."""

    orders: Orders
    data: Sequence[Datum]

    @property
    def m(self) -> int:
        """The number of inputs."""
        return self.data[0].u.shape[1]

    @property
    def d(self) -> int:
        """The number of unknowns of the plant."""
        return self.orders.free + self.m * (self.orders.nb + 1)

    def parameters(self, x: np.ndarray) -> np.ndarray:
        """θ = (a, b)."""
        L, θ0 = self.orders.parameters(self.m)
        return L @ x[: self.d] + θ0

    def response(self, x: np.ndarray, datum: Datum) -> np.ndarray:
        """The response (T,) to the inputs of one record, from rest."""
        θ, na = self.parameters(x), self.orders.na
        return _response(θ[:na], θ[na:].reshape(self.m, self.orders.nb + 1), self.orders.delay, datum, np.zeros(0))

    def outputs(self, x: np.ndarray) -> list[np.ndarray]:
        """The outputs of each record."""
        found = []
        a, b, c, pasts = self._parts(x)
        for datum, z in zip(self.data, pasts, strict=True):
            found.append(_response(a, b, self.orders.delay, datum, z) + powers(datum, len(c)) @ c)
        return found

    def _parts(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """a, b (m, nb+1), the coefficients of the level, and the past of each record (records, past)."""
        θ, na, after = self.parameters(x), self.orders.na, self.d + self.orders.level
        b, pasts = θ[na:].reshape(self.m, self.orders.nb + 1), x[after:].reshape(len(self.data), self.orders.past)
        return θ[:na], b, x[self.d : after], pasts

    def residuals(self, x: np.ndarray) -> np.ndarray:
        """Of the rows that were seen, (N,)."""
        pairs = zip(self.outputs(x), self.data, strict=True)
        e = np.concatenate([(out - datum.y)[datum.seen] / sizes(datum) for out, datum in pairs])
        return np.nan_to_num(np.clip(e, -FAR, FAR), nan=FAR)

    def slopes(self, x: np.ndarray) -> np.ndarray:
        """The derivative of the residuals, (N, unknowns)."""
        a, b, c, pasts = self._parts(x)
        L, blocks, past = self.orders.parameters(self.m)[0], [], self.orders.past
        for i, (datum, z) in enumerate(zip(self.data, pasts, strict=True)):
            ψ, own = _slopes(a, b, self.orders.delay, datum, z)
            every = np.zeros((len(datum.y), past * len(self.data)))
            every[:, i * past : (i + 1) * past] = own
            columns = np.concatenate([ψ @ L, powers(datum, len(c)), every], axis=1)[datum.seen]
            blocks.append((columns.T / sizes(datum)).T)
        return np.clip(np.concatenate(blocks), -FAR, FAR)

    def begun(self, a: np.ndarray, bound: float) -> np.ndarray:
        """x with these coefficients of A', brought within the bound, and all others by linear least squares."""
        x = np.zeros(self.d + self.orders.level + self.orders.past * len(self.data))
        x[: len(a)] = within(a, bound)
        y, n = -self.residuals(x), self.orders.free
        Φ = self.slopes(x)[:, n:]
        size = np.linalg.norm(Φ, axis=0)
        scale = 1 / np.where(size > 0, size, 1.0)
        x[n:] = scale * np.linalg.lstsq(Φ * scale, y, rcond=1e-10)[0]
        return x

    def search(self, start: np.ndarray, bound: float) -> Found:
        """The search from x = `start` with the poles of A' inside the bound."""

        def inside(x: np.ndarray) -> np.ndarray:
            a = within(x[: self.orders.free], bound)
            return x if a is x or np.array_equal(a, x[: self.orders.free]) else self.begun(a, bound)

        return search(self.residuals, self.slopes, start, inside)

    def assembled(self, end: Found, noise_variance: float | None) -> OneOutput:
        """The fit at the end of a search."""
        e, J = end.e, self.slopes(end.x)
        determined = len(end.x) - undetermined(J.T @ J).shape[1]
        spare = max(len(e) - determined, 1)
        r = float(e @ e / spare) if noise_variance is None else noise_variance
        size = max((float(np.mean(one.y[one.seen] ** 2)) for one in self.data if one.seen.any()), default=0.0)
        r = max(r, LEAST * size, 1e-200)  # noise-free data: the rounding error
        scales = sum(float(np.sum(np.log(sizes(datum)))) for datum in self.data)
        log_likelihood = -0.5 * (len(e) * np.log(2 * np.pi * r) + float(e @ e) / r) - scales
        residuals = tuple(datum.y - out for datum, out in zip(self.data, self.outputs(end.x), strict=True))
        at, L = times([datum.seen for datum in self.data]), self.orders.parameters(self.m)[0]
        noise, at_end = colour(e, at), EndOfSearch(self, end.x, e, J, at)
        M, Σ = coloured_covariance(J, self.d, noise, at, r)
        return OneOutput(
            self.parameters(end.x), r, M, residuals, log_likelihood, end.converged, L @ Σ @ L.T,
            self._level(at_end, noise, r), L=L, end=at_end,
        )  # fmt: skip

    def _level(self, end: EndOfSearch, noise: Colour, r: float) -> np.ndarray:
        """The coefficients of the level and their standard deviations."""
        columns = np.arange(self.d, self.d + self.orders.level)
        if not len(columns):
            return np.zeros((2, 0))
        J = np.concatenate([end.J[:, columns], np.delete(end.J, columns, axis=1)], axis=1)
        _, Σ = coloured_covariance(J, len(columns), noise, end.at, r)
        return np.stack([end.x[columns], np.sqrt(np.diagonal(Σ))])


def fit_output(orders: Orders, data: Sequence[Datum], starts: Sequence[Any], noise_variance: float | None) -> OneOutput:
    """The best of the searches from `starts` (d,) and from linearly fitted impulse responses, with every pole inside `BOUND`.

    A real pole at the bound may be an integrator: the bound is then 1.05, and a pole that does not differ significantly from 1
    is fixed there.
    """
    first = [impulse_start.start(orders.na, orders.nb, orders.delay, one) for one in _centred(orders, data)]
    if all(datum.sigma is None for datum in data):
        return _best(Fitted(orders, data), [*first, *starts], noise_variance)
    return _weighed(Fitted(orders, data), [*first, *starts], noise_variance)


def _best(task: Fitted, starts: Sequence[Any], noise_variance: float | None) -> OneOutput:
    na = task.orders.na
    stable = [np.asarray(stabilise(np.asarray(θ)[:na])) if na else np.zeros(0) for θ in starts]
    best = min((task.search(task.begun(a, BOUND), BOUND) for a in stable), key=lambda end: end.cost)
    found, pole = task.assembled(best, noise_variance), _outermost(best.x[:na])
    if abs(pole) < BOUND * (1 - 1e-9) or undetermined(found.information).shape[1]:
        return found
    if pole.imag or pole.real < 0:
        return found._replace(pole=Pole(pole, 0.0, BOUND))
    return _near_one(task, best, noise_variance)


def _weighed(task: Fitted, starts: Sequence[Any], noise_variance: float | None) -> OneOutput:
    """The fit with samples of known standard deviations; the others have a variance in common, which is estimated in turn."""
    own = [np.full(len(one.y), np.nan) if one.sigma is None else one.sigma for one in task.data]
    other = [np.isnan(σ) & one.seen for σ, one in zip(own, task.data, strict=True)]
    N, count = (sum(int(mask.sum()) for mask in masks) for masks in ([one.seen for one in task.data], other))

    def mean_square(values: Sequence[np.ndarray]) -> float:
        return sum(float(np.sum(one[mask] ** 2)) for one, mask in zip(values, other, strict=True)) / max(count, 1)

    def at(r: float, starts: Sequence[Any]) -> OneOutput:
        filled = [np.where(np.isnan(σ), np.sqrt(max(r, 1e-200)), σ) for σ in own]
        data = [one._replace(sigma=σ) for one, σ in zip(task.data, filled, strict=True)]
        return _best(task._replace(data=data), starts, 1.0)

    r = mean_square([one.y for one in task.data]) if noise_variance is None else noise_variance
    found = at(r, starts)
    for _ in range(ROUNDS if count and noise_variance is None else 0):
        before, r = r, mean_square(found.residuals) / max(1 - len(found.parameters) / N, 1 / N)
        if abs(r - before) <= SETTLED * r:
            break
        found = at(r, [found.parameters])
    if not count:
        r = float(np.mean(np.concatenate([σ[one.seen] ** 2 for σ, one in zip(own, task.data, strict=True)])))
    return found._replace(noise_variance=r)


def sizes(datum: Datum) -> Any:
    """The standard deviations of the samples that were seen; 1 where all are alike."""
    return 1.0 if datum.sigma is None else datum.sigma[datum.seen]


def _response(a: np.ndarray, b: np.ndarray, delay: int, datum: Datum, z: np.ndarray) -> np.ndarray:
    """The output of one record, (T,); `z`: the impulses before it or, at stamps, its state at row 0."""
    if datum.steps is None:
        return kernel.response(a, b, delay, datum.u, z)
    return response_at_stamps.response(a, b, delay, datum.u, datum.steps, z if len(z) else None)


def _slopes(a: np.ndarray, b: np.ndarray, delay: int, datum: Datum, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Its derivatives with respect to θ (T, d) and to z."""
    if datum.steps is None:
        x = kernel.response(a, b, delay, datum.u, z)
        return kernel.slopes(a, b, delay, datum.u, x), kernel.initial_slopes(a, len(datum.y), len(z))
    ψ = response_at_stamps.slopes(a, b, delay, datum.u, datum.steps, z if len(z) else None)
    return ψ, response_at_stamps.free(a, b, delay, datum.steps)[:, : len(z)]


def powers(datum: Datum, count: int) -> np.ndarray:
    """1 and k, (T, count); at stamps k is the time in nominal steps."""
    T = len(datum.y)
    k = np.arange(T, dtype=float) if datum.steps is None else np.concatenate([[0.0], np.cumsum(datum.steps)])
    return k[:, None] ** np.arange(count)


def _centred(orders: Orders, data: Sequence[Datum]) -> list[Sequence[Datum]]:
    """The data as they are and, with a level, about their means."""
    seen = np.concatenate([one.y[one.seen] for one in data])
    if not orders.level or not len(seen):
        return [data]
    u, y = np.concatenate([one.u for one in data]).mean(axis=0), float(seen.mean())
    return [data, [one._replace(u=one.u - u, y=one.y - y) for one in data]]


def _near_one(task: Fitted, end: Found, noise_variance: float | None) -> OneOutput:
    """The fit with an integrator, with a pole between 0.999 and 1, or with a pole fixed at the bound."""
    poles = np.roots(np.append(1.0, end.x[: task.orders.na]))
    others = np.delete(poles, np.argmin(np.abs(poles - 1)))
    growing = _coefficients(np.append(others, 1 + 3 / max(len(one.y) for one in task.data)))
    starts = [end.x, task.begun(growing, INTEGRATOR_BOUND)]
    best = min((task.search(x, INTEGRATOR_BOUND) for x in starts), key=lambda one: one.cost)
    found = task.assembled(best, noise_variance)
    z, σ = _real_pole(found, task.orders.na)
    if z < 1 - CONSISTENT * σ:
        return found
    at = 1.0 if z < 1 + GROWING * σ else BOUND
    level = (
        max(task.orders.level - 1, 0) if at == 1.0 else task.orders.level
    )  # that of an integrator is its initial state
    fixed = task._replace(orders=task.orders._replace(F=(1.0, -at), level=level))
    again = fixed.assembled(fixed.search(fixed.begun(_coefficients(others), BOUND), BOUND), noise_variance)
    return again._replace(pole=Pole(z, σ, at))


def _coefficients(poles: np.ndarray) -> np.ndarray:
    """a_1 .. of the polynomial with these roots."""
    return np.atleast_1d(np.real(np.poly(poles)))[1:]


def _outermost(a: np.ndarray) -> complex:
    """The pole of largest modulus, 0 where there is none."""
    poles = np.roots(np.append(1.0, a))
    return complex(poles[np.argmax(np.abs(poles))]) if len(poles) else 0j


def _real_pole(found: OneOutput, na: int) -> tuple[float, float]:
    """The pole nearest to 1 and its standard deviation: dz/da_i = - z^(n-i) / A'(z)."""
    A, Σ = np.append(1.0, found.parameters[:na]), np.asarray(found.covariance)[:na, :na]
    poles = np.roots(A)
    z = float(np.real(poles[np.argmin(np.abs(poles - 1))]))
    g = z ** np.arange(na - 1, -1, -1) / np.polyval(np.polyder(A), z)
    return z, float(np.sqrt(max(g @ Σ @ g, 0.0)))


def coloured_covariance(
    J: np.ndarray, d: int, noise: Colour, at: np.ndarray, r: float
) -> tuple[np.ndarray, np.ndarray]:
    """The information of the first d unknowns for white residuals of variance r, and their covariance under their spectrum."""
    own = beyond(J[:, :d], J[:, d:])
    M = own.T @ own / r
    white = covariance(M)
    return M, white @ moments(own, at, noise) @ white / r


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
