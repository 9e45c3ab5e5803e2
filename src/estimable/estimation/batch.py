"""The initial state and the gains of a record by one least-squares fit."""

import numpy as np

from .. import checks
from ..data.record import Record
from ..filters.unknown_gain import UnknownGain
from ..kernels.batch_gain import BatchModel, batch_posterior
from ..models.prior import Prior
from ..models.sampled import SampledModel
from ..results import BatchGain
from .binding import bind

MOST = 6000  # numbers in the record: their covariance is 288 MB


def batch_gain(algorithm: UnknownGain, record: Record, *, prior: Prior) -> BatchGain:
    """The state x[0] and the constant gains of a whole record by weighted least squares, with the full covariance of the noise.

    - `algorithm`: an `UnknownGain` with constant gains, without forgetting, uncertainty, cross noise or diffuse priors.
    - `record` and `prior`: as in `estimate`, with at most 6,000 output values.

    The process noise of a row is in all later rows, so that the errors of the outputs are correlated. With their full covariance
    the gain and its variance are those of the recursive form in its last row, to rounding. (The source has the diagonal of it,
    which claims too little variance.) `estimate` is the better way to the same numbers; this form shares no recursion with it.

    Cost: a third of the cube of the number of output values.

    Returns a `BatchGain`. Raises `InputError` with every fault of the call.

    Reference: A. G. Sillence (1999), §4.4, (72)-(81).

    >>> model = StateSpace([[0.5]], [[1.0]], Q=[[0.1]], R=[[0.01]], dt=1)
    >>> algorithm, prior = UnknownGain(model, Prior([1.0], [[1.0]])), Prior([0.0], [[1.0]])
    >>> record = Record([0.0, 0.9, 1.4], [1.0, 1.0, 1.0], dt=1)
    >>> found = batch_gain(algorithm, record, prior=prior)
    >>> bool(np.isclose(found.gain[0], estimate(algorithm, record, prior=prior).gain[-1, 0]))
    True
    """
    _check(algorithm, prior)
    bound = bind(algorithm, record, prior)
    z = np.where(bound.samples.seen, bound.samples.y, np.nan)
    if z.size > MOST:
        checks.refuse(
            f"batch_gain takes records of at most {MOST:,} output values. This one has {z.size:,}: use estimate."
        )
    ready, p = bound.algorithm.ready, algorithm.gain.size
    point = ready.point
    rows = [_row(ready.at(k), bound.samples.u[k], bound.intervals.u_end[k], p) for k in range(len(z))]
    model = BatchModel(*(np.stack(part) for part in zip(*rows, strict=True)))
    n = model.A.shape[-1]
    start = bound.algorithm.init(prior)
    found = batch_posterior(np.asarray(start.mean), np.asarray(start.covariance), model, z)
    mean, covariance = found.mean, found.covariance
    return BatchGain(
        mean[:n] + point.states, covariance[:n, :n], mean[n:], covariance[n:, n:], found.noise_covariance, bound.names
    )


def _check(algorithm: UnknownGain, prior: Prior) -> None:
    checks.require(algorithm=(algorithm, UnknownGain), prior=(prior, Prior))
    faults = checks.Faults()
    for fault, words in (
        (np.any(algorithm.walk), "a `walk` of the gains"), (algorithm.forgetting != 1, "`forgetting` below 1"),
        (algorithm.uncertainty is not None, "`uncertainty`"), (algorithm.model.S is not None, "cross noise S"),
        (algorithm.gain.diffuse is not None or prior.diffuse is not None, "diffuse priors"),
    ):  # fmt: skip
        if fault:
            faults.add(f"batch_gain does not support {words}: use estimate, whose last row has the same gain.")
    faults.finish()


def _row(model: SampledModel, u: np.ndarray, u_end: np.ndarray, p: int) -> tuple[np.ndarray, ...]:
    """A, b, C, d, Q and R of a row."""
    b, d = _effects(model.B, u - model.point.inputs, p), _effects(model.D, u - model.point.inputs, p)
    if model.B_end is not None:
        b = b + _effects(model.B_end, u_end - model.point.inputs, p)
    d[:, 0] += model.point.outputs
    A, C, W, V = (np.asarray(M) for M in (model.A, model.C, model.W, model.V))
    return A, b, C, d, W @ W.T, V @ V.T


def _effects(blocks: np.ndarray, u: np.ndarray, p: int) -> np.ndarray:
    """[B0 u, B1 u, ..] from blocks side by side."""
    return np.asarray(blocks).reshape(len(blocks), 1 + p, len(u)) @ u
