"""The reachable space of a pair (F, M): the span of M, F M, F² M, .. NumPy, outside jit.

Letters: F (n, n), M (n, p); V an orthonormal basis of the reachable space, Z of its orthogonal complement; f a left
eigenvector of F, f*F = λ f*. Powers of F are never formed to decide a rank: each decision concerns a change of F and M
relative to their norms.

References: P. Van Dooren, IEEE TAC 26 (1981) 111, §III (staircase); M. L. J. Hautus, Indag. Math. 31 (1969) 443 (modes).
"""

from typing import NamedTuple

import numpy as np

from .shapes import Float

ZERO = 1e-12          # relative size below which a coupling is rounding
DOUBTFUL = 1e-8       # and below which the rank is uncertain
NEAR = 1e-3           # eigenvalues this close, relative to the norm of F, may mask each other
NEIGHBOURS = 8        # of an eigenvalue, tested together
CLOSEST = 4           # modes tested without restriction, one decomposition each; more for small F
Real = np.ndarray


class Reach(NamedTuple):
    """The unreachable directions Z (n, k), and the smallest relative change of (F, M) found that shrinks the reachable space."""

    Z: Real
    distance: float


def reach(F: Float[Real, "n n"], M: Float[Real, "n p"]) -> Reach:
    """The directions (F, M) does not reach, by the staircase and mode by mode: the larger result, as each can miss some.

    The staircase loses digits along a chain of many weak couplings, modes lose half or more where F is defective.
    Cost: about 30 n³ multiplications.

    >>> reach(np.diag([0.5, 0.2]), np.array([[1.0], [0.0]])).Z.round(12).tolist()
    [[0.0], [1.0]]
    """
    if len(F) == 0:
        return Reach(np.zeros((0, 0)), np.inf)
    V, coupling = staircase(F, M)
    Z, mode = hidden_modes(F, M)
    missing = complement(V)
    if missing.shape[1] >= Z.shape[1]:
        Z = missing
    return Reach(Z, 0.0 if Z.shape[1] else min(coupling, mode))


def staircase(F: Float[Real, "n n"], M: Float[Real, "n p"]) -> tuple[Real, float]:
    """V (n, r), and the weakest coupling that was used, relative to F (to M, for the first)."""
    V, weakest = np.zeros((len(F), 0)), np.inf
    new, size = M, np.linalg.norm(M)
    F_size = np.linalg.norm(F)
    while new.shape[1] and size > 0 and V.shape[1] < len(F):
        for _ in range(2):                                                 # twice is enough: then V stays orthonormal
            new = new - V @ (V.T @ new)
        U, σ, _ = np.linalg.svd(new, full_matrices=False)
        followed = σ > ZERO * size
        weakest = min([weakest, *(σ[followed] / size)])
        V = np.hstack([V, U[:, followed]])
        new, size = F @ U[:, followed], F_size
    return V, float(weakest)


def hidden_modes(F: Float[Real, "n n"], M: Float[Real, "n p"]) -> tuple[Real, float]:
    """The left eigenvectors that M does not reach (an orthonormal real basis), and the distance of the others from that.

    For each λ the smallest singular values of [F - λ, M] over the span of the eigenvectors near it: a rank test, so that
    a repeated eigenvalue is tested on its whole eigenspace. Where they are smallest, of [F - λ, M] itself.
    """
    from scipy.linalg import orth

    F, M = F / (np.linalg.norm(F) or 1.0), M / (np.linalg.norm(M) or 1.0)
    λ, right = np.linalg.eig(F.T)
    left = right.conj()                                                    # f*F = λ f*
    modes = [_mode(F, M, λ, left, int(i)) for i in np.flatnonzero(np.imag(λ) >= 0)]
    modes.sort(key=lambda mode: mode.distance)
    closest = max(CLOSEST, 500 // len(F))
    modes[:closest] = [_mode_exactly(F, M, mode.λ) for mode in modes[:closest]]
    found = np.hstack([part(mode.f) for mode in modes for part in (np.real, np.imag)])
    hidden = orth(found, rcond=1e-6) if np.any(found) else np.zeros((len(F), 0))
    return hidden, min(mode.distance for mode in modes)


class _Mode(NamedTuple):
    """An eigenvalue, its left eigenvectors that M does not reach (n, k), and the distance of the others from that."""

    λ: complex
    f: Real
    distance: float


def _mode(F: Real, M: Real, λ: Real, left: Real, i: int) -> _Mode:
    gaps = np.abs(λ - λ[i])
    near = np.argsort(gaps, kind="stable")[:NEIGHBOURS]
    E = np.linalg.qr(left[:, near[gaps[near] <= NEAR]])[0]
    U, σ, _ = np.linalg.svd(E.conj().T @ np.hstack([F - λ[i] * np.eye(len(F)), M]), full_matrices=False)
    return _Mode(complex(λ[i]), E @ U[:, σ <= ZERO], float(σ[-1]))


def _mode_exactly(F: Real, M: Real, λ: complex) -> _Mode:
    U, σ, _ = np.linalg.svd(np.hstack([F - λ * np.eye(len(F)), M]), full_matrices=False)
    return _Mode(λ, U[:, σ <= ZERO], float(σ[-1]))


def complement(V: Float[Real, "n r"]) -> Float[Real, "n k"]:
    """An orthonormal basis of the orthogonal complement of the orthonormal columns of V."""
    return np.linalg.qr(V, mode="complete")[0][:, V.shape[1] :]


def reachability_matrix(F: Float[Real, "n n"], M: Float[Real, "n p"]) -> Float[Real, "n np"]:
    """[M, F M, .., F^(n-1) M]."""
    blocks = [M]
    for _ in range(len(F) - 1):
        blocks.append(F @ blocks[-1])
    return np.hstack(blocks)
