"""The measurement update of `kalman` for independent output noises and no diffuse directions.

The factor needs no column for the noise of an output; its width is constant. Model y_j = c_j x + d_j + r_j e_j, belief
x = m + Z D^½ ξ with D = diag(w), w = 1 before the datum. The array of outputs and states is A = [C Z; Z], with variables
D^½ ξ; its columns are a_l. With g the row of output j, the outputs are conditioned on one at a time:

    α_l = r_j² + Σ_{i>=l} w_i g_i²,  f = α_1        α_l: variance from the noise and variables l, l + 1, ..    (1)
    w_l <- w_l α_{l+1} / α_l                        α_{l+1} = r_j² for the last variable                        (2)
    a_l <- a_l - (g_l / α_{l+1}) Σ_{i>l} w_i g_i a_i                                                           (3)
    μ <- μ + k (y_j - μ_j),  k = A D g' / f                                                                    (4)

(2) and (3) are the square-root-free plane rotations that turn [r_j, g D^½] into [√f, 0], the last variable first. A
triangular Z stays triangular: half the arithmetic of the general update, with the same thresholds.

References: G. J. Bierman, Factorization Methods for Discrete Sequential Estimation (1977), ch. V (factors with weights);
N. A. Carlson, AIAA Journal 11 (1973) 1259-1265, for the same rotations with their roots.
"""

from typing import NamedTuple

import jax.numpy as jnp

from .kalman import Gaussian, Measurement, Posterior, innovation_of
from .rounding import CONTRADICTION, KNOWN, magnitude, terms
from .shapes import Bool, Float
from .small import Flag, Real, Scalar, diagonal, gram, product, repeat, sums_after


class _Weighted(NamedTuple):
    A: Real                # rows: outputs, states; columns: variables of variance w
    w: Real
    residual: Real         # of each row: (y, m) - μ, with the m before the datum
    error: Real            # y_j - μ_j of each output, given those before it
    variance: Real         # its f, given those before it
    surprise: Real         # its (y_j - μ_j)² / f
    informed: Real         # it carried information


def correct(prior: Gaussian, measurement: Measurement, y: Float[Real, " p"], seen: Bool[Real, " p"]) -> Posterior:
    """Condition the belief on the entries of y that were seen, for a diagonal V, no Ω and no diffuse directions.

    Cost: about 2 p k (p + n) multiplications, half of it for a triangular Z.
    """
    (m, Z, _, size, _), (C, d, V, _, period) = prior, measurement
    (p, n), r = C.shape, diagonal(V)
    innovation, A = innovation_of(y, seen, C, m, d, period), _joint_factor(C, Z)
    scale = magnitude(y, C, d, size)
    known = KNOWN * (terms(C, Z) + r * r + scale**2)                                       # f below it is rounding

    zeros, residual = jnp.zeros(p), jnp.concatenate([innovation, jnp.zeros(n)])
    before = _Weighted(A, jnp.ones(Z.shape[1]), residual, innovation, zeros + 1, zeros, informed=zeros > 0)
    after = repeat(p, lambda j, a: _condition_on_row(a, j, r[j], seen[j], known[j]), before)

    exact = after.w == 0
    root = jnp.where(exact, 0.0, jnp.sqrt(jnp.where(exact, 1.0, after.w)))                 # D^½
    density = jnp.log(2 * jnp.pi * after.variance) + after.surprise                        # (7) of `kalman`
    return Posterior(
        state=prior._replace(m=m - after.residual[p:], Z=after.A[p:] * root[None, :]),
        drift=None,
        innovation=jnp.where(seen, innovation, jnp.nan),
        innovation_covariance=gram(A[:p]) + jnp.eye(p) * (r * r)[:, None],
        log_likelihood=-jnp.sum(jnp.where(after.informed, density, 0.0)) / 2,
        error=jnp.where(after.informed, after.error, jnp.nan),
        variance=jnp.where(after.informed, after.variance, jnp.nan),
        contradicted=jnp.any(seen & ~after.informed & (jnp.abs(after.error) > CONTRADICTION * scale)),
    )


def _joint_factor(C: Float[Real, "p n"], Z: Float[Real, "n k"]) -> Float[Real, "_ k"]:
    """A, for w = 1."""
    return jnp.concatenate([product(C, Z), Z])


def _condition_on_row(a: _Weighted, j: int | Real, r: Scalar, seen: Flag, known: Scalar) -> _Weighted:
    """Condition every row of the array on the datum of row j, where it was seen."""
    g, error, at_j = a.A[j], a.residual[j], jnp.arange(a.error.shape[0]) == j
    wg = a.w * g
    α_next = r * r + sums_after(g * wg)                                                    # (1), α_{l+1}
    α = α_next + g * wg                                                                    # (1)
    f = α[0]
    informs = f > jnp.where(seen, known, jnp.inf)
    inverse = 1 / jnp.where(α > 0, α, 1.0)
    inverse_next = jnp.append(inverse[1:], 1 / jnp.where(r > 0, r * r, 1.0))
    shrink = jnp.where(α > 0, α_next * inverse, 1.0)                                       # (2)
    sums = sums_after(a.A * wg[None, :])                                                   # (3), 0 where α_{l+1} is
    precision = jnp.where(informs, inverse[0], 0.0)
    gain = (sums[:, 0] + a.A[:, 0] * wg[0]) * precision                                    # (4)
    return _Weighted(
        A=a.A - sums * jnp.where(informs, g * inverse_next, 0.0)[None, :],                 # (3)
        w=a.w * jnp.where(informs, shrink, 1.0),                                           # (2)
        residual=a.residual - gain * error,                                                # (4)
        error=jnp.where(at_j, error, a.error),
        variance=jnp.where(at_j & informs, f, a.variance),
        surprise=jnp.where(at_j, error**2 * precision, a.surprise),
        informed=a.informed | (at_j & informs),
    )
