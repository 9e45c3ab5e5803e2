"""Smaller models with the same outputs."""

import numpy as np

from .. import checks
from ..errors import AssumptionError
from ..kernels.reach import complement, reach
from ..kernels.riccati import clyap, dlyap
from ..models.constant import check_constant, check_noise
from ..models.operating_point import OperatingPoint
from ..models.prior import Prior
from ..models.state_space import StateSpace
from ..results import Reduction
from .estimability import problem_of, refuse_unstable
from .gramians import balancing_units
from .moments import steady_predictor
from .observability import noise_factor
from .tolerance import check_size, scale

REMEDY = "method='minimal' needs none"
METHODS = ("output_process", "minimal", "balanced")


def reduce(model: StateSpace, *, method: str = "output_process", order: int | None = None) -> Reduction:
    """A model with fewer states and the same outputs, exactly or nearly.

    `method`:

    - "output_process": the smallest model whose outputs have the same covariances and the same response to the inputs. It
      keeps the states that are both estimable and observable. For discrete and stable models. The result is in innovations
      form, z[k+1] = A z[k] + B u[k] + G e[k], y[k] = C z[k] + D u[k] + e[k]. Start its Kalman filter from the `prior` of the
      result, and that of the full model from the stationary covariance: then both have the same innovations, and the
      predicted z is `to` times the predicted x.
    - "minimal": omits the states that neither inputs nor noise move, and those that no output shows. From a start at zero the
      outputs are the same for every sample path.
    - "balanced": preserves the `order` states with the largest Hankel singular values, which have the largest share in the
      effect of inputs and noise on the outputs. The error is at most twice the sum of the omitted singular values. For stable
      models.

    Returns a `Reduction`. Raises `InputError` for a model that varies in time, an unknown method, or an order that is not
    from 1 to n; `AssumptionError` for an unstable model where stability is needed.

    Cost: about 300 n³ multiplications.

    References: Y. Baram, T. Kailath, NASA TM-89427 (1987), Theorem 2.3; K. Glover, Int. J. Control 39 (1984) 1115 and U. M.
    Al-Saggaf, G. F. Franklin, IEEE TAC 32 (1987) 815 (the bound).

    >>> model = StateSpace([[0.7, -0.1], [1, 0]], C=[[1, -2]], G=[[1], [0]], Q=[[1]], R=[[0.3]], dt=1)
    >>> reduce(model).model.n
    1
    """
    faults = checks.Faults()
    known = faults.choice("method", method, METHODS)
    if faults.instance("model", model, StateSpace) and known:
        _check(model, method, order, faults)
    faults.finish()
    if method == "balanced":
        assert order is not None
        return _balanced(model, order)
    return _minimal(model) if method == "minimal" else _output_process(model)


def _check(model: StateSpace, method: str, order: int | None, faults: checks.Faults) -> None:
    check_constant(model, faults)
    check_size(model.n, faults)
    if method == "output_process":
        check_noise(model, faults)
        if model.is_continuous:
            faults.add(
                "the innovations form of a continuous model has cross noise, which `StateSpace` does not support: discretise it."
            )
    if method == "balanced":
        faults.whole("order", order, 1)
        if isinstance(order, int) and order > model.n:
            faults.add(f"`order` may be at most n = {model.n}, the states of the model. Got {checks.short(order)}.")
    elif order is not None:
        faults.add(
            f"`order` is only for method='balanced': {method!r} determines the order. Got {checks.short(order)}."
        )


def _output_process(model: StateSpace) -> Reduction:
    """Theorem 2.3: the part reached by past outputs or inputs, and of it the part that the outputs show."""
    refuse_unstable(model.A, False, REMEDY)
    problem = problem_of(model)
    F, Q, H, R, J = problem
    Π = dlyap(F, Q)
    P, K = steady_predictor(problem, Π)
    S = H @ P @ H.T + R
    D = scale(np.diagonal(Π))
    D = np.where(np.diagonal(Π) > 0, D, balancing_units(F, np.hstack([model.B, model.G])))
    estimable = complement(reach(F * (D / D[:, None]), np.hstack([F @ Π @ H.T + J, model.B]) / D[:, None]).Z)
    to, back = estimable.T / D, D[:, None] * estimable
    to, back = _shown(to @ F @ back, H @ back, to, back)
    G = to @ K
    small = _project(model, to, back, G=G, Q=S, R=S, S=S)
    Σ = dlyap(small.A, G @ S @ G.T) if len(to) else np.zeros((0, 0))
    return Reduction(small, to, back, _prior(model, to, Σ), 0.0, method="output_process")


def _minimal(model: StateSpace) -> Reduction:
    """The part that inputs or noise move, and of it the part that the outputs show."""
    moves = np.hstack([model.B, noise_factor(model)] + ([] if model.B_end is None else [model.B_end]))
    D = balancing_units(model.A, moves)
    moved = complement(reach(model.A * (D / D[:, None]), moves / D[:, None]).Z)
    to, back = moved.T / D, D[:, None] * moved
    to, back = _shown(to @ model.A @ back, model.C @ back, to, back)
    small = _project(model, to, back, G=to @ model.G, Q=model.Q, R=model.R, S=model.S)
    return Reduction(small, to, back, _stationary_prior(model, small, to), 0.0, method="minimal")


def _balanced(model: StateSpace, order: int) -> Reduction:
    """Square-root balancing: to = Σ^-1/2 U' Lo', back = Lc V Σ^-1/2 with Lo' Lc = U Σ V'."""
    refuse_unstable(model.A, model.is_continuous, REMEDY)
    lyapunov = clyap if model.is_continuous else dlyap
    moves = np.hstack([model.B, noise_factor(model)])
    Lc = _root(lyapunov(model.A, moves @ moves.T))
    Lo = _root(lyapunov(model.A.T, model.C.T @ model.C))
    U, σ, Vt = np.linalg.svd(Lo.T @ Lc)
    if σ[order - 1] <= 1e-14 * σ[0]:
        most = int(np.sum(σ > 1e-14 * σ[0]))
        checks.refuse(
            f"`order` may be at most {most}: the other Hankel singular values are zero to rounding. Got {order}."
        )
    root = np.sqrt(σ[:order])
    to, back = (U[:, :order] / root).T @ Lo.T, Lc @ Vt[:order].T / root
    small = _project(model, to, back, G=to @ model.G, Q=model.Q, R=model.R, S=model.S)
    prior = _stationary_prior(model, small, to)
    return Reduction(small, to, back, prior, 2 * float(σ[order:].sum()), σ, method="balanced")


def _shown(A: np.ndarray, C: np.ndarray, to: np.ndarray, back: np.ndarray):
    """The projection without the part that no output shows."""
    T = balancing_units(A.T, C.T)
    shown = complement(reach(A.T * (T / T[:, None]), C.T / T[:, None]).Z)
    return (shown.T * T) @ to, back @ (shown / T[:, None])


def _project(model: StateSpace, to: np.ndarray, back: np.ndarray, **noise: np.ndarray | None) -> StateSpace:
    """The model of z = to x; a single zero state where none is left."""
    if len(to) == 0:
        checks.refuse("the reduced model is empty: neither inputs nor noise move a state that an output shows.")
    point = model.operating_point
    return StateSpace(
        to @ model.A @ back, to @ model.B, model.C @ back, model.D, **noise,
        B_end=None if model.B_end is None else to @ model.B_end, dt=model.dt, inputs=model.inputs, outputs=model.outputs,
        operating_point=point and OperatingPoint(to @ point.states, point.inputs, point.outputs),
    )  # fmt: skip


def _prior(model: StateSpace, to: np.ndarray, Σ: np.ndarray) -> Prior:
    point = model.operating_point
    return Prior(np.zeros(len(to)) if point is None else to @ point.states, Σ)


def _stationary_prior(model: StateSpace, small: StateSpace, to: np.ndarray) -> Prior | None:
    try:
        return _prior(model, to, (clyap if small.is_continuous else dlyap)(small.A, small.G @ small.Q @ small.G.T))
    except AssumptionError:
        return None


def _root(X: np.ndarray) -> np.ndarray:
    """L with L L' = X, X positive semidefinite."""
    λ, V = np.linalg.eigh(X)
    return V * np.sqrt(np.maximum(λ, 0.0))
