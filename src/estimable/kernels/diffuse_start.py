"""Directions of infinite variance, after a datum and after a step of the model.

The belief of `kalman` is x = m + Z ξ + X δ, δ ~ N(0, κ I), κ -> infinity. In its array, a row is (A ξ, B δ); g and β are
the rows of A and B of a datum that was seen.

Where β is not zero the datum determines one combination of δ, and the rest of B is orthogonal to β:

    B <- B (I - β' β / β β')                                                                           (1)

Only the span of X counts, so (1) is computed after a reflection H that turns β onto its largest entry i. The column i of
B H is then what the datum determines, and is set to zero: the rank falls by one, to the last bit.

    B <- B H without column i,   H = I - 2 v' v / v v',   v_i = β_i ± |β|,  v = β elsewhere            (2)

Where β is rounding, it is removed along the finite directions of the state. Otherwise it would outlast directions that
decay and be mistaken for one of them:

    B <- B - (A g' / g g') β                                                                           (3)

References: J. Durbin, S. J. Koopman, Time Series Analysis by State Space Methods (2012), §5.2, for (1);
G. H. Golub, C. F. Van Loan, Matrix Computations (2013), §5.1, for (2).
"""

import jax.numpy as jnp

from .rounding import SNAPPED, is_rounding
from .shapes import Float
from .small import Flag, Real, apply, product

SAFE = 2.0**100  # X is scaled back when it leaves 1 / SAFE .. SAFE: only its span and ratios matter


def remaining(
    B: Float[Real, "s r"], A: Float[Real, "s _"], β: Float[Real, " r"], g: Float[Real, " _"], opens: Flag, seen: Flag
) -> Float[Real, "s r"]:
    """B after a datum: by (1) if it `opens`, that is, determines a diffuse direction; by (3) if it was `seen`; else unchanged.

    g is zero for the noise variables, which (3) may not use. Each case subtracts one column times one row from B.
    """
    largest = jnp.arange(len(β)) == jnp.argmax(jnp.abs(β))
    norm = jnp.sqrt(jnp.sum(β * β) + jnp.where(jnp.any(β != 0), 0.0, 1.0))                   # |β|, or 1
    v = β + jnp.where(largest, jnp.where(β < 0, -norm, norm), 0.0)                           # (2)
    gg = jnp.sum(g * g)
    reflected = apply(B, v) * (2 / jnp.sum(v * v))                                           # (2), 2 B v' / v v'
    along = apply(A, g) * jnp.where(gg > 0, 1 / jnp.where(gg > 0, gg, 1.0), 0.0)             # (3), A g' / g g'
    row = jnp.where(opens, v, jnp.where(seen, β, 0.0))
    left = B - jnp.where(opens, reflected, along)[:, None] * row[None, :]                    # (2) or (3)
    least = jnp.where(opens, SNAPPED * jnp.max(jnp.abs(B), axis=1), -1.0)                    # below it is rounding
    left = jnp.where(largest[None, :] & opens, 0.0, left)                                    # (2), without column i
    return jnp.where(jnp.abs(left) <= least[:, None], 0.0, left)


def moved(
    F: Float[Real, "n n"], X: Float[Real, "n r"], log_scale: Float[Real, ""]
) -> tuple[Float[Real, "n r"], Float[Real, ""]]:
    """F X and its scale. A power of two moves from F X to the scale where F X leaves the safe range."""
    if X.shape[1] == 0:
        return X, log_scale
    FX = product(F, X)
    FX = jnp.where(is_rounding(FX, product(jnp.abs(F), jnp.abs(X))), 0.0, FX)
    peak = jnp.max(jnp.abs(FX))
    far = (peak > SAFE) | ((peak < 1 / SAFE) & (peak > 0))
    power = jnp.where(far, jnp.exp2(-jnp.round(jnp.log2(jnp.where(far, peak, 1.0)))), 1.0)
    return power * FX, log_scale - jnp.log(power)
