"""Products and orthogonalisations of small matrices, written so that a compiler can fuse them.

Up to `SMALL` rows the loops are unrolled (measured in a scan on a CPU: 3x faster than calls to a matrix library,
which cannot be fused); above it they call the library or loop at run time. Nothing here is batched LAPACK, which can
deadlock inside a compiled function: mapped over a batch, LAPACK takes one matrix after another.
"""

from collections.abc import Callable
from contextlib import suppress
from functools import reduce
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.core import Tracer

from .shapes import Bool, Float, Inexact

SMALL = 8
INDEPENDENT = 1e-3      # share of a variance that must remain for N N' to lose at most three digits of sixteen
Real = jax.Array | np.ndarray
Scalar = Real | float                 # one number; an entry of an array of NumPy is a float
Flag = Real | np.bool_ | bool           # one bool
Parts = tuple[Real, ...]
Carry = TypeVar("Carry")  # an array, or a tree of arrays


def product(A: Float[Real, "n k"], B: Float[Real, "k m"]) -> Float[Real, "n m"]:
    """A B."""
    if max(A.shape + B.shape) > 2 * SMALL:
        return jnp.asarray(A) @ B
    return jnp.sum(A[:, :, None] * B[None, :, :], axis=1)


def apply(A: Float[Real, "n k"], x: Float[Real, " k"]) -> Float[Real, " n"]:
    """A x."""
    if max(A.shape) > 2 * SMALL:
        return jnp.asarray(A) @ x
    return jnp.sum(A * x[None, :], axis=1)


def gram(Z: Float[Real, "n k"]) -> Float[Real, "n n"]:
    """Z Z', symmetric to the last bit and positive semidefinite."""
    if max(Z.shape) <= 2 * SMALL:
        return jnp.sum(Z[:, None, :] * Z[None, :, :], axis=2)
    P = jnp.asarray(Z) @ Z.T
    return (P + P.T) / 2


def sums_after(A: Float[Real, "... k"]) -> Float[Real, "... k"]:
    """For each entry, the sum of those after it along the last axis."""
    k = A.shape[-1]
    if k > SMALL:
        from_each_on = lax.cumsum(jnp.asarray(A), axis=A.ndim - 1, reverse=True)
        return jnp.concatenate([from_each_on[..., 1:], jnp.zeros((*A.shape[:-1], 1))], axis=-1)
    after = np.tri(k, k, -1).reshape((1,) * (A.ndim - 1) + (k, k))
    return jnp.sum(A[..., :, None] * after, axis=-2)


def repeat(count: int, step: Callable[[Any, Carry], Carry], carry: Carry) -> Carry:
    """`carry = step(j, carry)` for j = 0 .. count - 1: unrolled when small, a loop at run time otherwise."""
    if count > SMALL:
        return lax.fori_loop(0, count, step, carry)
    for j in range(count):
        carry = step(j, carry)
    return carry


def triangularise(*N: Float[Real, "n _"]) -> Float[Real, "n n"]:
    """The lower triangular L with L L' = N N' for an N in parts side by side, each row to rounding relative to its norm.

    By modified Gram-Schmidt where it is unrolled; above, by Cholesky's factor of N N' where that is as accurate, in half the
    time, else by Householder's QR. A row that depends on those above it has zero, or rounding, on the diagonal.
    """
    n, k = len(N[0]), sum(part.shape[1] for part in N)
    if n <= SMALL or k < n:
        return gram_schmidt(side_by_side(N))
    return _triangularise(tuple(jnp.asarray(part) for part in N))


def side_by_side(N: tuple[Float[Real, "n _"], ...]) -> Float[Real, "n k"]:
    """The parts of N as one matrix."""
    return N[0] if len(N) == 1 else jnp.concatenate(N, axis=1)


@jax.custom_jvp
def _triangularise(N: tuple[Float[Real, "n _"], ...]) -> Float[Real, "n n"]:
    return _by_library(N)


@_triangularise.defjvp
def _triangularise_jvp(values: tuple[Parts], tangents: tuple[Parts]) -> tuple[Real, Real]:
    return _triangularise(*values), jax.jvp(lambda N: gram_schmidt(side_by_side(N)), values, tangents)[1]


@jax.custom_batching.sequential_vmap
def _by_library(N: tuple[Float[Real, "n _"], ...]) -> Float[Real, "n n"]:
    """`triangularise` by LAPACK, one matrix after another."""
    L, good = cholesky(reduce(jnp.add, map(gram, N)))                  # of a constant part, once
    return lax.cond(jnp.all(good), lambda N, L: L, lambda N, L: householder(side_by_side(N)), N, L)


def cholesky(P: Float[Real, "n n"]) -> tuple[Float[Real, "n n"], Bool[Real, " n"]]:
    """Cholesky's factor, and the rows with enough variance left, given those above, for it to be accurate. Not to be batched."""
    P = jnp.asarray(P)
    L = lax.linalg.cholesky(P, symmetrize_input=False)
    return L, diagonal(L) ** 2 >= INDEPENDENT * diagonal(P)


def householder(N: Float[Real, "n k"]) -> Float[Real, "n n"]:
    """`triangularise` by Householder's QR of N'."""
    L = lax.linalg.qr(N.T, full_matrices=False)[1].T
    return L * jnp.where(diagonal(L) < 0, -1.0, 1.0)[None, :]


def diagonal(P: Float[Real, "n n"]) -> Float[Real, " n"]:
    """The diagonal of a square matrix."""
    return jnp.ravel(P)[:: len(P) + 1]


def gram_schmidt(N: Float[Real, "n k"]) -> Float[Real, "n n"]:
    """`triangularise` by modified Gram-Schmidt on the rows of N.

    L is as accurate as that of Householder's QR, for any units and rank (Björck, BIT 7, 1967).
    """
    return orthogonalise(N, N.shape[0])[1]


def orthogonalise(
    N: Float[Real, "n k"], count: int, floor: Float[Real, " m"] | None = None
) -> tuple[Float[Real, "n k"], Float[Real, "n m"]]:
    """Modified Gram-Schmidt: the rows of N after the first `count`, less their projections on these, and the projections.

    `floor`: a row of which less than this is left, in squares, is taken as zero. This rare loop is never unrolled.
    """
    n = N.shape[0]

    def take(j: int | Real, carry: tuple[Real, Real]) -> tuple[Real, Real]:
        """Subtract row j from the rows below it, and store its coefficients."""
        N, L = carry
        done = j if isinstance(j, int) else 0                          # rows above are zero: left out where j is known
        g, rest = N[j], N[done:]
        h = apply(rest, g)                                             # h_j = |g|²
        if floor is not None:
            h = jnp.where(h[j - done] > floor[j], h, 0.0)
        norm = jnp.where(h[j - done] > 0, h[j - done], 1.0)
        inverse = 1 / norm
        root = jnp.where(h[j - done] > 0, jnp.sqrt(norm), 0.0)                              # |g|
        common = jnp.where(jnp.arange(done, n) > j, h, 0.0) * (inverse * root)              # of later rows with g / |g|
        common = jnp.where(jnp.arange(done, n) == j, root, common)
        N = jnp.concatenate([N[:done], rest - (h * inverse)[:, None] * g[None, :]])
        column = jnp.concatenate([jnp.zeros(done), common])
        return N, jnp.where(jnp.arange(count)[None, :] == j, column[:, None], L)

    start = jnp.asarray(N), jnp.zeros((n, count))
    return repeat(count, take, start) if floor is None else lax.fori_loop(0, count, take, start)


@jax.custom_jvp
def settled(L: Float[Real, "n n"], before: Float[Real, "n n"]) -> Float[Real, "n n"]:
    """`before` where L differs from it by rounding only, else L; derivatives are those of L.

    A recursion that converges therefore ends in one matrix, not in a cycle of its last digits.
    """
    moved, rounding = jnp.sum((L - before) ** 2, axis=1), max(8, len(L) / 8) * np.finfo(float).eps
    return jnp.where(settles(jnp.all(moved <= rounding**2 * jnp.sum(before**2, axis=1))), before, L)


def held(M: Float[Real, "n k"], before: Float[Real, "n k"]) -> Float[Real, "n k"]:
    """`before` where M equals it to the last bit, else M: M itself, but an engine need not compute again what follows from it."""
    same = (before == M) | ((M != M) & (before != before))                                 # NaN after NaN too
    return jnp.where(settles(jnp.all(same)), before, M)


@jax.jit
def settles(only_rounding: Flag) -> Flag:
    """The choice of `settled` and `held`, as a named step: an engine that detects no steady state may omit it."""
    return only_rounding


@settled.defjvp
def _settled_jvp(values: tuple[Real, Real], tangents: tuple[Real, Real]) -> tuple[Real, Real]:
    return settled(*values), tangents[0]


def solve_lower(L: Float[Real, "n n"], B: Float[Real, "n k"], *, transpose: bool = False) -> Float[Real, "n k"]:
    """L^-1 B for a lower triangular L, or L'^-1 B; zero where a diagonal entry of zero leaves the result undetermined."""
    if transpose:
        return solve_upper(jnp.asarray(L).T, B)
    n = L.shape[0]

    def eliminate(j: int | Real, B: Real) -> Real:
        """Eliminate unknown j from the rows below."""
        pivot = L[j, j]
        row = jnp.where(pivot != 0, B[j] / jnp.where(pivot != 0, pivot, 1.0), 0.0)
        below = jnp.where(jnp.arange(n) > j, L[:, j], 0.0)
        return jnp.where((jnp.arange(n) == j)[:, None], row[None, :], B - below[:, None] * row[None, :])

    return repeat(n, eliminate, jnp.asarray(B))


def solve_upper(U: Float[Real, "n n"], B: Float[Real, "n k"]) -> Float[Real, "n k"]:
    """U^-1 B for an upper triangular U, with zeros as in `solve_lower`."""
    return solve_lower(jnp.asarray(U)[::-1, ::-1], jnp.asarray(B)[::-1])[::-1]


def factor(P: Float[Real, "n n"]) -> Float[Real, "n n"]:
    """A lower triangular L with L L' = P for a positive semidefinite P; a zero pivot gives a zero column.

    A pivot below n eps P_jj is rounding and is taken as zero.
    """
    n, P = P.shape[0], jnp.asarray(P)
    P = (P + P.T) / 2                                                  # so that derivatives are symmetric too
    floor = n * np.finfo(float).eps * diagonal(P)

    def eliminate(j: int | Real, carry: tuple[Real, Real]) -> tuple[Real, Real]:
        """Subtract the outer product of column j of L from the rest of P."""
        P, L = carry
        pivot = P[j, j]
        positive = pivot > floor[j]
        common = jnp.where(jnp.arange(n) >= j, P[:, j], 0.0) / jnp.sqrt(jnp.where(positive, pivot, 1.0))
        common = jnp.where(positive, common, 0.0)
        return P - common[:, None] * common[None, :], jnp.where(jnp.arange(n)[None, :] == j, common[:, None], L)

    return repeat(n, eliminate, (jnp.asarray(P), jnp.zeros((n, n))))[1]


def factors(P: Inexact[Real, "... n n"]) -> Inexact[Real, "... n n"]:
    """`factor` of every matrix in a stack. Known numbers are factored in NumPy, without compilation."""
    return traced_factors(P) if isinstance(P, Tracer) else known_factors(P)


traced_factors = jax.jit(jnp.vectorize(factor, signature="(n,n)->(n,n)"))


def known_factors(P: Inexact[Real, "... n n"]) -> Inexact[Real, "... n n"]:
    """`factor` of all matrices at once: by LAPACK where no pivot is taken as zero."""
    P = np.asarray(P)
    P = (P + np.swapaxes(P, -1, -2)) / 2
    floor = P.shape[-1] * np.finfo(float).eps * np.diagonal(np.real(P), axis1=-2, axis2=-1)
    if np.iscomplexobj(P):  # a derivative by `models.complex_step`: LAPACK conjugates
        return _eliminated(P, floor)
    with suppress(np.linalg.LinAlgError):
        L = np.linalg.cholesky(P)
        if (np.diagonal(L, axis1=-2, axis2=-1) ** 2 > floor).all():
            return L
    return _eliminated(P, floor)


def _eliminated(left: Inexact[np.ndarray, "... n n"], floor: Float[np.ndarray, "... n"]) -> Inexact[np.ndarray, "... n n"]:
    """The factors, column after column; a pivot below `floor` is taken as zero. `left` is overwritten."""
    n, L = left.shape[-1], np.zeros_like(left)
    for j in range(n):
        pivot = left[..., j, j]
        positive = np.real(pivot) > floor[..., j]
        common = left[..., j:, j] / np.sqrt(np.where(positive, pivot, 1.0))[..., None]
        L[..., j:, j] = np.where(positive[..., None], common, 0.0)
        left[..., j:, j:] -= L[..., j:, j, None] * L[..., None, j:, j]
    return L
