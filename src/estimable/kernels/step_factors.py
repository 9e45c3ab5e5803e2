"""Short steps of continuous models as factors, without a limit on the step. NumPy, outside jit.

Letters: dx/dt = A x + g w with w white of unit density; y = C x + v with R a density. A step h is halved until its norm is at
most 1, and then doubled. Nothing larger than the state's own motion is formed: one exponential over a long step has
e^{-A h}, which overflows for a stable fast mode.

References: J. E. Potter, AIAA Guidance Conf. (1966) 66-1056 (Hamiltonian); C. F. Van Loan, IEEE TAC 23 (1978) 395-404.
"""

import numpy as np

from .shapes import Float
from .square_root_elements import Element, Source, compressed, lower, solve_lower, sources_then

Real = np.ndarray
NODES, WEIGHTS = np.polynomial.legendre.leggauss(10)
FINE = 20  # halvings of a short step for the sources: its error is 1e-6 of a share


def exponential(M: Real) -> Real:
    """e^M by Taylor's series for a norm of about 1 (24 terms leave 1e-24), entry by entry accurate for chains of integrators."""
    E = term = np.eye(len(M))
    for k in range(1, 25):
        term = term @ M / k
        E = E + term
    return E


def halvings(M: Real) -> int:
    """How often a step must be halved until the norm of the exponent M is at most 1."""
    size = np.abs(M).sum(axis=1).max(initial=0.0)
    return max(0, int(np.ceil(np.log2(size)))) if size > 0 else 0


def exponential_of(A: Float[Real, "n n"], h: float) -> Real:
    """e^{A h} for any h, in balanced units."""
    return noise_factors(A, [], h)[0]


def noise_factors(A: Float[Real, "n n"], g: list[Real], h: float) -> tuple[Real, list[Real]]:
    """e^{A h}, and for each g a factor of ∫_0^h e^{A t} g g' e^{A't} dt, by Gauss's rule with ten nodes and doubling."""
    from scipy.linalg import matrix_balance

    units: Real = matrix_balance(A, permute=False, separate=True)[1][0]
    A, g = A * (units / units[:, None]), [each / units[:, None] for each in g]
    m = halvings(A * h)
    step = h / 2**m
    moves = [exponential(A * (step * (1 + t) / 2)) for t in NODES]
    found = [compressed(np.hstack([np.sqrt(step * w / 2) * Φ @ each for Φ, w in zip(moves, WEIGHTS, strict=True)]))
             for each in g]  # fmt: skip
    Φ = exponential(A * step)
    for _ in range(m):
        found = [compressed(np.hstack([Φ @ S, S])) for S in found]
        Φ = Φ @ Φ
    return Φ * (units[:, None] / units), [units[:, None] * S for S in found]


def of_short_time(A: Real, Q: Real, information: Real, h: float) -> Element:
    """The element of a short time h: with E = e^{[[-A', C'R^-1 C], [Q, A]] h}, U = E21 E11^-1, J = E11^-1 E12, Φ = E11^-T."""
    Φ, U, J = _moments(A, Q, information, h)
    return Element(Φ, semidefinite_factor(U), semidefinite_factor(J).T)


def sources_of_short_time(
    A: Real, g: list[Real], C: Real, V: list[Real], h: float
) -> tuple[Element, list[Source]]:
    """The element of a short time with its sources (factors of densities), by 2^FINE steps of the midpoint rule, doubled."""
    δ = h / 2**FINE
    Φ, half = exponential(A * δ), exponential(A * (δ / 2))
    s = lower(np.hstack(V))
    E = Element(Φ, np.sqrt(δ) * np.hstack([np.zeros((len(A), 0)), *g]), np.sqrt(δ) * solve_lower(s, C @ half))
    n, p = C.shape[1], len(C)
    parts = [Source(np.sqrt(δ) * each, np.zeros((p, each.shape[1]))) for each in g]
    parts += [Source(np.zeros((n, each.shape[1])), solve_lower(s, each)) for each in V]
    for _ in range(FINE):
        E, parts = sources_then(E, parts, E, parts)
    return E, parts


def pencil(A: Real, Q: Real, information: Real) -> tuple[Real, Real]:
    """The Hamiltonian matrix [[-A', C'R^-1 C], [Q, A]], balanced, and its units: powers of two, of states and costates."""
    from scipy.linalg import matrix_balance

    H = np.block([[-A.T, information], [Q, A]])
    units: Real = matrix_balance(H, permute=False, separate=True)[1][0]
    return H * (units / units[:, None]), units


def _moments(A: Real, Q: Real, information: Real, h: float) -> tuple[Real, Real, Real]:
    n = len(A)
    units = pencil(A, Q, information)[1]
    scaled = np.block([[-A.T, information], [Q, A]]) * (units / units[:, None])
    E = exponential(scaled * h) * (units[:, None] / units)
    D = units[:n]
    inverse = D[:, None] * np.linalg.inv(E[:n, :n] * (D / D[:, None])) / D   # near I: the step is short
    return inverse.T, E[n:, :n] @ inverse, inverse @ E[:n, n:]


def semidefinite_factor(P: Float[Real, "n n"]) -> Float[Real, "n k"]:
    """L with L L' = P, after scaling P to a unit diagonal; eigenvalues that are rounding are left out."""
    size = np.sqrt(np.maximum(np.diagonal(P), 0.0))
    if np.count_nonzero(P - np.diag(np.diagonal(P))) == 0:
        return np.diag(size)[:, size > 0]
    unit = np.where(size > 0, size, 1.0)
    λ, V = np.linalg.eigh((P + P.T) / 2 / unit[:, None] / unit)
    real = λ > len(P) * np.finfo(float).eps
    return size[:, None] * V[:, real] * np.sqrt(λ[real])
