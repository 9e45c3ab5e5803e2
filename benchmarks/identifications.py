"""W17: identification: the default comparison, and the output-error model by maximum likelihood."""

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import lfilter

from estimable import OutputError, OutputErrorML, Record, StateSpace, compare, identify, simulate

from .common import best, row


def comparisons(name, T, channels, missing):
    """The seconds of `compare` with its own candidates; `missing`: the share of the inputs that was not logged."""
    record = _driven(T, channels, missing)
    seconds, first, _ = best(lambda: compare(None, record), 3)
    yield row(name, "estimable compare", seconds, first)


def _driven(T, channels, missing):
    """A system of order 4 with as many inputs as outputs."""
    rng = np.random.default_rng(3)
    A = np.diag([0.9, 0.7, 0.5, 0.2]) + np.diag(0.1 * np.ones(3), 1)
    B, C = rng.normal(size=(4, channels)), rng.normal(size=(channels, 4))
    model = StateSpace(A, B, C, Q=1e-3 * np.eye(4), R=0.05 * np.eye(channels), dt=1)
    record = simulate(model, np.repeat(rng.normal(size=(T // 5, channels)), 5, axis=0), seed=4).record
    u = np.where(rng.random(record.u.shape) < missing, np.nan, record.u)
    return Record(record.y, u, dt=1)


def output_error(name, T):
    """OutputErrorML(2, 1, delay=1), without a level; the error is the largest of a parameter, in our standard errors."""
    plant = OutputError([-1.5, 0.7], [1.0, 0.5], delay=1, noise_variance=0.1, dt=1)
    record = simulate(plant, np.random.default_rng(5).normal(size=T), seed=6).record
    seconds, first, fit = best(lambda: identify(OutputErrorML(2, 1, delay=1, level="none", initial="rest"), record), 9)
    yield row(name, "estimable OutputErrorML", seconds, first, 0.0)
    seconds, first, found = best(lambda: _differences(record), 9)
    error = float(np.abs((found - fit.parameters) / fit.sigma).max())
    yield row(name, "SciPy least squares on finite differences, by lfilter", seconds, first, error, whose="library")


def _differences(record):
    """(a1, a2, b0, b1), from the least-squares ARX model."""
    y, u = record.y[:, 0], record.u[:, 0]
    lagged = np.stack([-y[1:-1], -y[:-2], u[1:-1], u[:-2]], 1)
    start = np.linalg.lstsq(lagged, y[2:], rcond=None)[0]
    return least_squares(lambda θ: lfilter([0.0, *θ[2:]], [1.0, *θ[:2]], u) - y, start, method="lm").x
