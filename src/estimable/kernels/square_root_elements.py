"""Samples as elements that compose: the state after N samples, and the information in them. NumPy, outside jit.

An element of N samples leads from coordinates c (the state before them, or white numbers of unit variance with x = B c) to x,

    x = Φ c + (known from the samples) + e,   cov e = S S',   and the samples' information about c is Z'Z               (1)

which is the five-tuple of the reference without its means, by factors. A prior is an element too, with c white: Φ = [L D],
Z = [I 0]. Then everything is composition (2), which adds and never subtracts in S and Z:

    W = Z2 S1,  X'X = I + W'W,  Y'Y = I + W W'
    S S' = Φ2 S1 (X'X)^-1 S1'Φ2' + S2 S2',   Z'Z = Φ1'Z2' (Y'Y)^-1 Z2 Φ1 + Z1'Z1
    Φ = Φ2 M Φ1,   M = (I + S1 S1' Z2'Z2)^-1 = I - S1 (X'X)^-1 W' Z2                                                  (2)

A source is a part of the noises. With the samples z = Z c + ζ, ζ of unit variance, each source has its part in the errors e and ζ
of an element, whose gains stay the optimal ones. Of two elements, with η = Z2 e1 + ζ2 and the triangle R = Q'[Y^-T Z2 Φ1; Z1],

    e = Φ2 (e1 - S1 S1'Z2' (Y'Y)^-1 η) + e2,   ζ = Q'[Y^-T η; ζ1]                                                     (3)

The parts of all sources and of the prior add up to the variance, and each is the derivative with respect to the relative size of
its source, as optimal gains are stationary.

References: S. Särkkä, Á. F. García-Fernández, IEEE TAC 66 (2021) 299-306, Lemma 8; M. Morf, T. Kailath, IEEE TAC 20 (1975)
487-497 (arrays); P. de Jong, Ann. Statist. 19 (1991) 1073-1083 (diffuse).
"""

from typing import Any, NamedTuple

import numpy as np

from .shapes import Float

Real = np.ndarray
NULL = 1e-12  # singular value of Z with columns of norm 1, of the largest, below which a direction is not determined


class Element(NamedTuple):
    """(1)."""

    Φ: Float[Real, "n r"]
    S: Float[Real, "n s"]
    Z: Float[Real, "z r"]


class Source(NamedTuple):
    """The part of one source in e and in ζ, as factors with common columns."""

    e: Float[Real, "n a"]
    ζ: Float[Real, "z a"]


def of_prior(L: Float[Real, "n l"], D: Float[Real, "n d"]) -> Element:
    """A prior of covariance L L', with directions D of infinite variance."""
    n, count = L.shape
    return Element(np.hstack([L, D]), np.zeros((n, 0)), np.eye(count, count + D.shape[1]))


def of_sample(C: Float[Real, "p n"], V: Float[Real, "p v"]) -> Element:
    """One sample y = C x + V v, the state unmoved."""
    n = C.shape[1]
    return Element(np.eye(n), np.zeros((n, 0)), solve_lower(lower(V), C))


def of_step(A: Float[Real, "n n"], g: Float[Real, "n w"], C: Float[Real, "p n"], V: Float[Real, "p v"]) -> Element:
    """A step and the sample after it: x+ = A x + g w, y = C x+ + V v. With p = 0 no sample is seen."""
    s, K, S = _array(g, C, V)
    E = solve_lower(s, C @ A)
    return Element(A - K @ E, S, E)


def _array(g: Real, C: Real, V: Real) -> tuple[Real, Real, Real]:
    """[[V, C g], [0, g]] = [[s, 0], [K, S]] times a rotation."""
    p, n, v = len(C), len(g), V.shape[1]
    both = lower(np.vstack([np.hstack([V, C @ g]), np.hstack([np.zeros((n, v)), g])]))
    return both[:p, :p], both[p:, :p], both[p:, p:]


def sources_of_step(g: list[Real], C: Real, V: list[Real]) -> list[Source]:
    """The sources of `of_step`, with g and V given by source (columns of both add up to those of the step)."""
    s, K, _ = _array(np.hstack([np.zeros((C.shape[1], 0)), *g]), C, np.hstack(V))
    ζ = [solve_lower(s, C @ each) for each in g]
    of_noise = [Source(each - K @ one, one) for each, one in zip(g, ζ, strict=True)]      # (I - K s^-1 C) g
    ζ = [solve_lower(s, each) for each in V]
    return [*of_noise, *(Source(-K @ one, one) for one in ζ)]


def then(a: Element, b: Element) -> Element:
    """Element a, then element b, (2)."""
    W = b.Z @ a.S
    X, Y = _factors(W)
    E = b.Z @ a.Φ
    half = _right(a.S, X)                                                    # S1 X^-1
    Φ = b.Φ @ (a.Φ - half @ solve_lower(X.T, W.T @ E))
    S = compressed(np.hstack([b.Φ @ half, b.S]))
    return Element(Φ, S, compressed(np.vstack([solve_lower(Y.T, E), a.Z]).T).T)


def sources_then(a: Element, of_a: list[Source], b: Element, of_b: list[Source]) -> tuple[Element, list[Source]]:
    """`then(a, b)` and its sources, (3)."""
    W = b.Z @ a.S
    _, Y = _factors(W)
    stacked = np.vstack([solve_lower(Y.T, b.Z @ a.Φ), a.Z])
    Q, R = np.linalg.qr(stacked) if len(stacked) > stacked.shape[1] else (np.eye(len(stacked)), stacked)
    both, n = then(a, b)._replace(Z=R), len(a.Φ)
    found = []
    for one, two in zip(of_a, of_b, strict=True):
        columns = [np.zeros((len(M), k)) for M, k in ((one.e, two.e.shape[1]), (one.ζ, two.e.shape[1]))]
        e1, ζ1 = np.hstack([one.e, columns[0]]), np.hstack([one.ζ, columns[1]])
        e2, ζ2 = (np.hstack([np.zeros((len(M), one.e.shape[1])), M]) for M in two)
        η = solve_lower(Y.T, b.Z @ e1 + ζ2)
        e = b.Φ @ (e1 - a.S @ (W.T @ _back(Y, η))) + e2
        part = compressed(np.vstack([e, Q.T @ np.vstack([η, ζ1])]))
        found.append(Source(part[:n], part[n:]))
    return both, found


def _back(R: Real, B: Real) -> Real:
    """R^-1 B, R upper triangular."""
    from scipy.linalg import solve_triangular

    return solve_triangular(R, B, check_finite=False) if B.size else B


def _factors(W: Real) -> tuple[Real, Real]:
    z, s = W.shape
    return upper(np.vstack([np.eye(s), W])), upper(np.vstack([np.eye(z), W.T]))


class StateError(NamedTuple):
    """F F' the covariance of x; N the directions of x of infinite variance; Z⁺, with which F = [S, Φ Z⁺]."""

    F: Float[Real, "n f"]
    N: Float[Real, "n k"]
    inverse: Float[Real, "r z"]


def state_error(E: Element) -> StateError:
    """The error of the estimate of x, for an element that begins with a prior.

    >>> known = then(of_prior(np.eye(1), np.zeros((1, 0))), of_sample(np.eye(1), np.eye(1)))
    >>> round(float(state_error(known).F[0, 0] ** 2), 12)
    0.5
    """
    n, r = E.Φ.shape
    size = np.linalg.norm(E.Z, axis=0)
    size = np.where(size > 0, size, 1.0)
    Q, T = np.linalg.qr(E.Z / size) if E.Z.size else (E.Z[:, :0], E.Z[:0])
    determined = len(T) == r and (r == 0 or _regular(T))
    if determined:
        back, N = _right(np.eye(r), T) / size[:, None], np.zeros((n, 0))
    else:
        U, σ, Vt = np.linalg.svd(T, full_matrices=True)
        σ = np.append(σ, np.zeros(r - len(σ)))
        seen = σ > NULL * σ.max(initial=0.0)
        V = Vt.T / size[:, None]
        Q, back, N = Q @ U[:, : np.count_nonzero(seen)], V[:, seen] / σ[seen], E.Φ @ V[:, ~seen]
    return StateError(np.hstack([E.S, E.Φ @ back]), N, back @ Q.T)


def _regular(T: Real) -> bool:
    """Whether no singular value of a triangle is null: by the estimate of its condition, else by all singular values."""
    import scipy.linalg

    lapack: Any = scipy.linalg.lapack
    return bool(lapack.dtrcon(T)[0] > 1e3 * NULL) or bool(np.linalg.svd(T, compute_uv=False)[-1] > NULL)


def share(E: Element, source: Source, inverse: Float[Real, "r z"], H: Float[Real, "q n"]) -> Float[Real, " q"]:
    """The variance of H x that belongs to a source, with the inverse of `state_error`."""
    return lengths(H @ source.e - (H @ E.Φ) @ (inverse @ source.ζ)) ** 2


def lengths(M: Float[Real, "q f"]) -> Float[Real, " q"]:
    """The norms of rows, also of rows whose squares overflow."""
    size = np.abs(M).max(axis=1, initial=0.0)
    with np.errstate(over="ignore", invalid="ignore"):
        unit = M / np.where((size > 0) & np.isfinite(size), size, 1.0)[:, None]
        return np.where(np.isfinite(size), size * np.sqrt(np.sum(unit**2, axis=1)), np.inf)


def upper(M: Float[Real, "m n"]) -> Float[Real, "k n"]:
    """R with R'R = M'M, upper triangular."""
    if 0 in M.shape:
        return np.zeros((0, M.shape[1]))
    triangle: Any = np.linalg.qr(M, mode="r")
    return triangle


def lower(M: Float[Real, "m n"]) -> Float[Real, "m k"]:
    """L with L L' = M M', lower triangular."""
    return upper(M.T).T


def compressed(M: Float[Real, "m n"]) -> Float[Real, "m k"]:
    """M, or a factor with the same M M' of at most as many columns as rows."""
    return lower(M) if M.shape[1] > len(M) else M


def solve_lower(L: Float[Real, "p p"], B: Float[Real, "p k"]) -> Float[Real, "p k"]:
    """L^-1 B."""
    from scipy.linalg import solve_triangular

    if 0 in B.shape:
        return np.zeros(B.shape)
    return solve_triangular(L, B, lower=True, check_finite=False)


def _right(B: Real, R: Real) -> Real:
    """B R^-1, R upper triangular."""
    return solve_lower(R.T, B.T).T
