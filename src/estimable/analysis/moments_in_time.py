"""The moments of `moments.py` in continuous time, over a finite time.

Γ Γ' approximates the Gramian ∫ Φ(t,s) N(s) N(s)' Φ(t,s)' ds by Gauss's rule with four nodes per step. The factor itself is
stored, so that small singular values are not lost by squaring. Everything between two steps is exact.
"""

import numpy as np

from ..errors import AssumptionError
from ..models.discretisation import exponential, over
from .moments import LARGEST, Problem, StateMoments, compressed, rank, symmetric
from .tolerance import scale

NODES = (np.polynomial.legendre.leggauss(4)[0] + 1) / 2
WEIGHTS = np.polynomial.legendre.leggauss(4)[1] / 2
MOST_STEPS = 20_000


def over_time(problem: Problem, Π: np.ndarray, seconds: float) -> StateMoments:
    """After `seconds`, from covariance Π at the start; the rows of a varying model share the time equally."""
    n = len(Π)
    pieces = max(len(M) if M.ndim == 3 else 1 for M in problem)
    P, Γ, Γ_scaled = Π, np.zeros((n, 0)), np.zeros((n, 0))
    for k in range(pieces):
        F, Q, H, R, _ = problem.at(k)
        steps = substeps(F, n, seconds / pieces, pieces)
        h = seconds / pieces / steps
        Φ, _, _, Qd = over(F, np.zeros((n, 0)), Q, np.append(NODES, 1.0) * h, hold="zero_order")
        E, information = np.sqrt(np.diagonal(R)), H.T @ np.linalg.solve(R, H)
        pencil = exponential(np.block([[-F.T, information], [Q, F]]) * h)
        for _ in range(steps):
            N = np.hstack([
                np.sqrt(w * h) * Φ[3 - i] @ (Φ[i] @ Π @ Φ[i].T + Qd[i]) @ H.T for i, w in enumerate(WEIGHTS)
            ])  # fmt: skip
            Γ, Γ_scaled = compressed(N, Φ[4] @ Γ), compressed(N / np.tile(E, 4), Φ[4] @ Γ_scaled)
            Π = symmetric(Φ[4] @ Π @ Φ[4].T + Qd[4])
            P = _riccati_step(pencil, P)
            if not np.abs(Π).max() < LARGEST:
                raise AssumptionError(
                    f"the covariance of the model overflows within {seconds:g} s: use a shorter horizon."
                )
    found = rank(Γ_scaled / scale(np.diagonal(Π))[:, None])
    return StateMoments(Π, symmetric(Π - P), symmetric(Π - P), Γ, found, found)


def substeps(F: np.ndarray, n: int, seconds: float, pieces: int) -> int:
    """The number of steps: short enough for the quadrature, and enough for every direction to show."""
    steps = max(-(-n // pieces), int(np.ceil(np.linalg.norm(F, 2) * seconds)))
    if steps * pieces > MOST_STEPS:
        raise AssumptionError(
            f"a horizon of {seconds * pieces:g} s takes {steps * pieces} steps of the fastest mode, more than {MOST_STEPS}: "
            "use a shorter horizon, or a model without its fast modes."
        )
    return steps


def _riccati_step(pencil: np.ndarray, P: np.ndarray) -> np.ndarray:
    """P after a step: V U^-1 with (U, V) = e^(pencil h) (I, P). E. J. Davison, M. C. Maki, IEEE TAC 18 (1973) 71."""
    n = len(P)
    U, V = pencil[:n, :n] + pencil[:n, n:] @ P, pencil[n:, :n] + pencil[n:, n:] @ P
    return symmetric(np.linalg.solve(U.T, V.T).T)
