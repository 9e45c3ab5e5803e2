"""The measurement update of `kalman`, all outputs at once, for independent output noises and no diffuse directions.

For seen outputs Y = C Z and U = diag r. For the others Y_j = 0 and r_j = 1 (unit noise that sees no state):

    S = Y Y' + U U' = L L'                  L lower triangular; L_jj²: variance of y_j given those before it      (1)
    G = Z Y' L'^-1,  z = L^-1 (y - C m - d)                                                                       (2)
    m <- m + G z                                                                                                  (3)
    Z <- [-K U, Z - K Y],  K = G L^-1       Joseph's form of a factor                                             (4)
    -2 log p = Σ_j log 2π L_jj² + z_j²                                                                            (5)

(4) is the part of the rows of [0, Z] orthogonal to those of [U, Y]. Modified Gram-Schmidt therefore gives (1), (2) and (4) where
S is near singular: column j of L is zero where no variance is left. Neither (1) nor (4) depends on the data. For many states,
matrix products are faster than one output after the other (`independent`); the factor gets p more columns.

References: P. D. Joseph, in R. S. Bucy, P. D. Joseph, Filtering for Stochastic Processes (1968), ch. XVI; Å. Björck, BIT 7
(1967) 1-21.
"""

import jax
import jax.numpy as jnp
from jax import lax

from .kalman import Gaussian, Measurement, Posterior, innovation_of
from .rounding import CONTRADICTION, KNOWN, magnitude, terms
from .shapes import Bool, Float
from .small import SMALL, Real, apply, cholesky, diagonal, gram, orthogonalise, product, solve_lower

LARGE = 16  # states, from which it is faster for any number of outputs


def is_faster(n: int, p: int) -> bool:
    """Whether this update is faster than one output after the other, for n states and p outputs (docs/decisions/0017)."""
    return n >= LARGE or min(n, p) > SMALL


def correct(prior: Gaussian, measurement: Measurement, y: Float[Real, " p"], seen: Bool[Real, " p"]) -> Posterior:
    """Condition the belief on the entries of y that were seen, for a diagonal V, no Ω and no diffuse directions.

    Cost: about n p (3 k + p) multiplications.
    """
    (m, Z, _, size, _), (C, d, V, _, period) = prior, measurement
    r, innovation, Y = diagonal(V), innovation_of(y, seen, C, m, d, period), product(C, Z)
    scale, alone = magnitude(y, C, d, size), jnp.sum(Y * Y, axis=1) + r * r
    used = seen & (alone > KNOWN * scale**2)                                               # the others are rounding

    U = jnp.eye(len(r)) * jnp.where(used, r, 1.0)[:, None]
    L, G, Z = _conditioned(Z, jnp.where(used[:, None], Y, 0.0), U, KNOWN * (terms(C, Z) + r * r))
    root = diagonal(L)
    z = solve_lower(L, jnp.where(used, innovation, 0.0)[:, None])[:, 0]                    # (2)
    informed = used & (root > 0)
    variance = jnp.where(informed, root**2, 1.0)
    error = innovation - apply(L, z) + root * z                                            # given the outputs before
    return Posterior(
        state=prior._replace(m=m + apply(G, z), Z=Z),                                      # (3)
        drift=None,
        innovation=jnp.where(seen, innovation, jnp.nan),
        innovation_covariance=gram(Y) + jnp.eye(len(r)) * (r * r)[:, None],
        log_likelihood=-jnp.sum(jnp.where(informed, jnp.log(2 * jnp.pi * variance) + z**2, 0.0)) / 2,      # (5)
        error=jnp.where(informed, error, jnp.nan),
        variance=jnp.where(informed, variance, jnp.nan),
        contradicted=jnp.any(seen & ~informed & (jnp.abs(error) > CONTRADICTION * scale)),
    )


@jax.custom_jvp
def _conditioned(Z: Float[Real, "n k"], Y: Float[Real, "p k"], U: Float[Real, "p p"], known: Float[Real, " p"]):
    """L, G and Z of (1), (2) and (4); column j of L is zero where L_jj² would be no larger than `known`."""
    return _by_products(Z, Y, U, known)


@_conditioned.defjvp
def _conditioned_jvp(values: tuple[Real, ...], tangents: tuple[Real, ...]) -> tuple[tuple[Real, ...], tuple[Real, ...]]:
    Z, Y, U, known = values
    slope = jax.jvp(lambda Z, Y, U: _row_by_row(Z, Y, U, known), (Z, Y, U), tangents[:3])[1]
    return _conditioned(Z, Y, U, known), slope


@jax.custom_batching.sequential_vmap
def _by_products(Z: Real, Y: Real, U: Real, known: Real) -> tuple[Real, Real, Real]:
    """`_conditioned` by Cholesky's factor of S where it is accurate."""
    L, good = cholesky(gram(Y) + gram(U))                                                  # (1)

    def joseph(L: Real) -> tuple[Real, Real, Real]:
        G = product(Z, solve_lower(L, Y).T)                                                # (2)
        K = solve_lower(L, G.T, transpose=True).T
        return L, G, jnp.concatenate([-product(K, U), Z - product(K, Y)], axis=1)          # (4)

    return lax.cond(jnp.all(good & (diagonal(L) ** 2 > known)), joseph, lambda L: _row_by_row(Z, Y, U, known), L)


def _row_by_row(Z: Real, Y: Real, U: Real, known: Real) -> tuple[Real, Real, Real]:
    """`_conditioned` by modified Gram-Schmidt."""
    p = len(Y)
    outputs, states = jnp.concatenate([U, Y], axis=1), jnp.concatenate([jnp.zeros((len(Z), p)), Z], axis=1)
    left, common = orthogonalise(jnp.concatenate([outputs, states]), p, known)
    return common[:p], common[p:], left[p:]
