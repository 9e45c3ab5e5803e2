"""The outputs of a result: what the estimated states say that the sensors should show, without their noise.

y_f = C x + D u (+ operating point); with P the joint covariance of state and gain, J = [C, D_1 u, .. D_g u], its covariance is
J P J'. Of a nonlinear model y_f = h(x, u, θ), and J the tangent of h.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import jax
import numpy as np

from .. import forks
from ..filters.fixed_gain import FixedGain
from ..filters.kalman_filter import Kalman
from ..filters.unknown_gain import UnknownGain
from ..filters.unknown_input import UnknownInput
from ..models.nonlinear_model import NonlinearModel
from ..models.sampled import SampledModel
from ..results import Outputs
from .binding import Bound, bind, model_of

INFINITE = 1e-12  # of the largest diffuse variance of a row: rounding in a direction that is known


class Estimated(Protocol):
    """What the outputs need of a result."""

    origin: Any

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
    """The outputs of each row and their covariances, with the sensor noise if `predictive`; None where there is no model."""
    origin, nothing = result.origin, Outputs(None, None)
    if origin is None or result.mean is None:
        return nothing
    bound = bind(origin.algorithm, origin.record, origin.prior)
    model = model_of(origin.algorithm)
    rows = _nonlinear(bound, model, result) if isinstance(model, NonlinearModel) else _linear(bound, result)
    if rows is None:
        return nothing
    P = _covariance(rows, result)
    if P is not None and predictive:
        P = P + rows.R
    return Outputs(rows.mean, P)


def _last(values: np.ndarray, result: Estimated) -> np.ndarray:
    """The rows that the result holds: all, or the last."""
    return values[len(values) - len(result.mean) :]


def _linear(bound: Bound, result: Estimated) -> _Rows | None:
    """The rows of a linear model; None for an algorithm without one, or with an unmeasured input that enters y at once."""
    inner = bound.algorithm.innermost
    inner = inner.kalman if isinstance(inner, FixedGain) else inner
    ready = inner.ready if isinstance(inner, Kalman | UnknownGain | UnknownInput) else None
    if not isinstance(ready, SampledModel):
        return None
    T, g = len(bound.samples.y), 0 if result.gain is None else result.gain.shape[1]
    C, D, V = (_last(_over_time(ready, name, T), result) for name in "CDV")
    m = ready.point.inputs.shape[-1]
    u = _last(np.nan_to_num(np.asarray(bound.samples.u)), result)
    if D.shape[-1] != m * (1 + g) or u.shape[-1] != m:
        if np.any(D):
            return None
        D, u = np.zeros((*D.shape[:-1], m * (1 + g))), np.zeros((len(u), m))
    effects = np.einsum("tpgm,tm->tpg", D.reshape(*D.shape[:-1], 1 + g, m), u - ready.point.inputs)
    mean = np.einsum("tpn,tn->tp", C, result.mean - ready.point.states) + ready.point.outputs + effects[..., 0]
    if result.gain is not None:
        mean = mean + np.einsum("tpg,tg->tp", effects[..., 1:], result.gain)
    return _Rows(mean, C, effects[..., 1:], V @ np.swapaxes(V, -1, -2))


def _over_time(ready: SampledModel, name: str, T: int) -> np.ndarray:
    """A matrix of each row."""
    M = np.asarray(getattr(ready, name))
    if name not in ready.varying:
        return np.broadcast_to(M, (T, *M.shape))
    return M if ready.rows is None else M[np.asarray(ready.rows)]


def _nonlinear(bound: Bound, model: NonlinearModel, result: Estimated) -> _Rows:
    """y_f = h at the estimate, and its tangent."""
    u = _last(np.asarray(bound.samples.u), result)
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
