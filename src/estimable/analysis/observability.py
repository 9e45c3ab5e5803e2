"""The directions of the state that outputs show, and those that inputs or noise reach."""

from typing import Any

import numpy as np

from .. import checks
from ..errors import AssumptionError
from ..kernels.echelon import echelon
from ..kernels.reach import ZERO, Reach, reach, reachability_matrix
from ..kernels.riccati import clyap, dlyap
from ..models.state_space import StateSpace
from ..results import Observability, Reachability
from .estimability import read_horizon
from .gramians import balancing_units, effects
from .moments import rank
from .tolerance import check_size, judged


def observability(model: StateSpace, *, horizon: float | None = None) -> Observability:
    """Whether the outputs, without noise, show every direction of the state. The model may be unstable.

    `horizon`: the number of samples to judge by (seconds where dt = 0). None: no limit; a model that varies in time is judged
    over its rows. Noise is ignored here, except that R gives the unit of each sensor; `estimability` includes it.

    Returns an `Observability`. Raises `InputError` for a horizon that is not positive, and for more than 500 states.

    Cost: about 100 n³ multiplications.

    Reference: T. Kailath, Linear Systems (1980), §2.4 and §6.2; P. Van Dooren, IEEE TAC 26 (1981) 111 (staircase).

    >>> seen = observability(StateSpace([[0.5, 0.0], [0.0, 1.2]], C=[[1.0, 0.0]], dt=1))
    >>> seen.observable, seen.detectable, seen.sentences[0]
    (False, False, 'x2 never shows in y1.')
    """
    A, C, until, _ = _read(model, "C", horizon)
    found = _structure(
        model, np.swapaxes(A, -1, -2), np.swapaxes(C, -1, -2), until, reverse=True, units=_sensors(model)
    )
    return Observability(**found, states=model.states, channels=model.outputs, horizon=until)


def reachability(model: StateSpace, *, horizon: float | None = None, by: str = "inputs") -> Reachability:
    """Whether the inputs can move the state in every direction. With `by="noise"`: whether the process noise moves it.

    Reachability by noise is the reachability of (A, G Q); Bryson calls it disturbability. `horizon`, errors, cost and
    reference are those of `observability`. Returns a `Reachability`.

    >>> moved = reachability(StateSpace([[0.5, 0.0], [0.0, 0.2]], [[1.0], [0.0]], dt=1))
    >>> moved.reachable, moved.stabilisable, moved.sentences[0]
    (False, True, 'x2 is not moved by u1.')
    """
    faults = checks.Faults()
    faults.choice("by", by, ("inputs", "noise"))
    faults.finish()
    A, _, until, M = _read(model, by, horizon)
    found = _structure(model, A, M, until)
    channels = model.inputs if by == "inputs" else ("process noise",)
    return Reachability(**found, states=model.states, channels=channels, horizon=until)


def _read(model: StateSpace, which: str, horizon: float | None):
    """A, C, the horizon, and the matrix by which inputs or noise move the state."""
    faults = checks.Faults()
    if faults.instance("model", model, StateSpace):
        horizon = read_horizon(model, horizon, faults)
        check_size(model.n, faults, steps=0 if horizon is None or model.is_continuous else int(horizon))
    faults.finish()
    return model.A, model.C, horizon, model.B if which == "inputs" else noise_factor(model)


def _sensors(model: StateSpace) -> np.ndarray:
    """The unit of each sensor: the sigma of its noise where all have one."""
    R = np.zeros((model.p, model.p)) if model.R is None else np.asarray(model.R).reshape(-1, model.p, model.p)[0]
    σ = np.sqrt(np.diagonal(R))
    return σ if np.all(σ > 0) else np.ones(model.p)


def noise_factor(model: StateSpace) -> np.ndarray:
    """G Q^(1/2): the effect of unit white noise."""
    λ, V = np.linalg.eigh(model.Q)
    return model.G @ (V * np.sqrt(np.maximum(λ, 0.0))[..., None, :])


def _structure(
    model: StateSpace,
    F: np.ndarray,
    M: np.ndarray,
    horizon: float | None,
    *,
    reverse: bool = False,
    units: np.ndarray | float = 1.0,
) -> dict[str, Any]:
    """The fields of a verdict on the pair (F, M), whose columns are judged in `units`."""
    if horizon is not None:
        Γ, judged_Γ = (effects(F, X, horizon, continuous=model.is_continuous, reverse=reverse) for X in (M, M / units))
        T = np.sqrt(np.maximum(np.diagonal(judged_Γ @ judged_Γ.T), 0.0))
        T = np.where(T > 0, T, 1.0)
        found, hidden = rank(judged_Γ / T[:, None]), np.zeros(0)
        unstable = found.Z[:, :0]
    else:
        Γ, M = reachability_matrix(F, M), M / units
        T = balancing_units(F, M)
        scaled = F * (T / T[:, None])
        found = reach(scaled, M / T[:, None]) if M.shape[1] else Reach(np.eye(len(F)), 0.0)
        hidden, unstable = _hidden(scaled, found.Z, model.is_continuous)
    σ = np.linalg.svd(Γ, compute_uv=False) if Γ.shape[1] else np.zeros(0)
    return {
        "verdict": judged(found.distance),
        "distance": found.distance,
        "singular_values": np.pad(σ, (0, len(T) - len(σ)))[: len(T)],
        "gramian": Γ @ Γ.T if horizon is not None else _gramian(F, M * units, model.is_continuous),
        "directions": echelon(found.Z / T[:, None]).T,
        "hidden_modes": hidden,
        "unstable_directions": echelon(unstable / T[:, None]).T,
    }


def _gramian(F: np.ndarray, M: np.ndarray, continuous: bool) -> np.ndarray | None:
    """The Gramian over an unlimited horizon; None where it is infinite."""
    try:
        return (clyap if continuous else dlyap)(F, M @ M.T)
    except AssumptionError:
        return None


def _hidden(F: np.ndarray, Z: np.ndarray, continuous: bool) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues of the hidden part, and the part of Z that does not decay."""
    from scipy.linalg import schur

    if Z.shape[1] == 0:
        return np.zeros(0), Z

    def lasting(re: float, im: float) -> bool:
        return re >= -ZERO if continuous else float(np.hypot(re, im)) >= 1 - ZERO

    found: Any = schur(Z.T @ F.T @ Z, sort=lasting)
    T, U, growing = found
    return np.linalg.eigvals(T), Z @ U[:, :growing]
