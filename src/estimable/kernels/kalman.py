"""The Kalman filter in array form, by modified Gram-Schmidt.

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
from jaxtyping import Bool, Float

from .small import Real, apply, gram, product, repeat, triangularise

KNOWN = 1e-28         # an output with a variance this far below its terms' (14 digits of standard deviation) adds nothing
DETERMINED = 1e-20    # a diffuse part this far below its terms' (10 digits) is rounding
CONTRADICTION = 1e-9  # by how much of its size a datum may miss a value that is known exactly


class Posterior(NamedTuple):
    """What one measurement update gives; `drift` and `Z_drift` are mean and factor of ω, None where Ω is."""

    m: Real
    Z: Real
    X: Real
    drift: Real | None
    Z_drift: Real | None
    innovation: Real
    innovation_covariance: Real
    log_likelihood: Real
    contradicted: Real


class _Array(NamedTuple):
    finite: Real           # rows: outputs, states, drifts; columns: unit white variables
    diffuse: Real          # the same rows on the variables of infinite variance
    residual: Real         # of outputs: datum minus mean; of states and drifts: minus the increment of the mean
    log_likelihood: Real
    contradicted: Real


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
) -> Posterior:
    """Condition the belief on the entries of y that were seen. Cost: about 2 p (p + n) (p + k) multiplications."""
    p, n = C.shape
    k, r = Z.shape[1], X.shape[1]
    e = jnp.where(seen, y - apply(C, m) - d, 0.0)
    Y = jnp.concatenate([product(C, Z), V], axis=1)                        # outputs on (x's variables, e)
    finite = [Y, jnp.concatenate([Z, jnp.zeros((n, p))], axis=1)]
    diffuse = [product(C, X), X]
    if Ω is not None:
        finite.append(jnp.concatenate([jnp.zeros((n, k)), Ω], axis=1))
        diffuse.append(jnp.zeros((n, r)))
    C2 = C * C
    known = KNOWN * (apply(C2, jnp.sum(Z * Z, axis=1)) + jnp.sum(V * V, axis=1))
    determined = DETERMINED * apply(C2, jnp.sum(X * X, axis=1))
    slack = CONTRADICTION * (jnp.abs(y) + jnp.abs(d) + apply(jnp.abs(C), jnp.abs(m)))

    rows = p + n * (len(finite) - 1)
    array = _Array(
        jnp.concatenate(finite), jnp.concatenate(diffuse), jnp.zeros(rows).at[:p].set(e), jnp.zeros(()), jnp.zeros((), bool)
    )
    array = repeat(p, lambda j, a: _take(a, j, seen[j], known[j], determined[j], slack[j]), array)
    return Posterior(
        m=m - array.residual[p : p + n],
        Z=array.finite[p : p + n],
        X=array.diffuse[p : p + n],
        drift=None if Ω is None else -array.residual[p + n :],
        Z_drift=None if Ω is None else array.finite[p + n :],
        innovation=jnp.where(seen, e, jnp.nan),
        innovation_covariance=gram(Y),
        log_likelihood=array.log_likelihood,
        contradicted=array.contradicted,
    )


def _take(a: _Array, j, seen, known, determined, slack) -> _Array:
    """Condition every row on row j having its datum.

    In the limit κ -> infinity the gain on a datum with a diffuse part β is X β / β β', and what it leaves,
    Z - k g and X (I - β' β / β β'), is exact: the covariance is stationary in the gain (Durbin & Koopman §5.2).
    """
    g, β, e = a.finite[j], a.diffuse[j], a.residual[j]
    f, f_diffuse = jnp.sum(g * g), jnp.sum(β * β)                          # variance: f + κ f_diffuse
    opens = seen & (f_diffuse > determined)
    informs = seen & ~opens & (f > known)
    f_safe, f_diffuse_safe = jnp.where(informs, f, 1.0), jnp.where(opens, f_diffuse, 1.0)
    gain = jnp.where(informs, apply(a.finite, g) / f_safe, 0.0)
    gain = jnp.where(opens, apply(a.diffuse, β) / f_diffuse_safe, gain)
    density = jnp.log(2 * jnp.pi * jnp.where(opens, f_diffuse_safe, f_safe)) + jnp.where(opens, 0.0, e * e / f_safe)
    return _Array(
        finite=a.finite - gain[:, None] * g[None, :],
        diffuse=jnp.where(opens, _without(a.diffuse, β), a.diffuse),
        residual=a.residual - gain * e,
        log_likelihood=a.log_likelihood - jnp.where(opens | informs, density / 2, 0.0),
        contradicted=a.contradicted | (seen & ~opens & ~informs & (jnp.abs(e) > slack)),
    )


def _without(X: Float[Real, "k r"], β: Float[Real, " r"]) -> Float[Real, "k r"]:
    """The part of X orthogonal to β, with one column exactly zero: the rank falls by one, to the last bit.

    A Householder reflection turns β onto its largest entry; that column is what has been determined.
    """
    if X.shape[1] == 0:
        return X
    pivot = jnp.arange(X.shape[1]) == jnp.argmax(jnp.abs(β))
    turned = jnp.sqrt(jnp.sum(β * β) + jnp.where(jnp.any(β != 0), 0.0, 1.0))
    v = β + jnp.where(pivot, jnp.where(β < 0, -turned, turned), 0.0)
    X = X - apply(X, v)[:, None] * (2 / jnp.sum(v * v)) * v[None, :]
    return jnp.where(pivot[None, :], 0.0, X)


def predict(
    m: Float[Real, " n"],
    Z: Float[Real, "n k"],
    X: Float[Real, "n r"],
    drift: Float[Real, " n"] | None,
    Z_drift: Float[Real, "n k"] | None,
    F: Float[Real, "n n"],
    c: Float[Real, " n"],
    W: Float[Real, "n q"],
) -> tuple[Float[Real, " n"], Float[Real, "n n"], Float[Real, "n r"]]:
    """The belief about x+ = F x + c + ω, its factor lower triangular. Cost: about n² (2 k + q) multiplications."""
    Z_next, m_next = product(F, Z), apply(F, m) + c
    if drift is not None:
        Z_next, m_next = Z_next + Z_drift, m_next + drift
    return m_next, triangularise(jnp.concatenate([Z_next, W], axis=1)), product(F, X)
