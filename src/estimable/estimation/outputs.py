"""The outputs of a result: what the estimated states say that the sensors should show, without their noise.

y_f = C x + D u (+ operating point); with P the joint covariance of state and gain, J = [C, D_1 u, .. D_g u], its covariance is
J P J'. Of a nonlinear model y_f = h(x, u, θ), and J the tangent of h.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import jax
import numpy as np

from .. import checks, forks
from ..data.record import Record
from ..filters.unknown_gain import UnknownGain
from ..models import angles
from ..models.nonlinear_model import NonlinearModel
from ..models.sampled import point_of
from ..models.state_space import StateSpace
from ..protocols import Algorithm
from ..results import Names, Outputs
from .binding import columns
from .following import along_record

INFINITE = 1e-12  # of the largest diffuse variance of a row: rounding in a direction that is known


class Estimated(Protocol):
    """What the outputs need of a result."""

    origin: Any
    names: Names

    @property
    def mean(self) -> Any:
        """(T, n)."""

    @property
    def covariance(self) -> Any:
        """(T, n, n)."""

    @property
    def gain(self) -> Any:
        """(T, g)."""

    @property
    def gain_covariance(self) -> Any:
        """(T, g, g)."""

    @property
    def diffuse_covariance(self) -> Any:
        """(T, n, n)."""

    @property
    def extra(self) -> Any:
        """By name."""


class _Rows(NamedTuple):
    """y_f (T, p), J in parts of state (T, p, n) and gain (T, p, g), and R (T, p, p) or (p, p)."""

    mean: np.ndarray
    C: np.ndarray
    D: np.ndarray
    R: np.ndarray


def outputs_of(result: Estimated, predictive: bool) -> Outputs:
    """The outputs of each row and their covariances, with the sensor noise if `predictive`; None where there is no model.

    C, D and R do not depend on the steps, so that the model is that of the record and not the sampled one.
    """
    origin, nothing = result.origin, Outputs(None, None)
    if origin is None or result.mean is None:
        return nothing
    inner = along_record(origin.algorithm, origin.record).innermost
    model = inner.model
    u = _inputs(inner, origin.record, result)
    if isinstance(model, NonlinearModel):
        rows = _nonlinear(model, u, result)
    elif isinstance(model, StateSpace) and model.R is not None:
        blocks = inner.in_blocks() if isinstance(inner, UnknownGain) else model  # [D_0 D_1 ..] side by side
        rows = _linear(blocks, u, result, len(origin.record))
    else:
        return nothing
    P = None if rows is None else _covariance(rows, result)
    if rows is not None and P is not None and predictive:
        P = P + _noise(rows.R, inner, origin.record, result)
    if rows is None:
        return nothing
    if P is not None:  # an input that was not recorded and enters y directly
        unknown = np.isnan(rows.mean)
        P = np.where(unknown[..., None] | unknown[..., None, :], np.nan, P)
    return Outputs(np.asarray(angles.ranged(rows.mean, result.names.angles, result.names.outputs)), P)


def _last(values: np.ndarray, result: Estimated) -> np.ndarray:
    """The rows that the result holds: all, or the last."""
    return values[len(values) - len(result.mean) :]


def _inputs(inner: Algorithm[Any], record: Record, result: Estimated) -> np.ndarray:
    """The inputs at the rows of the result, in the order of the model; positions of actuators where the filter knows them."""
    if (position := result.extra.get("position")) is not None:
        return np.asarray(position)
    faults = checks.Faults()
    some = columns(inner.names.inputs, record.inputs, "input", "u", faults)
    faults.finish()
    return _last(record.applied()[:, some], result)


def _noise(R: np.ndarray, inner: Algorithm[Any], record: Record, result: Estimated) -> np.ndarray:
    """R of each row, with the standard deviations that the record gives and the correlations of the model."""
    if record.sigma is None:
        return R
    faults = checks.Faults()
    some = columns(inner.names.outputs, record.outputs, "output", "y", faults)
    faults.finish()
    sigma = _last(record.sigma[:, some], result)
    own = np.sqrt(np.diagonal(R, axis1=-2, axis2=-1)) * np.ones_like(sigma)
    scale = np.where(np.isnan(sigma) | (own == 0), 1.0, sigma / np.where(own > 0, own, 1.0))
    alone = np.where((own == 0) & ~np.isnan(sigma), sigma, 0.0)[..., None] ** 2 * np.eye(sigma.shape[1])
    return R * scale[..., None] * scale[..., None, :] + alone


def _linear(model: StateSpace, u: np.ndarray, result: Estimated, T: int) -> _Rows | None:
    """The rows of a linear model, with [D_0 D_1 ..] side by side; None where an unmeasured input enters y at once."""
    g = 0 if result.gain is None else result.gain.shape[1]
    C, D, R = (_last(_over_time(model, name, T), result) for name in ("C", "D", "R"))
    point, m = point_of(model), u.shape[1]
    if D.shape[-1] != m * (1 + g) or not np.any(D):
        if np.any(D):
            return None
        effects = np.zeros((*D.shape[:-1], 1 + g))
    else:
        du = u - point.inputs[:m]
        effects = np.einsum("tpgm,tm->tpg", D.reshape(*D.shape[:-1], 1 + g, m), du)
    mean = np.einsum("tpn,tn->tp", C, result.mean - point.states) + point.outputs + effects[..., 0]
    if result.gain is not None:
        mean = mean + np.einsum("tpg,tg->tp", effects[..., 1:], result.gain)
    return _Rows(mean, C, effects[..., 1:], R)


def _over_time(model: StateSpace, name: str, T: int) -> np.ndarray:
    """A matrix of each row."""
    M = np.asarray(getattr(model, name))
    return M if name in model.varying else np.broadcast_to(M, (T, *M.shape))


def _nonlinear(model: NonlinearModel, u: np.ndarray, result: Estimated) -> _Rows:
    """y_f = h at the estimate, and its tangent."""
    free = result.gain is not None
    θ = (
        result.gain
        if free
        else np.broadcast_to(np.asarray(model.parameters, float), (len(u), np.size(model.parameters)))
    )
    y, (C, D) = (jax.tree_util.tree_map(np.asarray, one) for one in _tangents(model.h, result.mean, u, θ))
    return _Rows(y, C, D if free else D[..., :0], np.asarray(model.R))


@forks.jit(static_argnums=0)
def _tangents(h: Callable, x: np.ndarray, u: np.ndarray, θ: np.ndarray) -> Any:
    return jax.vmap(h)(x, u, θ), jax.vmap(jax.jacfwd(h, argnums=(0, 2)))(x, u, θ)


def _covariance(rows: _Rows, result: Estimated) -> np.ndarray | None:
    """J P J'; NaN where it is infinite, None where the joint covariance is not known."""
    if result.covariance is None:
        return None
    P = rows.C @ result.covariance @ np.swapaxes(rows.C, -1, -2)
    if np.any(rows.D):
        cross = result.extra.get("state_gain_covariance")
        if cross is None or result.gain_covariance is None:
            return None
        both = rows.C @ cross @ np.swapaxes(rows.D, -1, -2)
        P = P + both + np.swapaxes(both, -1, -2) + rows.D @ result.gain_covariance @ np.swapaxes(rows.D, -1, -2)
    if result.diffuse_covariance is not None:
        spread = np.diagonal(rows.C @ result.diffuse_covariance @ np.swapaxes(rows.C, -1, -2), axis1=-2, axis2=-1)
        largest = np.diagonal(result.diffuse_covariance, axis1=-2, axis2=-1).max(axis=-1, keepdims=True)
        infinite = spread > INFINITE * largest
        P = np.where(infinite[..., None] | infinite[..., None, :], np.nan, P)
    return (P + np.swapaxes(P, -1, -2)) / 2
