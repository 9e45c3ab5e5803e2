"""The start of the parameters of a nonlinear model: its tangent at equilibrium responds like a linear model of the record."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from .. import checks, forks
from ..data.record import Record
from ..errors import AssumptionError
from ..kernels.realisation import markov
from ..models.nonlinear_model import NonlinearModel
from ..models.prior import Prior
from ..models.state_space import StateSpace
from ..results import Check

LAGS = 30  # at which the responses are compared, spread evenly in their logarithm
GONE = 0.05  # of a response: lags after this are not compared
UNDETERMINED = 1e-8  # eigenvalue of the scaled information of the parameters, below which a direction is undetermined
REST = 1e-6  # of the size of a state: its largest change in a second (or a step) at equilibrium


class Start(NamedTuple):
    """The start of the parameters (a `Prior`), the `linear` model behind it, and the checks made."""

    parameters: Prior
    linear: StateSpace | None
    checks: tuple[Check, ...] = ()


def levels(records: Sequence[Record]) -> tuple[np.ndarray, np.ndarray]:
    """Means of the inputs and outputs over the known samples."""
    u, y = (np.concatenate([get(one) for one in records]) for get in (lambda r: r.applied(), lambda r: r.y))
    return tuple(np.nansum(one, axis=0) / np.maximum((~np.isnan(one)).sum(axis=0), 1) for one in (u, y))  # type: ignore


def deviation(record: Record, about: tuple[np.ndarray, np.ndarray]) -> Record:
    """The record about its levels, with the applied inputs."""
    u, y = record.applied() - about[0], record.y - about[1]
    return Record(y, u, dt=record.dt, inputs=record.inputs, outputs=record.outputs)


def at_rest(model: NonlinearModel, x: np.ndarray, u: np.ndarray, θ: np.ndarray) -> tuple[np.ndarray, float]:
    """The state nearest to x where the model moves least under a constant input, and its relative motion there."""
    from scipy.optimize import least_squares

    size, free = np.maximum(np.abs(x), 1.0), 0.0 if model.is_continuous else 1.0

    def moved(z: np.ndarray) -> np.ndarray:
        to = np.asarray(_value(model.f, size * z, u, θ)) - free * size * z
        return np.nan_to_num(to / size, nan=1e6, posinf=1e6, neginf=-1e6)

    found = least_squares(moved, x / size, xtol=1e-12, ftol=1e-12, gtol=1e-12)
    return size * found.x, float(np.abs(moved(found.x)).max())


@forks.jit(static_argnums=0)
def _value(f: Callable, x: np.ndarray, u: np.ndarray, θ: np.ndarray) -> Any:
    return f(x, u, θ)


def response(model: StateSpace, lags: np.ndarray, dt: float, hold: str) -> np.ndarray:
    """The impulse response at the lags, output by output, input by input, of the model sampled like the record."""
    A, B, C, D = model.A, model.B, model.C, model.D
    if model.is_continuous:
        sampled = model.discretise(dt, hold=hold)
        A, B = sampled.A, sampled.B
        if sampled.B_end is not None:  # u[k+1] enters x[k+1]: with ξ = x - B_end u, u[k] enters ξ[k+1] and y[k]
            B, D = B + A @ sampled.B_end, D + C @ sampled.B_end
    return markov(A, B, C, D, int(lags[-1]))[lags].transpose(1, 2, 0)


def compared_lags(linear: StateSpace, rows: int) -> np.ndarray:
    """Lags from 0 to where the response of a linear model has died out, or a quarter of the record."""
    radius = float(np.abs(np.linalg.eigvals(linear.A)).max(initial=0.0))
    last = np.log(GONE) / np.log(radius) if 0 < radius < 1 else np.inf
    last = int(max(2 * linear.n, min(last, rows // 4)))
    return np.unique(np.r_[0, np.round(np.geomspace(1, last, LAGS)).astype(int)])


def matched(
    model: NonlinearModel, linear: StateSpace, rest: np.ndarray, record: Record, prior: Prior | None, accuracy: float,
    u: np.ndarray,
) -> Start:  # fmt: skip
    """The parameters with which the tangent at equilibrium responds like `linear`, to `accuracy` of its largest entries."""
    from scipy.optimize import least_squares

    lags = compared_lags(linear, len(record))
    wanted = response(linear, lags, float(record.dt or 0.0), record.hold)
    size = np.maximum(np.abs(wanted).max(axis=2, keepdims=True), 1e-3 * np.abs(wanted).max())
    σ = accuracy * size * np.sqrt(len(lags))  # errors are similar at all lags: together they count as one
    centre = model.parameters if prior is None else prior.mean
    scale = np.maximum(np.abs(centre), 1.0) if prior is None else np.sqrt(np.diagonal(prior.covariance))
    free = np.flatnonzero(scale > 0)
    white = None if prior is None else _white(prior.covariance[np.ix_(free, free)])
    where: dict[str, Any] = {"x": rest}

    def residual(z: np.ndarray) -> np.ndarray:
        θ = centre.copy()
        θ[free] += scale[free] * z
        where["x"], where["moves"] = at_rest(model, where["x"], u, θ)
        tangent = model.linearised(where["x"], u, parameters=θ)
        error = ((response(tangent, lags, float(record.dt or 0.0), record.hold) - wanted) / σ).ravel()
        error = np.nan_to_num(np.clip(error, -1e6, 1e6), nan=1e6)
        return error if white is None else np.r_[error, white @ (scale[free] * z)]

    found = least_squares(residual, np.zeros(len(free)), diff_step=1e-6)
    J = found.jac / scale[free]
    names = [model.parameter_names[i] for i in free]
    mean, covariance = centre.copy(), np.zeros((len(centre), len(centre)))
    mean[free] += scale[free] * found.x
    covariance[np.ix_(free, free)] = _inverse(J, scale[free], names)
    misfit = float(np.sqrt(np.mean((residual(found.x)[: wanted.size].reshape(wanted.shape) * σ / size) ** 2)))
    start_checks = (_response_check(misfit, accuracy), _rest_check(where["moves"], model.is_continuous))
    return Start(Prior(mean, covariance), linear, start_checks)


def _white(P: np.ndarray) -> np.ndarray:
    """W with W P W' = I."""
    return np.linalg.inv(np.linalg.cholesky(P)) if len(P) else P


def _inverse(J: np.ndarray, scale: np.ndarray, names: Sequence[str]) -> np.ndarray:
    """The covariance of the matched parameters; an error where the response does not determine one."""
    values, vectors = np.linalg.eigh((J * scale).T @ (J * scale))
    if len(values) and values[0] <= UNDETERMINED * max(values[-1], 1.0):
        weights = vectors[:, 0] * np.sign(vectors[np.argmax(np.abs(vectors[:, 0])), 0])
        words = " ".join(f"{w:+.2f} {name}" for w, name in zip(weights, names, strict=True) if abs(w) > 0.05).lstrip(
            "+"
        )
        raise AssumptionError(
            f"the linear model of the record does not determine {words}: at equilibrium the model's response does not depend "
            "on it. Give `parameters`, a Prior of their values."
        )
    return (vectors * scale[:, None]) @ np.diag(1 / values) @ (vectors * scale[:, None]).T


def _response_check(misfit: float, accuracy: float) -> Check:
    found = f"Start: the responses of the model's tangent and of the linear model differ by {100 * misfit:.0f} % of their size"
    if misfit <= 2 * accuracy:
        return Check("start", True, misfit, 2 * accuracy, f"{found}.")
    advice = (
        "the model does not have the dynamics of the record, or the record leaves the neighbourhood of the equilibrium"
    )
    return Check("start", False, misfit, 2 * accuracy, f'{found}: {advice}. Give `parameters`, or start = "none".')


def _rest_check(moves: float, continuous: bool) -> Check:
    unit = "second" if continuous else "step"
    found = f"Rest: under the mean input the model moves by at least {moves:.1g} of its state per {unit}"
    advice = "" if moves <= REST else ": the tangent there is not about an equilibrium"
    return Check("rest", moves <= REST, moves, REST, f"{found}{advice}.")


def order_check(order: int, n: int) -> Check:
    """Check that the record shows no more modes than the model has states."""
    found = f"Order: a linear model of the record needs {checks.counted(order, 'state')} (BIC), and this one has {n}"
    advice = "" if order <= n else ": it lacks some dynamics, or extra states imitate a nonlinearity of the record"
    return Check("order", order <= n, float(order), float(n), f"{found}{advice}.")
