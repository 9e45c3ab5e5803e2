"""||A^k|| or ||e^{At}|| over time for many A at once, to a fraction of a percent. It draws curves; `decay` proves bounds.

Letters: A (b, n, n) stable; a (b, k) the norms at times t (b, k), in samples or seconds; α a decay rate, γ(α) its overshoot,
ρ = α / γ (discrete: (1 - e^{-α}) / γ). Steps grow as the motion dies out: a step turns or shrinks the rest by a tenth.

References: R. W. Bass (2005), ρ and the bandwidth; N. J. Higham, Functions of Matrices (2008), (6.29) and §11.5 (logarithm).
"""

from typing import NamedTuple

import numpy as np

from .shapes import Float

Real = np.ndarray
SMALLEST = 1e-6       # norm at which a curve ends
STEP = 0.1            # largest turn or decrease of the motion in one step, at first
GROWTH = 1.005        # of `STEP`, per step: late oscillations count less
MOST = 1200           # steps
LEVELS = 40           # of step lengths, each twice the one before
SETTLED = 0.05        # of its start, below which a motion has died out
LARGE = 24            # rows above which norms are found by iteration
BLOCK, POWERS = 4, 3  # vectors and rounds of this iteration
NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)


class Courses(NamedTuple):
    """a at t (b, k), both constant after the end of a curve; ∫ a dt or Σ a (b,); ∫ of the norm of each row (b, n)."""

    t: Real
    a: Real
    total: Real
    rows: Real


def courses(A: Float[Real, "b n n"], continuous: bool) -> Courses:
    """The norms of e^{At} or A^k until they are below `SMALLEST`. Cost: about 200 products and singular values a matrix."""
    b, n = A.shape[:2]
    h = STEP / 2 / np.linalg.norm(A, ord=2, axis=(1, 2)) if continuous else np.ones(b)
    leaps = _leaps(A * h[:, None, None], continuous)
    rate = A if continuous else A - np.eye(n)                              # of change, per second or sample
    M, t = np.broadcast_to(np.eye(n), A.shape).copy(), np.zeros(b)
    ts, norms, rows = [t.copy()], [np.ones(b)], [np.ones((b, n))]
    going, V = np.arange(b), np.broadcast_to(np.random.default_rng(0).normal(size=(n, BLOCK)), (b, n, BLOCK)).copy()
    for k in range(MOST):
        now = M[going]
        speed = _size(rate[going] @ now) / _size(now)
        with np.errstate(divide="ignore"):
            level = np.log2(STEP * GROWTH**k / (speed * h[going]))
        j = np.clip(level, 0, LEVELS - 1).astype(int)
        M[going] = leaps[j, going] @ now
        t[going] += h[going] * 2.0**j
        ts.append(t.copy())
        norms.append(np.where(np.isin(np.arange(b), going), 0.0, norms[-1]))
        norms[-1][going], V[going] = _norms(M[going], V[going])
        rows.append(np.linalg.norm(M, axis=2))
        going = going[norms[-1][going] > SMALLEST]
        if len(going) == 0:
            break
    t, a, rows = np.stack(ts, 1), np.stack(norms, 1), np.stack(rows, 1)
    return Courses(t, a, _total(t, a[..., None], continuous)[:, 0], _total(t, rows, continuous))


def _norms(M: Real, V: Real) -> tuple[Real, Real]:
    """||M||, and the vectors V (b, n, `BLOCK`) that attain it. For large M: block power iteration from the previous vectors."""
    if M.shape[-1] <= LARGE:
        return np.linalg.norm(M, ord=2, axis=(1, 2)), V
    for _ in range(POWERS):
        V = np.linalg.qr(M.swapaxes(1, 2) @ (M @ V))[0]
    return np.linalg.svd(M @ V, compute_uv=False)[:, 0], V


def _leaps(A: Real, continuous: bool) -> Real:
    """The motion over 2^j steps, (levels, b, n, n). In continuous time the norm of A is 1/20 at most."""
    leap = A if not continuous else _short_exponential(A)
    leaps = [leap]
    for _ in range(LEVELS - 1):
        leaps.append(leaps[-1] @ leaps[-1])
    return np.stack(leaps)


def _short_exponential(A: Real) -> Real:
    """Taylor's series."""
    term = E = np.broadcast_to(np.eye(A.shape[-1]), A.shape)
    for k in range(1, 10):
        term = term @ A / k
        E = E + term
    return E


def _size(M: Real) -> Real:
    return np.maximum(np.linalg.norm(M, axis=(1, 2)), 1e-300)


def _total(t: Real, a: Real, continuous: bool) -> Real:
    """∫ a dt by trapezoids, or Σ a with straight lines between two times."""
    h = np.diff(t, axis=1)[..., None]
    rise = h / 2 if continuous else np.maximum(h - 1, 0.0) / 2             # Σ_{i<h} (a0 + i (a1 - a0) / h)
    return np.sum(h * a[:, :-1] + rise * np.diff(a, axis=1), axis=1)


def margins(A: Float[Real, "b n n"], found: Courses, continuous: bool) -> Float[Real, " b"]:
    """The largest ρ over α: log ρ is concave in α. Its slope is 1/α - t (1/(e^α - 1) - t), with t where γ is attained."""
    t, z = found.t, np.linalg.eigvals(A)
    with np.errstate(divide="ignore"):
        log_a = np.maximum(np.log(found.a), -700.0)
        slowest = -z.real.max(axis=1) if continuous else np.minimum(-np.log(np.abs(z).max(axis=1)), 50.0)
    low, high = np.zeros(len(t)), slowest
    for _ in range(50):
        α = (low + high) / 2
        worst = np.take_along_axis(t, np.argmax(log_a + α[:, None] * t, axis=1)[:, None], 1)[:, 0]
        rises = worst * (α if continuous else np.expm1(α)) < 1
        low, high = np.where(rises, α, low), np.where(rises, high, α)
    γ = np.exp(np.max(log_a + low[:, None] * t, axis=1))
    return (low if continuous else -np.expm1(-low)) / γ


def settling(found: Courses) -> Float[Real, " b"]:
    """The time from which the norm stays below `SETTLED`; NaN where the curve ends before."""
    t, a = found.t, found.a
    after = a.shape[1] - np.argmax((a > SETTLED)[:, ::-1], axis=1)                        # the first row after the last one above
    ends, first = np.minimum(after, a.shape[1] - 1), np.arange(len(t))
    log_before, log_after = (np.log(np.maximum(a[first, k], 1e-300)) for k in (ends - 1, ends))
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (log_before - np.log(SETTLED)) / (log_before - log_after)
    when = t[first, ends - 1] + share * (t[first, ends] - t[first, ends - 1])
    return np.where(after < a.shape[1], when, np.nan)


def bandwidth(A: Float[Real, "b n n"]) -> Float[Real, " b"]:
    """ω_BW = sqrt(σ_min σ_max) of each A. Bass (2005)."""
    σ = np.linalg.svd(A, compute_uv=False)
    return np.sqrt(σ[:, 0] * σ[:, -1])


def logarithm(A: Float[Real, "b n n"]) -> Float[Real, "b n n"]:
    """log A by square roots until A is near I; NaN where A has an eigenvalue on the negative axis or at zero.

    Higham (2008) §11.5, with Gauss-Legendre quadrature of log(I + X) = ∫_0^1 X (I + s X)^-1 ds.
    """
    n, found = A.shape[-1], np.full(A.shape, np.nan)
    z = np.linalg.eigvals(A)
    able = np.flatnonzero(~np.any((np.abs(z.imag) <= 1e-9 * np.abs(z)) & (z.real <= 1e-12), axis=1))
    root, roots = A[able], 0
    while len(able) and np.linalg.norm(root - np.eye(n), axis=(1, 2)).max() > 0.25 and roots < 60:
        root, roots = _square_root(root), roots + 1
    X = root - np.eye(n)
    s, w = (NODES + 1) / 2, WEIGHTS / 2
    found[able] = 2.0**roots * sum(w[i] * np.linalg.solve(np.eye(n) + s[i] * X, X) for i in range(len(s)))
    return found


def _square_root(A: Real) -> Real:
    """Product form of Denman and Beavers, scaled by the determinant. Higham (2008) (6.29)."""
    n = A.shape[-1]
    M, X = A, A
    for i in range(40):
        μ = np.exp(-np.linalg.slogdet(M)[1] / (2 * n))[:, None, None] if i < 8 else 1.0
        X, M = μ * X, μ**2 * M
        back = np.linalg.inv(M)
        X = X @ (np.eye(n) + back) / 2
        M = (np.eye(n) + (M + back) / 2) / 2
        if np.linalg.norm(M - np.eye(n), axis=(1, 2)).max() < 1e-13 * n:
            break
    return X
