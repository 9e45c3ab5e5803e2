"""What a stretch of samples does to a belief: the elements whose sums over windows a scan works out.

Letters: a stretch leads from x, the state before its first sample, to x+, that before the first sample after it. Given its
samples, x+ = A x + b + Z ξ with ξ unit white, and what they say of x is z = H x + ε with ε unit white (a row of zeros says
nothing). Two stretches one after the other are one again, whichever is worked out first: sums over all windows of a length
take three such steps a sample (suffixes of blocks of that length, prefixes, and one sum of both).

References: S. Särkkä, Á. F. García-Fernández, IEEE TAC 66 (2021) 299-306, Lemma 8, here with factors for covariances;
M. van Herk, Pattern Recognition Letters 13 (1992) 517-521 (windows by blocks).
"""

from typing import Any

import jax.numpy as jnp

from ..frozen import frozen
from . import kalman
from .shapes import Bool, Float
from .small import Real, apply, product, solve_lower, triangularise

ROUNDING = 1e-13  # a pivot this far below the column that it is left of says nothing


@frozen
class Stretch:
    """x+ = A x + b + Z ξ, and z = H x + ε."""

    A: Any
    b: Any
    Z: Any
    H: Any
    z: Any


def empty(n: int) -> Stretch:
    """No sample: nothing moves, nothing is said."""
    zeros = jnp.zeros((n, n))
    return Stretch(jnp.eye(n), jnp.zeros(n), zeros, zeros, jnp.zeros(n))


def of_sample(
    F: Float[Real, "n n"],
    c: Float[Real, " n"],
    W: Float[Real, "n q"],
    C: Float[Real, "p n"],
    r: Float[Real, " p"],
    residual: Float[Real, " p"],
    seen: Bool[Real, " p"],
) -> Stretch:
    """One sample `residual` = y - d = C x + r e, entry by entry and r > 0, then x+ = F x + c + W e'; e, e' independent."""
    return Stretch(F, c, W, jnp.where(seen[:, None], C / r[:, None], 0.0), jnp.where(seen, residual / r, 0.0))


def joined(a: Stretch, b: Stretch) -> Stretch:
    """Stretch a, then stretch b."""
    s, n = b.H.shape
    # what b says of the state between them, whose factor is a.Z and which is a.A x + a.b on average
    array = [jnp.concatenate([product(b.H, a.Z), jnp.eye(s)], axis=1), jnp.concatenate([a.Z, jnp.zeros((n, s))], axis=1)]
    both = triangularise(jnp.concatenate(array))
    L, G, Z = both[:s, :s], both[s:, :s], both[s:, s:]
    E, e = product(b.H, a.A), b.z - apply(b.H, a.b)
    told = solve_lower(L, jnp.concatenate([E, e[:, None]], axis=1))        # of x, white
    A, mean = a.A - product(G, told[:, :-1]), a.b + apply(G, told[:, -1])
    moved = triangularise(jnp.concatenate([product(b.A, Z), b.Z], axis=1))
    H, z = _fewest(jnp.concatenate([a.H, told[:, :-1]]), jnp.concatenate([a.z, told[:, -1]]))
    return Stretch(product(b.A, A), apply(b.A, mean) + b.b, moved, H, z)


def _fewest(H: Float[Real, "s n"], z: Float[Real, " s"]) -> tuple[Real, Real]:
    """The same said in n rows: the triangular factor of (H, z)."""
    n = H.shape[1]
    columns = jnp.concatenate([H, z[:, None]], axis=1).T
    R = triangularise(columns).T[:n]
    pivots, peaks = jnp.sum(R[:, :n] * jnp.eye(n), axis=1), jnp.sum(columns[:n] ** 2, axis=1)
    R = jnp.where((pivots**2 > ROUNDING**2 * peaks)[:, None], R, 0.0)
    return R[:, :n], R[:, n]


def through(m, Z, X, size, log_scale, stretch: Stretch) -> kalman.Prediction:
    """The belief after a stretch, from that before it; letters as in `kalman`."""
    H, n = stretch.H, stretch.H.shape[0]
    seen = jnp.max(jnp.abs(H), axis=1) > 0
    post = kalman.correct(m, Z, X, H, jnp.zeros(n), jnp.eye(n), None, stretch.z, seen, size, log_scale)
    return kalman.predict(post.m, post.Z, post.X, None, None, stretch.A, stretch.b, stretch.Z, size, log_scale)
