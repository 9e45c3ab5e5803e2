"""The measurement update where the noises of the outputs are independent, with no more columns after it than before.

Letters as in `kalman`: m and Z, mean and factor of the covariance P = Z Z'; y = C x + d + v, now v_j = r_j e_j. During the
update P = Z diag(w) Z': one output is one row g = c' Z beside a noise of its own, and the rotations that turn [r, g √w] into
[√f, 0], last variable first, are known in closed form, without roots, as ratios of sums of squares. A triangular Z stays
triangular, and the array of `kalman.correct` need not carry e: half the arithmetic, the same thresholds.

References: G. J. Bierman, Factorization Methods for Discrete Sequential Estimation (1977), ch. V; N. A. Carlson, AIAA
Journal 11 (1973) 1259-1265, for the same rotations with their roots.
"""

from typing import NamedTuple

import jax.numpy as jnp

from .kalman import CONTRADICTION, KNOWN, Posterior, terms
from .shapes import Bool, Float
from .small import Real, apply, gram, product, repeat, sums_after


class _Rows(NamedTuple):
    factor: Real           # outputs, then states, on white variables
    weight: Real           # their variances
    residual: Real         # datum minus mean of an output, minus the increment of the mean of a state
    variance: Real         # of each output when its turn came, 1 of those that told nothing
    surprise: Real         # its squared residual then, over that variance
    error: Real            # its residual then
    informed: Real         # whether it told something


def correct(
    m: Float[Real, " n"],
    Z: Float[Real, "n k"],
    C: Float[Real, "p n"],
    d: Float[Real, " p"],
    r: Float[Real, " p"],
    y: Float[Real, " p"],
    seen: Bool[Real, " p"],
    size: Float[Real, " n"],
) -> Posterior:
    """Condition a belief without diffuse part on the entries of y that were seen; r: standard deviations of the noises.

    `size`: of the terms whose sum m is. Cost: about 2 p k (p + n) multiplications, half of it for a triangular Z.
    """
    p, n = C.shape
    e = jnp.where(seen, y - apply(C, m) - d, 0.0)
    Y = product(C, Z)
    magnitude = jnp.abs(y) + jnp.abs(d) + apply(jnp.abs(C), size)          # of the datum and of its prediction
    known = KNOWN * (terms(C, Z) + r * r + magnitude**2)
    blank = jnp.zeros(p)
    residual = jnp.concatenate([e, jnp.zeros(n)])
    rows = _Rows(jnp.concatenate([Y, Z]), jnp.ones(Z.shape[1]), residual, blank + 1, blank, e, blank > 0)
    rows = repeat(p, lambda j, a: _take(a, j, r[j], seen[j], known[j]), rows)
    known_exactly = rows.weight == 0
    scale = jnp.where(known_exactly, 0.0, jnp.sqrt(jnp.where(known_exactly, 1.0, rows.weight)))
    density = jnp.log(2 * jnp.pi * rows.variance) + rows.surprise
    return Posterior(
        m=m - rows.residual[p:],
        Z=rows.factor[p:] * scale[None, :],
        X=jnp.zeros((n, 0)),
        drift=None,
        Z_drift=None,
        innovation=jnp.where(seen, e, jnp.nan),
        innovation_covariance=gram(Y) + jnp.eye(p) * (r * r)[:, None],
        log_likelihood=-jnp.sum(jnp.where(rows.informed, density, 0.0)) / 2,
        error=jnp.where(rows.informed, rows.error, jnp.nan),
        variance=jnp.where(rows.informed, rows.variance, jnp.nan),
        contradicted=jnp.any(seen & ~rows.informed & (jnp.abs(rows.error) > CONTRADICTION * magnitude)),
    )


def _take(a: _Rows, j, r, seen, known) -> _Rows:
    """Condition every row on row j having its datum.

    α_l = r² + Σ_{i>=l} w_i g_i² is the variance of the datum as far as the noise and the variables from l on make it:
    w_l becomes w_l α_{l+1} / α_l, and column l loses g_l / α_{l+1} times what the variables after it say, Σ_{i>l} z_i w_i g_i.
    """
    g, at_j = a.factor[j], jnp.arange(a.error.shape[0]) == j
    v = a.weight * g
    after = r * r + sums_after(g * v)
    α = after + g * v
    f = α[0]
    informs = f > jnp.where(seen, known, jnp.inf)
    inverse = 1 / jnp.where(α > 0, α, 1.0)
    inverse_after = jnp.append(inverse[1:], 1 / jnp.where(r > 0, r * r, 1.0))
    shrunk = jnp.where(α > 0, after * inverse, 1.0)
    met = sums_after(a.factor * v[None, :])                                # 0 where α_{l+1} is
    precision = jnp.where(informs, inverse[0], 0.0)
    gain = (met[:, 0] + a.factor[:, 0] * v[0]) * precision
    return _Rows(
        factor=a.factor - met * jnp.where(informs, g * inverse_after, 0.0)[None, :],
        weight=a.weight * jnp.where(informs, shrunk, 1.0),
        residual=a.residual - gain * a.residual[j],
        variance=jnp.where(at_j & informs, f, a.variance),
        surprise=jnp.where(at_j, a.residual[j] ** 2 * precision, a.surprise),
        error=jnp.where(at_j, a.residual[j], a.error),
        informed=a.informed | (at_j & informs),
    )
