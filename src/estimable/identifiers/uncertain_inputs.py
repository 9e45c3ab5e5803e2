"""Maximum likelihood for one output of an output-error model, where some inputs are unknown."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from .. import checks
from ..annotations import Array
from ..data.record import Record
from ..frozen import frozen
from ..kernels import uncertain_input_likelihood as kernel
from ..kernels.impulse_start import Datum
from ..kernels.innovation_information import Search
from ..kernels.missing_series import conditional
from ..kernels.uncertain_input_likelihood import Companion
from ..results import Info, Interval, Sample
from .one_output import OneOutput, Orders, covariance, fit_output, marginal, powers

STRIDE = 2.0  # of the logarithm of the noise variance, in one step of the search


class Expected(NamedTuple):
    """Means of the inputs (T, m) of a record, and their variances; zero where the inputs are known."""

    mean: np.ndarray
    variance: np.ndarray


def expected(records: Sequence[Record], arrival: float | None) -> list[Expected]:
    """Means and variances of the inputs: one of unknown arrival came with its rate, one not logged is like the logged ones.

    Raises `InputError` where arrivals are unknown and there is no rate, or a held input depends on one.
    """
    faults = checks.Faults()
    logged = np.concatenate([record.u for record in records])
    unknown = [np.isnan(np.ones_like(record.u) if record.arrived is None else record.arrived) for record in records]
    if any(mask.any() for mask in unknown) and arrival is None:
        faults.add("it is unknown whether some inputs arrived: give `arrival`, the rate at which they do.")
    if any(mask.any() and record.lost == "hold" for mask, record in zip(unknown, records, strict=True)):
        faults.add(
            'the actuator must apply zero (lost="zero") where the arrival of inputs is unknown: for "hold" use JointOutputError.'
        )
    for j in np.flatnonzero(np.isnan(logged).all(axis=0)):
        faults.add(f"input {records[0].inputs[j]!r} was never logged: its mean and variance are unknown.")
    faults.finish()
    rate = 1.0 if arrival is None else np.broadcast_to(arrival, logged.shape[1])
    guesses = zip(*(conditional(column) for column in logged.T), strict=True)
    ends = np.cumsum([len(record) for record in records])[:-1]
    means, variances = (np.split(np.stack(columns, axis=1), ends) for columns in guesses)
    rows = zip(records, unknown, means, variances, strict=True)
    return [_expected(record, mask, mean, variance, rate) for record, mask, mean, variance in rows]


def _expected(
    record: Record, unknown: np.ndarray, mean: np.ndarray, variance: np.ndarray, rate: float | np.ndarray
) -> Expected:
    arrived = np.ones_like(record.u) if record.arrived is None else record.arrived
    p = np.where(unknown, rate, np.nan_to_num(arrived))
    lost = np.isnan(record.u)
    u, spread = np.where(lost, mean, record.u), np.where(lost, variance, 0.0)
    if record.lost == "hold" and not unknown.any():  # the last arrived input is held, logged or not
        held = record.applied()
        u, spread = np.where(np.isnan(held), mean, held), np.where(np.isnan(held), variance, 0.0)
        p = np.ones(u.shape)
    return Expected(p * u, p * (spread + (1 - p) * u**2))


def fit_uncertain(
    orders: Orders, data: Sequence[Datum], inputs: Sequence[Expected], noise_variance: float | None, search: Search
) -> OneOutput:
    """The fit of one output, started from the fit with the expected inputs as known."""
    known = [datum._replace(u=one.mean) for datum, one in zip(data, inputs, strict=True)]
    first = fit_output(orders._replace(past=0), known, [], None)
    unknowns = Unknowns(orders, data[0].u.shape[1], len(data), noise_variance)
    d, free = len(first.parameters), noise_variance is None and any(_unmeasured(datum) for datum in data)
    noise_variance = first.noise_variance if noise_variance is None and not free else noise_variance
    unknowns = unknowns._replace(noise_variance=noise_variance)
    noise = [np.log(first.noise_variance / 2)] if free else []
    level = np.pad(first.level[0], (0, orders.level - first.level.shape[1]))
    start = np.concatenate([first.parameters, np.zeros(unknowns.pasts), level, noise])
    stride = np.full(len(start), np.inf)
    stride[len(start) - len(noise) :] = STRIDE
    rows = [_rows(datum, one, orders.level) for datum, one in zip(data, inputs, strict=True)]
    found = search(unknowns.build, rows, start, stride)
    r = float(np.exp(found.θ[-1])) if noise_variance is None else noise_variance
    residuals = tuple(
        np.where(datum.seen, e[:, 0] * np.sqrt(_noise_of(datum, r) / V[:, 0, 0]), np.nan)
        for datum, (e, V) in zip(data, found.innovations, strict=True)
    )
    information = marginal(found.information, d)
    at = np.arange(d + unknowns.pasts, d + unknowns.pasts + orders.level)
    spread = np.sqrt(np.maximum(np.diagonal(covariance(found.information))[at], 0.0))
    return OneOutput(
        found.θ[:d],
        r,
        information,
        residuals,
        found.log_likelihood,
        found.converged,
        level=np.stack([found.θ[at], spread]),
        end=first.end,
    )


class Unknowns(NamedTuple):
    """θ = (a, b, the state before row 0 of each record, the level, log r), of one output; parts that are not free are not in θ.

    The level enters as known inputs 1 and k, which act on the output alone.
    """

    orders: Orders
    m: int
    records: int
    noise_variance: float | None

    @property
    def n(self) -> int:
        """The number of states."""
        return max(self.orders.na, self.orders.nb + self.orders.delay, 1)

    @property
    def pasts(self) -> int:
        """The number of initial states that are free."""
        return self.n * self.records if self.orders.past else 0

    def build(self, θ: np.ndarray, i: int) -> tuple["UncertainInputStep", np.ndarray]:
        """The step of record i and its initial state, at θ, which may be complex."""
        na, d = self.orders.na, self.orders.na + self.m * (self.orders.nb + 1)
        a, b = θ[:na], θ[na:d].reshape(self.m, self.orders.nb + 1)
        past = θ[d + i * self.n : d + (i + 1) * self.n] if self.pasts else np.zeros(self.n)
        r = np.exp(θ[-1]) if self.noise_variance is None else self.noise_variance
        F, G, D, r = kernel.companion(a, b, self.orders.delay, np.asarray(r))
        level = θ[d + self.pasts : d + self.pasts + self.orders.level]
        G = np.concatenate([G, np.zeros((self.n, len(level)))], axis=1)
        return UncertainInputStep(Companion(F, G, np.concatenate([D, level]), r)), past


@frozen
class UncertainInputStep:
    """One row of the likelihood, for an engine: the state is (s, P) of the kernel; a sample holds ū, and W in `extra`."""

    model: Companion

    def at(self, k: int | Array) -> "UncertainInputStep":
        """The same in every row."""
        return self

    def init(self, prior: Array) -> tuple[Any, Any]:
        """The state before row 0, which is known."""
        s = jnp.asarray(prior)
        return s, jnp.zeros((len(s), len(s)))

    def correct(self, state: tuple[Any, Any], sample: Sample) -> tuple[tuple[Any, Any], Info]:
        """The whole row: the input enters the output and the next state with one and the same error."""
        model = self.model
        if sample.sigma is not None:
            model = model._replace(r=jnp.where(jnp.isnan(sample.sigma[0]), model.r, sample.sigma[0] ** 2))
        s, P, row = kernel.step(model, *state, sample.u, sample.extra, sample.y[0], sample.seen[0])
        e = jnp.where(sample.seen, row.e, jnp.nan)
        outcome = jnp.where(row.V > 0, 0, 1)
        return (s, P), Info(s, P, e, jnp.reshape(row.V, (1, 1)), row.log_likelihood, outcome=outcome)

    def predict(self, state: tuple[Any, Any], interval: Interval) -> tuple[Any, Any]:
        """The next row begins where the last one ended."""
        return state


def _rows(datum: Datum, inputs: Expected, level: int) -> Sample:
    """The rows of a record, with 1 and k as known inputs."""
    sigma = None if datum.sigma is None else datum.sigma[:, None]
    mean = np.concatenate([inputs.mean, powers(datum, level)], axis=1)
    variance = np.pad(inputs.variance, ((0, 0), (0, level)))
    return Sample(np.nan_to_num(datum.y)[:, None], datum.seen[:, None], mean, None, variance, sigma=sigma)


def _unmeasured(datum: Datum) -> bool:
    """Whether the noise of some seen sample is not known."""
    return datum.sigma is None or bool(np.isnan(datum.sigma[datum.seen]).any())


def _noise_of(datum: Datum, r: float) -> Any:
    """The variance of the noise of each row."""
    return r if datum.sigma is None else np.where(np.isnan(datum.sigma), r, datum.sigma**2)
