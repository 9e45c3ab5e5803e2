"""Feedback and estimator designed for a disturbance of known form. C. D. Johnson.

Letters of the source: d = H z enters by F, Γ cancels it; Π z is the steady state under z.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple, TypeGuard

import numpy as np

from .. import checks
from ..analysis.observability import observability, reachability
from ..annotations import Numbers
from ..errors import AssumptionError
from ..models.constant import check_constant, check_noise
from ..models.discretisation import over
from ..models.state_space import StateSpace
from ..results import DisturbanceAccommodation, FeedbackGain
from .gains import kalman_gain, lqr_gain
from .waveforms import Waveform

MODES = ("absorption", "minimisation", "utilisation")
SAME = 1e-12  # of the fastest: nearer eigenvalues count as equal
OUTSIDE = 1e-9  # of F H: a smaller part outside the range of B is rounding


class _Plan(NamedTuple):
    """The checked arguments of a call. `C`: the combinations of states to be freed."""

    FH: Any
    D: Any
    C: Any
    composite: StateSpace


def disturbance_accommodation(
    model: StateSpace,
    disturbance: Waveform,
    *,
    through: Numbers,
    L: Numbers,
    M: Numbers,
    mode: str = "absorption",
    walk: Numbers = 1.0,
    freed: Sequence[str] | Numbers | None = None,
) -> DisturbanceAccommodation:
    """Design a loop that estimates a disturbance of known form together with the state, and acts on that estimate.

    Model: dx/dt = A x + B u + F d + G w, with the disturbance d = H z and dz/dt = D z + noise. For a discrete model d is held
    over a sample. The law is u = -K x^ - K_z z^, from the estimates x^ and z^ of a Kalman filter. K is that of `lqr_gain`.

    `mode` selects K_z:

    - "absorption": cancels the disturbance, B K_z = F H. It never reaches the state. It must enter where inputs do.
    - "minimisation": minimises the effect of z on the freed outputs. No effect is left where the regulator equations
      Π D = A Π + B Γ + F H, C Π = 0 have a solution (Π, Γ).
    - "utilisation": minimises the same cost as K. The law then uses the disturbance where it helps.

    `disturbance`: a `Waveform` (D, H). `through` F (n, d): how it enters the state. L (n, n) and M (m, m): the weights of
    state and input, as in `lqr_gain`. `walk`: the variance per second of the noise that moves z, one number, (q,) or (q, q);
    with a larger value the estimate follows jumps sooner. `freed`: the outputs that "minimisation" frees from z, by name, or
    combinations of states as a matrix (r, n); None: all outputs.

    Returns a `DisturbanceAccommodation`. Raises `InputError`. Raises `AssumptionError` where "absorption" meets a disturbance
    outside the range of B (the message gives the share outside), where the outputs do not distinguish the disturbance from
    the state, or where the disturbance grows faster than the loop decays.

    Cost: that of two Riccati equations and of a linear system with (n q)² entries.

    Reference: C. D. Johnson, IEEE TAC 16 (1971) 635; B. A. Francis, SIAM J. Control Optim. 15 (1977) 486
    (regulator equations).

    >>> cart = StateSpace([[1.0]], [[1.0]], [[1.0]], Q=[[0.01]], R=[[0.1]], dt=1)
    >>> found = disturbance_accommodation(cart, Waveform.constant(), through=[[2.0]], L=[[1.0]], M=[[1.0]])
    >>> found.feedback.round(6).tolist()
    [[0.618034, 2.0]]
    """
    plan = _read(model, disturbance, through, mode, walk, freed)
    law = lqr_gain(model, L, M)
    _check_distinguished(model, plan)
    K, A = law.feedback, model.A - model.B @ law.feedback
    if mode == "absorption":
        K_z = _absorbing(model, plan)
    elif mode == "minimisation":
        K_z = _freeing(model, plan, A)
    else:
        K_z = _using(model, plan, law, A, np.asarray(M))
    Π = _steady(A, plan, plan.FH - model.B @ K_z)
    size = max(float(np.abs(plan.C).max() * np.abs(_steady(A, plan, plan.FH)).max()), 1e-300)
    left = plan.C @ Π
    left = np.where(np.abs(left) < OUTSIDE * size, 0.0, left)
    return DisturbanceAccommodation(
        plan.composite, np.hstack([K, K_z]), kalman_gain(plan.composite), Π, left, law.poles, mode
    )


def _read(
    model: StateSpace,
    disturbance: Waveform,
    through: Numbers,
    mode: str,
    walk: Numbers,
    freed: Sequence[str] | Numbers | None,
) -> _Plan:
    faults = checks.Faults()
    if faults.instance("model", model, StateSpace):
        check_constant(model, faults)
        check_noise(model, faults)
        if model.m == 0:
            faults.add("`model` has no input: give B, StateSpace(A, B, ...).")
        if model.operating_point is not None:
            faults.add("`model` must have no `operating_point`: leave it out, and give deviations from it.")
    faults.instance("disturbance", disturbance, Waveform, " For example Waveform.constant().")
    faults.choice("mode", mode, MODES)
    faults.finish()
    faults.learn("n", model.n, f"the model has {checks.counted(model.n, 'state')}")
    faults.learn("d", disturbance.channels, f"the waveform has {checks.counted(disturbance.channels, 'channel')}")
    faults.learn("q", disturbance.order, f"the waveform has {checks.counted(disturbance.order, 'state')}")
    F, W, C = (
        faults.array("through", through, "n d"),
        _read_walk(walk, disturbance, faults),
        _read_freed(freed, model, faults),
    )
    faults.finish()
    return _Plan(F @ disturbance.H, *_sampled(disturbance.D, model.dt), C, _composite(model, disturbance, F, W))


def _read_walk(walk: Numbers, disturbance: Waveform, faults: checks.Faults) -> Any:
    """The covariance per second of z, (q, q)."""
    if checks.depth(walk) >= 2:
        return faults.covariance("walk", walk, "q q")
    given = np.asarray(walk)
    if given.dtype.kind in "fiu" and given.shape in ((), (disturbance.order,)):
        given = given * np.eye(disturbance.order)
    return faults.covariance("walk", given, "q q")


def _read_freed(freed: Sequence[str] | Numbers | None, model: StateSpace, faults: checks.Faults) -> Any:
    """The combinations of states to be freed, (r, n)."""
    if freed is None:
        return model.C
    if not _are_names(freed):
        return faults.array("freed", freed, "r n")
    for name in freed:
        if name not in model.outputs:
            near = checks.suggestion(name, model.outputs)
            faults.add(f"`freed`: there is no output {name!r}. There are {checks.listed(model.outputs)}.{near}")
    return model.C[[model.outputs.index(name) for name in freed if name in model.outputs]]


def _are_names(freed: Sequence[str] | Numbers) -> TypeGuard[Sequence[str]]:
    return checks.depth(freed) == 1 and all(isinstance(name, str) for name in np.asarray(freed, object).tolist())


def _sampled(D: np.ndarray, dt: float) -> tuple[Any]:
    """The dynamics of z: its rate, or its step."""
    return (D,) if dt == 0 else (over(D, np.zeros((len(D), 0)), np.zeros_like(D), dt, hold="zero_order")[0],)


def _composite(model: StateSpace, disturbance: Waveform, F: np.ndarray, W: np.ndarray) -> StateSpace:
    """Plant and waveform as one model."""
    n, q, (D,) = model.n, disturbance.order, _sampled(disturbance.D, model.dt)
    if not model.is_continuous:
        W = over(disturbance.D, np.zeros((q, 0)), W, model.dt, hold="zero_order")[3]
    noises = model.Q.shape[0]
    S = None if model.S is None else np.vstack([model.S, np.zeros((q, model.p))])
    return StateSpace(
        np.block([[model.A, F @ disturbance.H], [np.zeros((q, n)), D]]), np.vstack([model.B, np.zeros((q, model.m))]),
        np.hstack([model.C, np.zeros((model.p, q))]), model.D,
        Q=np.block([[model.Q, np.zeros((noises, q))], [np.zeros((q, noises)), W]]), R=model.R, S=S,
        G=np.block([[model.G, np.zeros((n, q))], [np.zeros((q, noises)), np.eye(q)]]), dt=model.dt,
        states=(*model.states, *_names(q, model.states)), inputs=model.inputs, outputs=model.outputs,
    )  # fmt: skip


def _names(q: int, taken: tuple[str, ...]) -> list[str]:
    """z1, z2, ..; disturbance1, .. where the plant already has such states."""
    stem = "disturbance" if any(f"z{i + 1}" in taken for i in range(q)) else "z"
    return [f"{stem}{i + 1}" for i in range(q)]


def _check_distinguished(model: StateSpace, plan: _Plan) -> None:
    """Check that the outputs distinguish z from x: no eigenvalue of D at an invariant zero of (A, F H, C)."""
    plant = observability(model)
    if not plant.detectable:
        raise AssumptionError(
            f"`model` is not detectable: no output shows a mode that does not decay. {' '.join(plant.sentences)}"
        )
    both = observability(plan.composite)
    if not both.detectable:
        raise AssumptionError(
            "the outputs do not distinguish the disturbance from the state: measure more, or use a simpler waveform. "
        )
    moved = reachability(plan.composite, by="noise")
    if not moved.stabilisable:
        raise AssumptionError(
            f"the gain of the estimator would vanish: give every part of the disturbance that does not decay a `walk` > 0. "
            f"{' '.join(moved.sentences)}"
        )


def _absorbing(model: StateSpace, plan: _Plan) -> Any:
    """K_z with B K_z = F H."""
    size = np.abs(np.hstack([model.B, plan.FH])).max(axis=1, keepdims=True)  # independent of the units of the states
    B, FH = (M / np.where(size > 0, size, 1.0) for M in (model.B, plan.FH))
    K_z = np.linalg.lstsq(B, FH, rcond=None)[0]
    outside = np.linalg.norm(FH - B @ K_z) / np.linalg.norm(FH) if FH.any() else 0.0
    if outside > OUTSIDE:
        raise AssumptionError(
            f"the disturbance cannot be absorbed: {100 * outside:.3g} % of its effect is outside the range of `B`, where no "
            'input acts. Use mode="minimisation", which frees the outputs from it where possible.'
        )
    return K_z


def _steady(A: np.ndarray, plan: _Plan, E: np.ndarray) -> Any:
    """Π of Π D = A Π + E: the steady state x = Π z under a z that enters by E."""
    n, q = E.shape
    T = np.kron(plan.D.T, np.eye(n)) - np.kron(np.eye(q), A)
    z, w = np.linalg.eigvals(A), np.linalg.eigvals(plan.D)
    if np.abs(z[:, None] - w).min() < SAME * max(np.abs(z).max(), np.abs(w).max()):
        raise AssumptionError(
            "a pole of the loop equals an eigenvalue of the disturbance: choose other weights `L`, `M`."
        )
    return np.linalg.solve(T, E.T.ravel()).reshape(q, n).T


def _freeing(model: StateSpace, plan: _Plan, A: np.ndarray) -> Any:
    """The K_z with the least ||C Π||, which is linear in it; the smallest of several."""
    q, m = plan.FH.shape[1], model.m
    alone = (plan.C @ _steady(A, plan, plan.FH)).T.ravel()
    effects = []
    for i in range(m * q):
        unit = np.zeros((q, m))
        unit.flat[i] = 1.0
        effects.append((plan.C @ _steady(A, plan, model.B @ unit.T)).T.ravel())
    return np.linalg.lstsq(np.array(effects).T, alone, rcond=1e-12)[0].reshape(q, m).T


def _using(model: StateSpace, plan: _Plan, law: FeedbackGain, A: np.ndarray, M: np.ndarray) -> Any:
    """K_z of the cost's cross term x' P_xz z: A'P_xz + P_xz D + P_xx F H = 0, discrete P_xz = A'(P_xx F H + P_xz D)."""
    continuous, P = model.is_continuous, law.cost
    _check_forgotten(A, plan.D, continuous)
    n, q = plan.FH.shape
    both = np.kron(plan.D.T, np.eye(n)), np.kron(np.eye(q), A.T)
    T, E = (both[0] + both[1], -P @ plan.FH) if continuous else (np.eye(n * q) - both[1] @ both[0], A.T @ P @ plan.FH)
    P_xz = np.linalg.solve(T, E.T.ravel()).reshape(q, n).T
    if continuous:
        return np.linalg.solve(np.asarray(M, float), model.B.T @ P_xz)
    return np.linalg.solve(M + model.B.T @ P @ model.B, model.B.T @ (P @ plan.FH + P_xz @ plan.D))


def _check_forgotten(A: np.ndarray, D: np.ndarray, continuous: bool) -> None:
    slowest, fastest = np.linalg.eigvals(A), np.linalg.eigvals(D)
    if continuous:
        grows = float(slowest.real.max() + fastest.real.max())
    else:
        grows = float(np.log(np.abs(slowest).max() * np.abs(fastest).max() + 1e-300))
    if grows >= 0:
        raise AssumptionError(
            f"the disturbance grows faster than the loop decays (by {grows:.3g} per {'second' if continuous else 'sample'}), "
            "so that the cost of using it is infinite."
        )
