"""The information in past outputs about the state: covariances before and after, and between state and outputs.

Letters of Baram & Kailath, NASA TM-89427 (1987): x+ = F x + w, y = H x + v, cov w = Q, cov v = R, cov(w, v) = J; Π the
covariance of the state, P of its error given all past outputs, N = Π H', and Γ = [.., F M, M] the covariances of the
state with each past output. Σ = Π - P is the part explained by the outputs; its own recursion avoids cancellation.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ..errors import AssumptionError
from ..kernels.reach import Reach, complement, reach, reachability_matrix
from ..kernels.riccati import care, clyap, dare, dlyap
from .tolerance import judged, scale

EVERY = 40  # states up to which the rank is computed after every step, and not only at the horizon
LARGEST = 1e140  # of a covariance: its square does not overflow
SETTLED = 5000  # steps of the recursion where the Riccati equation cannot be solved


class Problem(NamedTuple):
    """The model as arrays, (.., ..) constant or (T, .., ..) with a leading axis of time."""

    F: np.ndarray
    Q: np.ndarray
    H: np.ndarray
    R: np.ndarray
    J: np.ndarray

    def at(self, k: int) -> "Problem":
        """The matrices of step k; after the last row, those of the last."""
        return Problem(*(M if M.ndim == 2 else M[min(k, len(M) - 1)] for M in self))


class StateMoments(NamedTuple):
    """Π, Σ given past outputs and given the present one too, Γ; and the reached directions, with Π scaled to a unit diagonal."""

    Π: np.ndarray
    Σ: np.ndarray
    Σ_filter: np.ndarray
    Γ: np.ndarray
    predictor: Reach
    filter: Reach


def stationary(problem: Problem, *, continuous: bool) -> StateMoments:
    """In steady state, which a stable F has. Corollaries 2.1 and 2.3; the filter's verdict is (F, [N, M])."""
    F, Q, H, R, J = problem
    if continuous:
        Π = clyap(F, Q)
        M = Π @ H.T
        K = care(F.T, H.T, Q, R).K.T
        Σ = Σ_filter = clyap(F, K @ R @ K.T)
    else:
        Π = dlyap(F, Q)
        M = F @ Π @ H.T + J
        P, K = steady_predictor(problem, Π)
        Σ, Σ_filter = _explained(problem, P, K, dlyap)
    D, E = scale(np.diagonal(Π)), scale(np.diagonal(H @ Π @ H.T + (0 if continuous else R)))
    F_scaled, N, M_scaled = F * (D / D[:, None]), Π @ H.T / D[:, None] / E, M / D[:, None] / E
    predictor = reach(F_scaled, M_scaled)
    with_present = predictor if continuous else reach(F_scaled, np.hstack([N, M_scaled]))
    Γ = reachability_matrix(F, M)
    return StateMoments(Π, Σ, Σ_filter, Γ, predictor, with_present)


def over_steps(problem: Problem, Π: np.ndarray, steps: int) -> StateMoments:
    """After `steps` samples, from covariance Π before the first. Theorem 2.1; the rank is the least over k >= n."""
    n = len(Π)
    P, Σ = Π, np.zeros((n, n))
    Γ = Γ_scaled = np.zeros((n, 0))
    worst = Reach(np.zeros((n, 0)), np.inf)
    for k in range(steps):
        F, Q, H, R, J = problem.at(k)
        _refuse_growth(F, Π, k)
        M, E = F @ Π @ H.T + J, scale(np.diagonal(H @ Π @ H.T + R))
        Γ, Γ_scaled = compressed(M, F @ Γ), compressed(M / E, F @ Γ_scaled)
        S = H @ P @ H.T + R
        K = solve_semidefinite(S, H @ P @ F.T + J.T).T
        Σ = symmetric(F @ Σ @ F.T + K @ S @ K.T)
        P = _joseph(F - K @ H, P, K, Q, R, J)
        Π = symmetric(F @ Π @ F.T + Q)  # (2.5)
        if k + 1 == steps or (k + 1 >= n and n <= EVERY):
            worst = min(worst, rank(Γ_scaled / scale(np.diagonal(Π))[:, None]), key=lambda found: found.distance)
    H, R = problem.at(steps).H, problem.at(steps).R
    S, N = H @ P @ H.T + R, Π @ H.T / scale(np.diagonal(H @ Π @ H.T + R))
    L = solve_semidefinite(S, H @ P).T
    with_present = rank(np.hstack([N, Γ_scaled]) / scale(np.diagonal(Π))[:, None])
    return StateMoments(Π, Σ, symmetric(Σ + L @ S @ L.T), Γ, worst, with_present)


def _refuse_growth(F: np.ndarray, Π: np.ndarray, k: int) -> None:
    """Raise an error where the next step could overflow."""
    if np.abs(Π).max() * max(1.0, np.abs(F).max()) ** 2 > LARGEST:
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
