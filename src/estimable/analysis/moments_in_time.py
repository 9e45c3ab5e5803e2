"""The moments of `moments.py` in continuous time, over a finite time.

Γ Γ' approximates the Gramian ∫ Φ(t,s) N(s) N(s)' Φ(t,s)' ds by Gauss's rule with four nodes per step, and Π - P the integral
∫ Φ(t,s) P(s) H' R^-1 H P(s) Φ(t,s)' ds in the same way. The factors themselves are stored, so that small singular values are not
lost by squaring. Everything between two steps is exact.
"""

import numpy as np

from ..errors import AssumptionError
from ..kernels import square_root_elements as el
from ..kernels.canonical_correlations import StateFactors, pairs
from ..kernels.growth_frame import growth_frame
from ..kernels.square_root_elements import lengths, lower
from ..kernels.step_factors import exponential_of, noise_factors, of_short_time, pencil, semidefinite_factor
from .moments import GROWTH, LARGEST, Problem, StateMoments, by_correlation, compressed, in_states, rank, shares
from .tolerance import scale

NODES = (np.polynomial.legendre.leggauss(4)[0] + 1) / 2
WEIGHTS = np.polynomial.legendre.leggauss(4)[1] / 2
MOST_STEPS = 20_000


def over_time(problem: Problem, Π: np.ndarray, seconds: float) -> StateMoments:
    """After `seconds`, from covariance Π at the start; the rows of a varying model share the time equally."""
    n, pieces = len(Π), problem.steps or 1
    states = np.eye(n)
    frame = growth_frame(problem.F, continuous=True)[0] if _grows(problem, seconds) else states
    L = lower(frame.T @ semidefinite_factor(Π))
    factors, Γ, Γ_scaled = StateFactors(L, L, np.zeros((n, 0))), np.zeros((n, 0)), np.zeros((n, 0))
    for k in range(pieces):
        F, Q, H, R, _ = problem.at(k)
        piece = _Piece(frame.T @ F @ frame, frame.T @ Q @ frame, H @ frame, R, seconds / pieces, pieces)
        for _ in range(piece.steps):
            factors, N, white = piece.move(factors)
            Γ, Γ_scaled = compressed(N, piece.Φ @ Γ), compressed(white, piece.Φ @ Γ_scaled)
            if not np.abs(factors.L).max(initial=0.0) ** 2 < LARGEST:
                raise AssumptionError(
                    f"the covariance of the model overflows within {seconds:g} s: use a shorter horizon."
                )
    both = in_states(pairs(factors), frame)
    L, S, M = (frame @ half for half in factors)
    units, share = scale(lengths(L) ** 2), shares(M, L)
    found = rank(Γ_scaled / units[:, None]) if frame is states else by_correlation(both, units)
    return StateMoments(L @ L.T, S @ S.T, share, share, frame @ Γ, found, found, both)


def _grows(problem: Problem, seconds: float) -> bool:
    """Whether a constant model grows far."""
    return problem.F.ndim == 2 and np.linalg.eigvals(problem.F).real.max() * seconds >= np.log(GROWTH)


class _Piece:
    """Equal steps of a constant model: the motion over a step, and from the start and to the end of it at each node."""

    def __init__(self, F: np.ndarray, Q: np.ndarray, H: np.ndarray, R: np.ndarray, seconds: float, pieces: int):
        n = len(F)
        half = el.solve_lower(np.linalg.cholesky(R), H)
        self.H, self.white = H, half
        self.steps = substeps(pencil(F, Q, half.T @ half)[0], n, seconds, pieces)
        h, g = seconds / self.steps, semidefinite_factor(Q)
        self.E = np.sqrt(np.diagonal(R))
        self.weights = np.sqrt(WEIGHTS * h)
        self.starts = [noise_factors(F, [g], node * h) for node in NODES]
        self.elements = [of_short_time(F, Q, half.T @ half, node * h) for node in NODES]
        self.ends = [exponential_of(F, (1 - node) * h) for node in NODES]
        self.Φ, (self.g,) = noise_factors(F, [g], h)
        self.whole = of_short_time(F, Q, half.T @ half, h)

    def move(self, factors: StateFactors) -> tuple[StateFactors, np.ndarray, np.ndarray]:
        """Over a step; N, the covariances of the state with its outputs by node, and N in units of the sensors."""
        L, S, M = factors
        belief = el.of_prior(S, np.zeros((len(S), 0)))
        N, white, gained = [], [], []
        for w, (Φ, (g,)), E, end in zip(self.weights, self.starts, self.elements, self.ends, strict=True):
            half = np.hstack([Φ @ L, g])
            N.append(w * end @ (half @ (half.T @ self.H.T)))
            white.append(N[-1] / self.E)
            error = el.state_error(el.then(belief, E)).F
            gained.append(w * end @ (error @ (error.T @ self.white.T)))
        S = lower(el.state_error(el.then(belief, self.whole)).F)
        moved = StateFactors(lower(np.hstack([self.Φ @ L, self.g])), S, lower(np.hstack([self.Φ @ M, *gained])))
        return moved, np.hstack(N), np.hstack(white)


def substeps(F: np.ndarray, n: int, seconds: float, pieces: int) -> int:
    """The number of steps: short enough for the quadrature, and enough for every direction to show."""
    steps = max(-(-n // pieces), int(np.ceil(np.linalg.norm(F, 2) * seconds)))
    if steps * pieces > MOST_STEPS:
        raise AssumptionError(
            f"a horizon of {seconds * pieces:g} s takes {steps * pieces} steps of the fastest mode, more than {MOST_STEPS}: "
            "use a shorter horizon, or a model without its fast modes."
        )
    return steps
