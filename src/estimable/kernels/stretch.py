"""The effect of a stretch of samples on a belief: the elements that an associative scan sums over windows.

A stretch leads from x, the state before its first sample, to x+, the state before the first sample after it. Given its
samples, with ξ and ε unit white,

    x+ = A x + b + Z ξ,    z = H x + ε   (the information in the samples about x; a row of zeros carries none)     (1)

Two stretches in a row are one stretch. The state x_a between a and b is A_a x + b_a + Z_a ξ_a, so that the data of b are
z_b - H_b b_a = H_b A_a x + [H_b Z_a, I] (ξ_a, ε_b), and with a triangular factor of their noise and that of x_a,

    [H_b Z_a  I]     [L  0]
    [  Z_a    0]  ~  [G  Z]      equal products with their transposes                                              (2)
    L^-1 (z_b - H_b b_a) = L^-1 H_b A_a x + white noise                                                            (3)
    x_a = A_a x + b_a + G L^-1 (z_b - H_b b_a - H_b A_a x) + Z ξ                                                   (4)
    x+ = A_b x_a + b_b + Z_b ξ_b                                                                                   (5)

The data of a and (3) together are reduced to n rows. Sums over all windows of a length take three such steps a sample
(suffixes of blocks of that length, prefixes, and one sum of both), since the sum is associative.

References: S. Särkkä, Á. F. García-Fernández, IEEE TAC 66 (2021) 299-306, Lemma 8, here with factors for covariances;
M. van Herk, Pattern Recognition Letters 13 (1992) 517-521 (windows by blocks).
"""

import jax.numpy as jnp

from ..frozen import frozen
from . import kalman
from .kalman import Gaussian, Measurement, Transition
from .shapes import Bool, Float
from .small import Real, apply, diagonal, product, solve_lower, triangularise

ROUNDING = 1e-13  # a pivot this far below the norm of its column carries no information


@frozen
class Stretch:
    """x+ = A x + b + Z ξ and z = H x + ε, (1)."""

    A: Float[Real, "n n"]
    b: Float[Real, " n"]
    Z: Float[Real, "n _"]
    H: Float[Real, "s n"]
    z: Float[Real, " s"]


def empty(n: int) -> Stretch:
    """No sample: nothing moves, and there is no information."""
    zeros = jnp.zeros((n, n))
    return Stretch(jnp.eye(n), jnp.zeros(n), zeros, zeros, jnp.zeros(n))


def of_sample(
    transition: Transition, measurement: Measurement, y: Float[Real, " p"], seen: Bool[Real, " p"]
) -> Stretch:
    """One sample and the step after it, for a diagonal V without zeros and no Ω."""
    (F, c, W), (C, d, V, *_) = transition, measurement
    return Stretch(F, c, W, *_white(C, d, diagonal(V), y, seen))


def _white(
    C: Float[Real, "p n"], d: Float[Real, " p"], r: Float[Real, " p"], y: Float[Real, " p"], seen: Bool[Real, " p"]
) -> tuple[Float[Real, "p n"], Float[Real, " p"]]:
    """H and z of the outputs y = C x + d + r e that were seen."""
    return jnp.where(seen[:, None], C / r[:, None], 0.0), jnp.where(seen, (y - d) / r, 0.0)


def joined(a: Stretch, b: Stretch) -> Stretch:
    """Stretch a, then stretch b."""
    s, n = b.H.shape
    array = [jnp.concatenate([product(b.H, a.Z), jnp.eye(s)], axis=1), jnp.concatenate([a.Z, jnp.zeros((n, s))], axis=1)]
    both = triangularise(jnp.concatenate(array))                                                       # (2)
    L, G, Z = both[:s, :s], both[s:, :s], both[s:, s:]
    E, e = product(b.H, a.A), b.z - apply(b.H, a.b)
    white = solve_lower(L, jnp.concatenate([E, e[:, None]], axis=1))                                   # (3)
    A, mean = a.A - product(G, white[:, :-1]), a.b + apply(G, white[:, -1])                            # (4)
    Z_next = triangularise(jnp.concatenate([product(b.A, Z), b.Z], axis=1))                            # (5)
    H, z = _fewest(jnp.concatenate([a.H, white[:, :-1]]), jnp.concatenate([a.z, white[:, -1]]))
    return Stretch(product(b.A, A), apply(b.A, mean) + b.b, Z_next, H, z)                              # (5)


def _fewest(H: Float[Real, "s n"], z: Float[Real, " s"]) -> tuple[Real, Real]:
    """The same information in n rows: the triangular factor of (H, z)."""
    n = H.shape[1]
    columns = jnp.concatenate([H, z[:, None]], axis=1).T
    R = triangularise(columns).T[:n]
    pivots, peaks = jnp.sum(R[:, :n] * jnp.eye(n), axis=1), jnp.sum(columns[:n] ** 2, axis=1)
    R = jnp.where((pivots**2 > ROUNDING**2 * peaks)[:, None], R, 0.0)
    return R[:, :n], R[:, n]


def through(prior: Gaussian, stretch: Stretch) -> Gaussian:
    """The belief after a stretch, from the belief before it."""
    A, b, Z, H, z = stretch.A, stretch.b, stretch.Z, stretch.H, stretch.z
    n, seen = len(H), jnp.max(jnp.abs(H), axis=1) > 0
    post = kalman.correct(prior, Measurement(H, jnp.zeros(n), jnp.eye(n)), z, seen)
    return kalman.predict(post.state, Transition(A, b, Z))
