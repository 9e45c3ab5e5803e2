"""Maximum likelihood for one output of an output-error model, where some inputs are unknown."""

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .. import checks
from ..data.record import Record
from ..kernels import uncertain_input_likelihood as kernel
from ..kernels.impulse_start import Datum
from .one_output import OneOutput, Orders, fit_output, marginal

PATIENCE = 200  # steps of a search
STEEP = 1e-5  # gradient of the log-likelihood in scaled unknowns that ends a search


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
    mean, variance = np.nanmean(logged, axis=0), np.nanvar(logged, axis=0)
    rate = 1.0 if arrival is None else np.broadcast_to(arrival, mean.shape)
    return [_expected(record, mask, mean, variance, rate) for record, mask in zip(records, unknown, strict=True)]


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
    orders: Orders, data: Sequence[Datum], inputs: Sequence[Expected], noise_variance: float | None
) -> OneOutput:
    """The fit of one output, started from the fit with the expected inputs as known."""
    from scipy.optimize import minimize

    known = [datum._replace(u=one.mean) for datum, one in zip(data, inputs, strict=True)]
    first = fit_output(orders._replace(past=0), known, [], None)
    free = noise_variance is None
    n = max(orders.na, orders.nb + orders.delay, 1)
    pasts = n * len(data) if orders.past else 0
    start = np.concatenate([first.parameters, np.zeros(pasts), [np.log(first.noise_variance / 2)] if free else []])
    rows = _rows(data, inputs)
    cost = partial(_cost, rows=rows, orders=orders, noise_variance=noise_variance)
    scale = np.concatenate([np.maximum(np.abs(first.parameters), 0.1), np.ones(len(start) - len(first.parameters))])
    size = sum(int(datum.seen.sum()) for datum in data)

    def scaled(z: np.ndarray):
        value, slope = _slope(z * scale, rows, orders, noise_variance)
        bad = not np.isfinite(value)
        return (1e12, np.zeros_like(z)) if bad else (float(value) / size, np.asarray(slope) * scale / size)

    end = minimize(scaled, start / scale, jac=True, method="BFGS", options={"maxiter": PATIENCE, "gtol": STEEP})
    x = end.x * scale
    d = len(first.parameters)
    r = float(np.exp(x[-1])) if free else noise_variance
    M = np.asarray(_curvature(x, rows, orders, noise_variance))
    _, e, V = cost_parts(x, rows, orders, noise_variance)
    residuals = tuple(
        np.where(datum.seen, np.asarray(one)[: len(datum.y)] * np.sqrt(r / np.asarray(v)[: len(datum.y)]), np.nan)
        for datum, one, v in zip(data, e, V, strict=True)
    )
    return OneOutput(x[:d], r, marginal((M + M.T) / 2, d), residuals, -float(cost(x)))


def _rows(data: Sequence[Datum], inputs: Sequence[Expected]) -> tuple:
    """All records, padded to one length with missing rows."""
    T = max(len(datum.y) for datum in data)

    def padded(array: np.ndarray) -> np.ndarray:
        return np.concatenate([array, np.zeros((T - len(array), *array.shape[1:]), array.dtype)])

    return tuple(
        np.stack([padded(column) for column in columns])
        for columns in zip(
            *(
                (one.mean, one.variance, np.nan_to_num(datum.y), datum.seen)
                for datum, one in zip(data, inputs, strict=True)
            ),
            strict=True,
        )
    )


def cost_parts(x: np.ndarray, rows: tuple, orders: Orders, noise_variance: float | None) -> tuple:
    """Minus the log-likelihood, and the innovations with their variances, record by record."""
    records, m = rows[0].shape[0], rows[0].shape[2]
    d, n = orders.na + m * (orders.nb + 1), max(orders.na, orders.nb + orders.delay, 1)
    a, b = x[: orders.na], x[orders.na : d].reshape(m, orders.nb + 1)
    pasts = x[d : d + n * records].reshape(records, n) if orders.past else jnp.zeros((records, n))
    r = jnp.exp(x[-1]) if noise_variance is None else noise_variance
    total, e, V = jax.vmap(lambda s, *row: kernel.log_likelihood(a, b, r, s, orders.delay, row))(pasts, *rows)
    return -jnp.sum(total), e, V


@partial(jax.jit, static_argnames=("orders",))
def _cost(x: np.ndarray, rows: tuple, orders: Orders, noise_variance: float | None) -> Any:
    return cost_parts(x, rows, orders, noise_variance)[0]


_slope = jax.jit(jax.value_and_grad(_cost), static_argnames=("orders",))
_curvature = jax.jit(jax.jacfwd(jax.grad(_cost)), static_argnames=("orders",))
