"""The information in past outputs about the state: covariances before and after, and between state and outputs.

Letters of Baram & Kailath, NASA TM-89427 (1987): x+ = F x + w, y = H x + v, cov w = Q, cov v = R, cov(w, v) = J; Π the
covariance of the state, P of its error given all past outputs, N = Π H', and Γ = [.., F M, M] the covariances of the
state with each past output. Π, P and Π - P come from factors by their own recursions, never from a difference. Over a horizon
that grows, all is in a frame in which slow growth is not hidden by fast growth, z = Q'x (`canonical_correlations`).
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ..errors import AssumptionError
from ..kernels.canonical_correlations import Pairs, StateFactors, corrected, pairs
from ..kernels.growth_frame import growth_frame
from ..kernels.reach import ZERO, Reach, complement, reach, reachability_matrix
from ..kernels.riccati import care, clyap, dare, dlyap
from ..kernels.square_root_elements import lengths, lower
from ..kernels.step_factors import semidefinite_factor
from .tolerance import judged, scale

EVERY = 40  # states up to which the rank is computed after every step, and not only at the horizon
LARGEST = 1e140  # of a covariance: its square does not overflow
GROWTH = 1e3  # over the horizon, from which the frame of growth is used
SETTLED = 5000  # steps of the recursion where the Riccati equation cannot be solved


class Problem(NamedTuple):
    """The model as arrays, (.., ..) constant or (T, .., ..) with a leading axis of time."""

    F: np.ndarray
    Q: np.ndarray
    H: np.ndarray
    R: np.ndarray
    J: np.ndarray

    @property
    def steps(self) -> int | None:
        """The rows of a model in rows."""
        return next((len(M) for M in self if M.ndim == 3), None)

    def at(self, k: int) -> "Problem":
        """The matrices of step k; after the last row, those of the last."""
        return Problem(*(M if M.ndim == 2 else M[min(k, len(M) - 1)] for M in self))


class StateMoments(NamedTuple):
    """Π and P, the shares of each variance that past outputs explain, and that the present one explains too, Γ; the reached
    directions (Z / D are directions of x, D the scale of Π), and the canonical pairs of (Π - P, Π)."""

    Π: np.ndarray
    P: np.ndarray
    share: np.ndarray
    share_filter: np.ndarray
    Γ: np.ndarray
    predictor: Reach
    filter: Reach
    pairs: Pairs


def stationary(problem: Problem, *, continuous: bool) -> StateMoments:
    """In steady state, which a stable F has. Corollaries 2.1 and 2.3; the filter's verdict is (F, [N, M])."""
    F, Q, H, R, J = problem
    if continuous:
        Π = clyap(F, Q)
        M = Π @ H.T
        K = care(F.T, H.T, Q, R).K.T
        Σ = Σ_filter = clyap(F, K @ R @ K.T)
        P = Π - Σ
    else:
        Π = dlyap(F, Q)
        M = F @ Π @ H.T + J
        P, K = steady_predictor(problem, Π)
        Σ, Σ_filter = _explained(problem, P, K, dlyap)
    D, E = scale(np.diagonal(Π)), scale(np.diagonal(H @ Π @ H.T + (0 if continuous else R)))
    F_scaled, N, M_scaled = F * (D / D[:, None]), Π @ H.T / D[:, None] / E, M / D[:, None] / E
    predictor = reach(F_scaled, M_scaled)
    with_present = predictor if continuous else reach(F_scaled, np.hstack([N, M_scaled]))
    found = pairs(StateFactors(lower(_root(Π, D)), _root(P, D), _root(Σ, D)))
    share, present = (np.clip(np.diagonal(X) / D**2, 0.0, 1.0) for X in (Σ, Σ_filter))
    return StateMoments(Π, symmetric(P), share, present, reachability_matrix(F, M), predictor, with_present, found)


def _root(X: np.ndarray, D: np.ndarray) -> np.ndarray:
    """A factor of X, without what is rounding in units D."""
    λ, V = np.linalg.eigh(X / D[:, None] / D)
    return D[:, None] * V * np.sqrt(np.where(λ > ZERO * max(λ[-1], 0.0), λ, 0.0))


def over_steps(problem: Problem, Π: np.ndarray, steps: int) -> StateMoments:
    """After `steps` samples, from covariance Π before the first. Theorem 2.1; the rank is the least over k >= n.

    The filter's numbers also use the present sample. After the last row of a model in rows there is none: they are then
    those of the last sample. Where the model grows far, all covariances with outputs resemble the fastest mode, and the
    verdict is that of the canonical correlations.
    """
    n = len(Π)
    frames = Frames.over_steps(problem, steps)
    L = lower(frames.Q.T @ semidefinite_factor(Π))
    factors, Γ, Γ_scaled = StateFactors(L, L, np.zeros((n, 0))), np.zeros((n, 0)), np.zeros((n, 0))
    worst, last, present = Reach(np.zeros((n, 0)), np.inf), problem.steps == steps, None
    for k in range(steps):
        F, Q, H, R, J = problem.at(k)
        if last and k + 1 == steps:
            present = _with_present(frames, factors, Γ_scaled, H, R)
        H = H @ frames.Q
        F, next_Q = frames.move(F)
        J, half = next_Q.T @ J, H @ factors.L
        _refuse_growth(F, factors.L, k)
        E = scale(np.sum(half**2, axis=1) + np.diagonal(R))
        M = F @ (factors.L @ half.T) + J
        Γ, Γ_scaled = compressed(M, F @ Γ), compressed(M / E, F @ Γ_scaled)
        factors = _predicted(factors, F, next_Q.T @ Q @ next_Q, H, R, J)
        if not frames.grows and (k + 1 == steps or (k + 1 >= n and n <= EVERY)):
            worst = min(worst, rank(Γ_scaled / _units(factors.L)[:, None]), key=lambda found: found.distance)
    if present is None:
        present = _with_present(frames, factors, Γ_scaled, problem.at(steps).H, problem.at(steps).R)
    found = in_states(pairs(factors), frames.Q)
    L, S, M = (frames.Q @ half for half in factors)
    if frames.grows:
        worst = by_correlation(found, _units(L))
    return StateMoments(L @ L.T, S @ S.T, shares(M, L), present[0], frames.Q @ Γ, worst, present[1], found)


class Frames:
    """Orthogonal Q of each instant: z = Q'x. For an F that grows far the growth frame, or A_k Q_k = Q_{k+1} R_k where F has rows;
    else the states themselves."""

    def __init__(self, Q: np.ndarray, T: np.ndarray | None, *, moving: bool = False):
        self.Q, self.T, self.moving = Q, T, moving

    @property
    def grows(self) -> bool:
        """Whether the model grows far."""
        return self.moving or self.T is not None

    @staticmethod
    def over_steps(problem: Problem, steps: int) -> "Frames":
        """For so many steps of a discrete model."""
        I = np.eye(problem.F.shape[-1])  # noqa: E741
        with np.errstate(over="ignore", invalid="ignore"):
            if problem.F.ndim == 2:
                if not np.abs(np.linalg.eigvals(problem.F)).max() ** steps > GROWTH:
                    return Frames(I, None)
                return Frames(*growth_frame(problem.F))
            Φ, largest = I, 1.0
            for k in range(steps):
                Φ = problem.F[k] @ Φ
                largest = max(largest, np.abs(Φ).max())
        return Frames(I, None, moving=not largest < GROWTH)

    def move(self, F: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """F in the frames before and after the step, and the frame after it."""
        if self.moving:
            self.Q, T = np.linalg.qr(F @ self.Q)
            return T, self.Q
        return F if self.T is None else self.T, self.Q


def _predicted(
    factors: StateFactors, F: np.ndarray, Q: np.ndarray, H: np.ndarray, R: np.ndarray, J: np.ndarray
) -> StateFactors:
    """Before the next sample: [[H S, V, 0], [F S, Ω, W]] = [[s, 0, 0], [K s, S+, 0]] times a rotation; M M' gains K s (K s)'."""
    L, S, M = factors
    p, n = H.shape
    V = semidefinite_factor(R)
    Ω = J @ np.linalg.pinv(V.T) if V.size else np.zeros((n, 0))  # Ω V' = J
    W = semidefinite_factor(symmetric(Q - Ω @ Ω.T))
    both = lower(np.vstack([
        np.hstack([H @ S, V, np.zeros((p, W.shape[1]))]), np.hstack([F @ S, Ω, W])
    ]))  # fmt: skip
    used = min(p, both.shape[1])
    gain, S = both[p:, :used], both[p:, used:]
    return StateFactors(lower(np.hstack([F @ L, Ω, W])), S, lower(np.hstack([F @ M, gain])))  # (2.5)


def _with_present(
    frames: "Frames", factors: StateFactors, Γ: np.ndarray, H: np.ndarray, R: np.ndarray
) -> tuple[np.ndarray, Reach]:
    """The shares of the variances of the states that the present sample explains too, and the filter's verdict."""
    H, L = H @ frames.Q, factors.L
    half = H @ L
    known = corrected(factors, H, semidefinite_factor(R))
    share = shares(frames.Q @ known.M, frames.Q @ L)
    if frames.grows:
        return share, by_correlation(in_states(pairs(known), frames.Q), _units(frames.Q @ L))
    N = L @ half.T / scale(np.sum(half**2, axis=1) + np.diagonal(R))
    return share, rank(np.hstack([N, Γ]) / _units(L)[:, None])


def by_correlation(found: Pairs, units: np.ndarray) -> Reach:
    """The directions without correlation, in units of the states, and the smallest correlation of the others."""
    ρ = np.sqrt(found.squared)
    hidden = ρ <= ZERO
    return Reach(units[:, None] * found.g[:, hidden], 0.0 if hidden.any() else float(ρ.min(initial=np.inf)))


def in_states(found: Pairs, frame: np.ndarray) -> Pairs:
    """The pairs of z as those of x = frame z."""
    return found._replace(g=frame @ found.g, v=frame @ found.v, known=frame @ found.known)


def _units(L: np.ndarray) -> np.ndarray:
    return scale(lengths(L) ** 2)


def shares(M: np.ndarray, L: np.ndarray) -> np.ndarray:
    """The variances of M over those of L; 0 where there is none."""
    whole = lengths(L)
    return np.clip((lengths(M) / np.where(whole > 0, whole, 1.0)) ** 2, 0.0, 1.0)


def _refuse_growth(F: np.ndarray, L: np.ndarray, k: int) -> None:
    """Raise an error where the next step could overflow."""
    if (np.abs(L).max(initial=0.0) * max(1.0, np.abs(F).max())) ** 2 > LARGEST:
        raise AssumptionError(f"the covariance of the model overflows within {k + 1} steps: use a shorter horizon.")


def rank(Γ: np.ndarray) -> Reach:
    """The left null space of Γ, and its smallest singular value relative to the largest."""
    n = len(Γ)
    U, σ, _ = np.linalg.svd(Γ, full_matrices=False)
    if len(σ) < n or σ[0] == 0:
        return Reach(complement(U[:, : len(σ)]) if len(σ) and σ[0] > 0 else np.eye(n), 0.0)
    hidden = np.array([judged(ratio) == "no" for ratio in σ / σ[0]])
    return Reach(U[:, hidden], float(σ[-1] / σ[0]))


def solve_semidefinite(S: np.ndarray, B: np.ndarray) -> np.ndarray:
    """S^+ B: outputs that depend on others add nothing."""
    D = scale(np.diagonal(S))
    λ, V = np.linalg.eigh(S / (D[:, None] * D))
    back = np.where(λ > 1e-13 * max(λ[-1], 1.0), 1 / np.where(λ > 0, λ, 1.0), 0.0)
    return V @ (back[:, None] * (V.T @ (B / D[:, None]))) / D[:, None]


def steady_predictor(problem: Problem, Π: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """P and the predictor's gain; by the recursion where noise-free outputs leave the Riccati equation without a solution."""
    F, Q, H, R, J = problem
    try:
        P, K, _ = dare(F.T, H.T, Q, R, J)
        return P, K.T
    except AssumptionError:
        P, K = Π, np.zeros(H.T.shape)
    for _ in range(SETTLED):
        before = P
        K = solve_semidefinite(H @ P @ H.T + R, H @ P @ F.T + J.T).T
        P = _joseph(F - K @ H, P, K, Q, R, J)
        if np.abs(P - before).max() <= 1e-15 * np.abs(Π).max():
            break
    return P, K


def _explained(
    problem: Problem, P: np.ndarray, K: np.ndarray, lyapunov: Callable[..., np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Σ = F Σ F' + K S K', the covariance of the estimate; and with the present output."""
    F, _, H, R, _ = problem
    S = H @ P @ H.T + R
    Σ = lyapunov(F, K @ S @ K.T)
    L = solve_semidefinite(S, H @ P).T
    return Σ, symmetric(Σ + L @ S @ L.T)


def _joseph(closed: np.ndarray, P: np.ndarray, K: np.ndarray, Q: np.ndarray, R: np.ndarray, J: np.ndarray):
    cross = K @ J.T
    return symmetric(closed @ P @ closed.T + Q - cross - cross.T + K @ R @ K.T)


def compressed(M: np.ndarray, Γ: np.ndarray) -> np.ndarray:
    """[M, Γ], or the triangular factor with the same Γ Γ' where it has many columns."""
    Γ = np.hstack([M, Γ])
    n, columns = Γ.shape
    if columns <= 2 * n:
        return Γ
    triangle: Any = np.linalg.qr(Γ.T, mode="r")
    return triangle.T


def symmetric(X: np.ndarray) -> np.ndarray:
    """The symmetric part, without asymmetric rounding."""
    return (X + X.T) / 2
