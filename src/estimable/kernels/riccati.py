"""Lyapunov and Riccati equations, discrete and continuous, by structured doubling. NumPy and SciPy, outside jit.

Letters: A, B, Q, R, N as in the linear-quadratic problem min Σ x'Q x + 2 x'N u + u'R u under x+ = A x + B u (or dx/dt);
X its value, K its feedback (u = -K x), F = A - B K. A Kalman filter is the same with A', C', G Q G', R, G S.

Doubling runs 2^k steps of the recursion in k products, keeps symmetry, and for semidefinite data adds semidefinite terms
only. One Newton step then takes out the rounding that was gathered. Where doubling fails (R singular, an unstable mode that
costs nothing) the extended pencil is decomposed by QZ (SciPy), followed by the same Newton step.

References: R. A. Smith, SIAM J. Appl. Math. 16 (1968) 198 (Lyapunov); E. K.-W. Chu, H.-Y. Fan, W.-W. Lin, C.-S. Wang,
Int. J. Control 77 (2004) 767 (discrete Riccati); E. K.-W. Chu, H.-Y. Fan, W.-W. Lin, Linear Algebra Appl. 396 (2005) 55
(continuous); D. L. Kleinman, IEEE TAC 13 (1968) 114, G. A. Hewer, IEEE TAC 16 (1971) 382 (Newton).
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..errors import AssumptionError
from .shapes import Float

DOUBLINGS = 50        # 2^50 steps: a mode that has not died out by then is at the limit of stability, to rounding
RESIDUAL = 1e-13      # of the size of the equation's terms, above which the second method is tried too
SINGULAR = 1e13       # condition number from which R + B'X B counts as singular
EPS = np.finfo(float).eps
UNSETTLED = (
    "the Riccati equation has no stabilising solution. A filter needs outputs that show every unstable mode, and noise that "
    "excites every mode on the limit of stability. A regulator needs inputs that move every unstable mode, and a cost of every "
    "mode on that limit."
)

Real = np.ndarray


class Riccati(NamedTuple):
    """The stabilising solution X (n, n), its feedback K (m, n) and the closed loop F = A - B K (n, n)."""

    X: Real
    K: Real
    F: Real


def dlyap(A: Float[Real, "n n"], Q: Float[Real, "n n"]) -> Float[Real, "n n"]:
    """The solution of X = A X A' + Q, Q symmetric. Raises `AssumptionError` where A is not stable.

    Positive semidefinite where Q is. Cost: 4 n³ per doubling; the doublings are log2 of the steps in which A dies out.

    >>> dlyap(np.array([[0.5]]), np.array([[3.0]]))
    array([[4.]])
    """
    X, Φ = _symmetric(Q), A
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(DOUBLINGS):
            step = Φ @ X @ Φ.T                                             # X(2k) = X(k) + A^k X(k) A^k'
            X, Φ = X + _symmetric(step), Φ @ Φ
            if not np.isfinite(X).all():
                break
            if _settled(step, X) and np.linalg.norm(Φ) < 1:                # proves that A is stable
                return X
    radius = np.abs(np.linalg.eigvals(A)).max()
    raise AssumptionError(f"there is no stationary covariance: the largest modulus of an eigenvalue is {radius:.6g}, not < 1.")


def clyap(A: Float[Real, "n n"], Q: Float[Real, "n n"]) -> Float[Real, "n n"]:
    """The solution of A X + X A' + Q = 0, Q symmetric. Raises `AssumptionError` where A is not stable.

    Cayley's transform with the shift γ makes it X = Φ X Φ' + 2 γ (γ - A)^-1 Q (γ - A)^-1', which `dlyap` solves.

    >>> clyap(np.array([[-2.0]]), np.array([[4.0]]))
    array([[1.]])
    """
    from scipy.linalg import matrix_balance

    T = matrix_balance(np.abs(A), permute=False, separate=True)[1][0]      # units, powers of two
    A, Q = A * (T / T[:, None]), Q / (T[:, None] * T)
    identity, γ = np.eye(len(A)), _geometric_mean(A)
    try:
        Φ = np.linalg.solve(γ * identity - A, γ * identity + A)
        Γ = np.linalg.solve(γ * identity - A, np.linalg.solve(γ * identity - A, 2 * γ * _symmetric(Q)).T)
        return dlyap(Φ, Γ) * (T[:, None] * T)
    except (AssumptionError, np.linalg.LinAlgError):
        fastest = np.linalg.eigvals(A).real.max()
        raise AssumptionError(
            f"there is no stationary covariance: the largest real part of an eigenvalue is {fastest:.6g}, not < 0."
        ) from None


def dare(
    A: Float[Real, "n n"],
    B: Float[Real, "n m"],
    Q: Float[Real, "n n"],
    R: Float[Real, "m m"],
    N: Float[Real, "n m"] | None = None,
) -> Riccati:
    """The stabilising solution of X = A'X A - (A'X B + N) (R + B'X B)^-1 (A'X B + N)' + Q.

    R may be singular where R + B'X B is not. Raises `AssumptionError` where there is none. Cost: about 20 n³ a doubling.

    >>> dare(np.eye(1), np.eye(1), np.eye(1), np.eye(1)).X.round(6)  # (1 + sqrt(5)) / 2
    array([[1.618034]])
    """
    T, A, B, Q, N = _balance(A, B, Q, R, np.zeros_like(B) if N is None else N)

    def feedback(X: Real) -> Real:
        """K of X: (R + B' X B)^-1 (B' X A + N')."""
        return _solve(R + B.T @ X @ B, B.T @ X @ A + N.T)

    def newton(X: Real) -> Real:
        """One step of Newton's method: X of the gain that X gives."""
        K = feedback(X)
        return dlyap((A - B @ K).T, Q - N @ K - (N @ K).T + K.T @ R @ K)

    def residual(X: Real) -> float:
        """What the equation leaves, relative to its terms."""
        terms = A.T @ X @ A, X, feedback(X).T @ (B.T @ X @ A + N.T), Q
        size = sum(float(np.linalg.norm(term)) for term in terms)
        return float(np.linalg.norm(terms[0] - X - terms[2] + Q)) / max(size, np.finfo(float).tiny)

    def doubling():
        """By doubling, without its cross term."""
        return _double(*_without_cross_term(A, B, Q, R, N))

    def pencil():
        """By SciPy: the ordered QZ form of the pencil."""
        from scipy.linalg import solve_discrete_are

        return solve_discrete_are(A, B, Q, R, s=N)

    X = _best((doubling, pencil), newton, residual)
    return _in_units(T, X, feedback(X), A, B)


def care(
    A: Float[Real, "n n"],
    B: Float[Real, "n m"],
    Q: Float[Real, "n n"],
    R: Float[Real, "m m"],
    N: Float[Real, "n m"] | None = None,
) -> Riccati:
    """The stabilising solution of A'X + X A - (X B + N) R^-1 (X B + N)' + Q = 0, R not singular.

    Raises `AssumptionError` where there is none. Cost: about 20 n³ a doubling.

    >>> care(np.zeros((1, 1)), np.eye(1), 4 * np.eye(1), np.eye(1)).X.round(12)
    array([[2.]])
    """
    T, A, B, Q, N = _balance(A, B, Q, R, np.zeros_like(B) if N is None else N)

    def feedback(X: Real) -> Real:
        """K of X: R^-1 (B' X + N')."""
        return _solve(R, B.T @ X + N.T)

    def newton(X: Real) -> Real:
        """One step of Newton's method: X of the gain that X gives."""
        K = feedback(X)
        return clyap((A - B @ K).T, Q - N @ K - (N @ K).T + K.T @ R @ K)

    def residual(X: Real) -> float:
        """What the equation leaves, relative to its terms."""
        terms = A.T @ X, X @ A, feedback(X).T @ (B.T @ X + N.T), Q
        size = sum(float(np.linalg.norm(term)) for term in terms)
        return float(np.linalg.norm(terms[0] + terms[1] - terms[2] + Q)) / max(size, np.finfo(float).tiny)

    def doubling():
        """By doubling, after a Cayley transform."""
        return _double(*_cayley(*_without_cross_term(A, B, Q, R, N)))

    def pencil():
        """By SciPy: the ordered QZ form of the pencil."""
        from scipy.linalg import solve_continuous_are

        return solve_continuous_are(A, B, Q, R, s=N)

    X = _best((doubling, pencil), newton, residual)
    return _in_units(T, X, feedback(X), A, B)


def _best(methods: tuple[Callable, ...], newton: Callable, residual: Callable) -> Real:
    """The solution with the smallest residual; later methods are tried only where a residual remains."""
    best, least = None, np.inf
    for method in methods:
        try:
            with np.errstate(all="ignore"):
                X = newton(_symmetric(method()))
                left = residual(X)
        except (AssumptionError, np.linalg.LinAlgError, ValueError):       # this method found no stabilising solution
            continue
        if left < least:
            best, least = X, left
        if least <= RESIDUAL:
            break
    if best is None:
        raise AssumptionError(UNSETTLED)
    return best


def _double(A: Real, G: Real, H: Real) -> Real:
    """The limit of H: 2^k steps of H+ = H0 + A'H (I + G H)^-1 A from zero. Chu et al. (2004), Algorithm SDA."""
    n = len(A)
    for _ in range(DOUBLINGS):
        V = np.linalg.solve(np.eye(n) + G @ H, np.hstack([A, G]))          # (I + G H)^-1 [A, G]
        step = A.T @ (H @ V[:, :n])
        G = G + _symmetric(A @ V[:, n:] @ A.T)
        A = A @ V[:, :n]
        H = H + _symmetric(step)
        if not np.isfinite(H).all():
            break
        if _settled(step, H):
            return H
    raise np.linalg.LinAlgError("doubling does not settle")


def _without_cross_term(A: Real, B: Real, Q: Real, R: Real, N: Real) -> tuple[Real, Real, Real]:
    """A - B R^-1 N', B R^-1 B' and Q - N R^-1 N'."""
    back = _solve(R, np.hstack([B.T, N.T]))
    n = len(A)
    return A - B @ back[:, n:], _symmetric(B @ back[:, :n]), _symmetric(Q - N @ back[:, n:])


def _cayley(A: Real, G: Real, H: Real) -> tuple[Real, Real, Real]:
    """The discrete problem with the same X. Chu, Fan, Lin (2005), (2.8)."""
    identity, γ = np.eye(len(A)), _geometric_mean(np.block([[A, -G], [-H, -A.T]]))
    shifted = A - γ * identity
    W = shifted.T + H @ np.linalg.solve(shifted, G)
    back = np.linalg.solve(W, np.hstack([identity, H]))                    # W^-1 [I, H]
    A0 = identity + 2 * γ * back[:, : len(A)].T
    G0 = 2 * γ * np.linalg.solve(shifted, G @ back[:, : len(A)])
    H0 = 2 * γ * np.linalg.solve(shifted.T, back[:, len(A) :].T).T
    return A0, _symmetric(G0), _symmetric(H0)


def _balance(A: Real, B: Real, Q: Real, R: Real, N: Real) -> tuple[Real, ...]:
    """T, and the problem in the states T x: units, powers of two, in which the Hamiltonian matrix is balanced."""
    from scipy.linalg import matrix_balance

    n, weight = len(A), np.abs(np.diagonal(R))
    G = (B / np.where(weight > 0, weight, 1.0)) @ B.T
    with np.errstate(invalid="ignore"):  # of permutations, which are not asked for
        scale = np.log2(matrix_balance(np.abs(np.block([[A, G], [Q, A.T]])), permute=False, separate=True)[1][0])
    T = 2.0 ** np.round((scale[n:] - scale[:n]) / 2)
    return T, A * (T[:, None] / T), T[:, None] * B, Q / (T[:, None] * T), N / T[:, None]


def _in_units(T: Real, X: Real, K: Real, A: Real, B: Real) -> Riccati:
    return Riccati(X * (T[:, None] * T), K * T, (A - B @ K) * (T / T[:, None]))


def _geometric_mean(A: Real) -> float:
    """The geometric mean of the moduli of A's eigenvalues: a shift that suits both fast and slow modes."""
    largest = np.abs(A).max()
    mean = np.exp(np.linalg.slogdet(A)[1] / len(A))
    return max(float(mean), 1e-8 * float(largest)) or 1.0


def _solve(R: Real, B: Real) -> Real:
    """R^-1 B for symmetric R; an error where R, scaled to unit diagonal, is singular."""
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = 1 / np.sqrt(np.abs(np.diagonal(R)))
    scaled = scale[:, None] * R * scale
    if not np.isfinite(scaled).all() or np.linalg.cond(scaled) > SINGULAR:
        raise np.linalg.LinAlgError("singular")
    return scale[:, None] * np.linalg.solve(scaled, scale[:, None] * B)


def _settled(step: Real, X: Real) -> bool:
    """Whether a step is rounding, entry by entry, relative to the diagonal of X."""
    size = np.sqrt(np.abs(np.diagonal(X)))
    return bool(np.all(np.abs(step) <= EPS * size[:, None] * size))


def _symmetric(X: Real) -> Real:
    return (X + X.T) / 2
