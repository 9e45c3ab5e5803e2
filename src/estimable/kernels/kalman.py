"""The Kalman filter in array form.

Letters: m and Z, mean and factor of the covariance P = Z Z' (Z has at least n columns); X spans what nothing is known
of, so that the covariance is Z Z' + κ X X' with κ -> infinity (X may have no column). Model: y = C x + d + v and
x+ = F x + c + ω, with the noises on unit white ones: v = V e, ω = Ω e + W e', e and e' independent (Ω: cross noise).

Every covariance is a factor times its transpose, hence positive semidefinite; no inverse and no difference of
covariances is formed. A row of the array is one scalar output, so an output that was not seen is a row passed over,
whatever its neighbours did and however their noises are correlated.

References: T. Kailath, A. H. Sayed, B. Hassibi, Linear Estimation (2000), ch. 12 (array algorithms);
J. Durbin, S. J. Koopman, Time Series Analysis by State Space Methods (2012), ch. 5 and §6.4 (exact diffuse start, one
output at a time); Å. Björck, BIT 7 (1967) 1-21 (accuracy of modified Gram-Schmidt).
"""

from typing import NamedTuple

import jax.numpy as jnp

from .shapes import Bool, Float
from .small import Real, apply, gram, product, repeat, triangularise

KNOWN = 1e-26         # a variance this far below the square of what it is computed from, or of the datum, is rounding
DETERMINED = 1e-20    # so is a diffuse part this far below its terms' (10 digits)
SNAPPED = 1e-13       # and an entry of X this far below the terms that it is the difference of
CONTRADICTION = 1e-9  # by how much of its size a datum may miss a value that is known exactly
MEMORY = 0.9          # of the size that a state had: what it was rounded at does not shrink when it crosses zero
SAFE = 2.0**100       # X is scaled back when it leaves 1 / SAFE .. SAFE: only its span and ratios mean something


class Posterior(NamedTuple):
    """What one measurement update gives; `drift` and `Z_drift` are mean and factor of ω, None where Ω is.

    The innovation covariance is NaN where it is infinite: of an output with a diffuse part. `error` and `variance` (p,)
    are those of each output given those before it in the same sample, NaN where it told only of a diffuse direction.
    """

    m: Real
    Z: Real
    X: Real
    drift: Real | None
    Z_drift: Real | None
    innovation: Real
    innovation_covariance: Real
    log_likelihood: Real
    contradicted: Real
    error: Real
    variance: Real


class _Array(NamedTuple):
    finite: Real           # rows: outputs, states, drifts; columns: unit white variables
    residual: Real         # of each row: datum minus mean for an output, minus the increment of the mean for a state or drift
    diffuse: Real          # the same rows on the variables of infinite variance
    variance: Real         # of each output when its turn came (of its diffuse part where that opened)
    error: Real            # its residual then
    opened: Real           # whether it determined a diffuse direction
    informed: Real         # whether it told something of what was known with finite variance


def correct(
    m: Float[Real, " n"],
    Z: Float[Real, "n k"],
    X: Float[Real, "n r"],
    C: Float[Real, "p n"],
    d: Float[Real, " p"],
    V: Float[Real, "p p"],
    Ω: Float[Real, "n p"] | None,
    y: Float[Real, " p"],
    seen: Bool[Real, " p"],
    size: Float[Real, " n"],
    log_scale: Float[Real, ""],
) -> Posterior:
    """Condition the belief on the entries of y that were seen.

    `size`: of the terms whose sum m is, so that its rounding is known. X is in truth X exp(log_scale). Cost: about
    2 p (p + n) (p + k) multiplications.
    """
    (p, n), k = C.shape, Z.shape[1]
    e = jnp.where(seen, y - apply(C, m) - d, 0.0)
    Y = jnp.concatenate([product(C, Z), V], axis=1)                        # outputs on (x's variables, e)
    finite = [Y, jnp.concatenate([Z, jnp.zeros((n, p))], axis=1)]
    diffuse = [product(C, X), X]
    if Ω is not None:
        finite.append(jnp.concatenate([jnp.zeros((n, k)), Ω], axis=1))
        diffuse.append(jnp.zeros_like(X))
    magnitude = jnp.abs(y) + jnp.abs(d) + apply(jnp.abs(C), size)          # of the datum and of its prediction
    known = KNOWN * (terms(C, Z) + jnp.sum(V * V, axis=1) + magnitude**2)
    determined = DETERMINED * terms(C, X)

    blank = jnp.zeros(p, bool)
    residual = jnp.concatenate([e, jnp.zeros(n if Ω is None else 2 * n)])
    array = _Array(jnp.concatenate(finite), residual, jnp.concatenate(diffuse), jnp.ones(p), e, blank, blank)
    array = repeat(p, lambda j, a: _take(a, j, seen[j], known[j], determined[j], k), array)
    ignored = seen & ~array.opened & ~array.informed
    density = jnp.log(2 * jnp.pi * array.variance)
    density = density + jnp.where(array.opened, 2 * log_scale, array.error**2 / array.variance)
    infinite = jnp.sum(diffuse[0] ** 2, axis=1) > determined
    at_states, at_drifts = slice(p, p + n), slice(p + n, None)
    return Posterior(
        m=m - array.residual[at_states],
        Z=array.finite[at_states],
        X=array.diffuse[at_states],
        drift=None if Ω is None else -array.residual[at_drifts],
        Z_drift=None if Ω is None else array.finite[at_drifts],
        innovation=jnp.where(seen, e, jnp.nan),
        innovation_covariance=jnp.where(infinite[:, None] | infinite[None, :], jnp.nan, gram(Y)),
        log_likelihood=-jnp.sum(jnp.where(array.opened | array.informed, density, 0.0)) / 2,
        error=jnp.where(array.informed, array.error, jnp.nan),
        variance=jnp.where(array.informed, array.variance, jnp.nan),
        contradicted=jnp.any(ignored & (jnp.abs(array.error) > CONTRADICTION * magnitude)),
    )


def terms(C: Float[Real, "p n"], Z: Float[Real, "n k"]) -> Float[Real, " p"]:
    """Sum of the squares of all the terms in C Z: what its rows' size would be if nothing cancelled."""
    return apply(C * C, jnp.sum(Z * Z, axis=1))


def _take(a: _Array, j, seen, known, determined, states: int) -> _Array:
    """Condition every row on row j having its datum.

    In the limit κ -> infinity the gain on a datum with a diffuse part β is X β / β β', and what it leaves,
    Z - k g and X (I - β' β / β β'), is exact: the covariance is stationary in the gain (Durbin & Koopman §5.2).
    """
    g, β, e = a.finite[j], a.diffuse[j], a.residual[j]
    covariance, covariance_diffuse = apply(a.finite, g), apply(a.diffuse, β)
    f, f_diffuse = covariance[j], covariance_diffuse[j]                    # variance: f + κ f_diffuse
    opens = seen & (f_diffuse > determined)
    informs = seen & ~opens & (f > known)
    variance = jnp.where(opens, f_diffuse, jnp.where(informs, f, 1.0))
    gain = jnp.where(opens, covariance_diffuse, jnp.where(informs, covariance, 0.0)) / variance
    X = _told(a, g, β, opens, seen, states) if len(β) else a.diffuse
    at_j = jnp.arange(a.error.shape[0]) == j
    return _Array(
        finite=a.finite - gain[:, None] * g[None, :],
        residual=a.residual - gain * e,
        diffuse=X,
        variance=jnp.where(at_j, variance, a.variance),
        error=jnp.where(at_j, e, a.error),
        opened=a.opened | (at_j & opens),
        informed=a.informed | (at_j & informs),
    )


def _told(a: _Array, g, β, opens, seen, states: int) -> Real:
    """X when row j has its datum: X less a rank-one term, whichever of three cases it is.

    Where the datum opens a direction, what is left is the part of X orthogonal to β, with one column exactly zero: the rank
    falls by one, to the last bit (a Householder reflection turns β onto its largest entry). Where it opens none, β is
    rounding, and is moved out along what is known of the state: otherwise it would outlive directions that decay, and pass
    for one of them. Where it was not seen, X stays.
    """
    X = a.diffuse
    pivot = jnp.arange(X.shape[1]) == jnp.argmax(jnp.abs(β))
    turned = jnp.sqrt(jnp.sum(β * β) + jnp.where(jnp.any(β != 0), 0.0, 1.0))
    v = β + jnp.where(pivot, jnp.where(β < 0, -turned, turned), 0.0)
    g = jnp.where(jnp.arange(len(g)) < states, g, 0.0)                     # of the states' own variables, not of the noise
    f = jnp.sum(g * g)
    reflected = apply(X, v) * (2 / jnp.sum(v * v))
    along = apply(a.finite, g) * jnp.where(f > 0, 1 / jnp.where(f > 0, f, 1.0), 0.0)
    row = jnp.where(opens, v, jnp.where(seen, β, 0.0))
    left = X - jnp.where(opens, reflected, along)[:, None] * row[None, :]
    least = jnp.where(opens, SNAPPED * jnp.max(jnp.abs(X), axis=1), -1.0)   # what is left below that is rounding
    left = jnp.where(pivot[None, :] & opens, 0.0, left)
    return jnp.where(jnp.abs(left) <= least[:, None], 0.0, left)


def _is_rounding(difference, terms):
    """Whether what is left of a difference is the rounding of its terms."""
    return jnp.abs(difference) <= SNAPPED * terms


class Prediction(NamedTuple):
    """The belief about the next state: its factor is lower triangular; `size` and `log_scale` as `correct` takes them."""

    m: Real
    Z: Real
    X: Real
    size: Real
    log_scale: Real


def predict(
    m: Float[Real, " n"],
    Z: Float[Real, "n k"],
    X: Float[Real, "n r"],
    drift: Float[Real, " n"] | None,
    Z_drift: Float[Real, "n k"] | None,
    F: Float[Real, "n n"],
    c: Float[Real, " n"],
    W: Float[Real, "n q"],
    size: Float[Real, " n"],
    log_scale: Float[Real, ""],
) -> Prediction:
    """The belief about x+ = F x + c + ω. Cost: about n² (2 k + q) multiplications."""
    Z_next, m_next = product(F, Z), apply(F, m) + c
    if drift is not None and Z_drift is not None:
        Z_next, m_next = Z_next + Z_drift, m_next + drift
    L = triangularise(Z_next, W)
    size = jnp.maximum(apply(jnp.abs(F), jnp.abs(m)) + jnp.abs(c), MEMORY * size)
    if X.shape[1] == 0:
        return Prediction(m_next, L, X, size, log_scale)
    X_next = product(F, X)
    X_next = jnp.where(_is_rounding(X_next, product(jnp.abs(F), jnp.abs(X))), 0.0, X_next)
    peak = jnp.max(jnp.abs(X_next))
    far = (peak > SAFE) | ((peak < 1 / SAFE) & (peak > 0))
    power = jnp.where(far, jnp.exp2(-jnp.round(jnp.log2(jnp.where(far, peak, 1.0)))), 1.0)
    return Prediction(m_next, L, power * X_next, size, log_scale - jnp.log(power))
