"""The Kalman filter in array form.

Model and belief, with e, e', ξ ~ N(0, I) and δ ~ N(0, κ I), κ -> infinity, all independent:

    y = C x + d + V e,    x+ = F x + c + ω,  ω = Ω e + W e'    (Ω: cross noise, or None; y modulo a period where it is an angle)
    x = m + Z ξ + X δ                                          (X: diffuse directions, perhaps none)

Measurement update. Before the datum, outputs, state and cross noise are jointly Gaussian with mean μ and array (A, B):

    [ y  ]   [C m + d]   [C Z  V]       [C X]
    [ x  ] = [   m   ] + [ Z   0] [ξ] + [ X ] δ   =   μ + A (ξ, e) + B δ                               (1)
    [Ω e ]   [   0   ]   [ 0   Ω] [e]   [ 0 ]

They are conditioned on the outputs that were seen, one at a time. With g and β the rows of A and B of output j,

    f = g g',  f∞ = β β'             its variance is f + κ f∞, given the outputs before it             (2)
    k = A g' / f                     gain where β = 0                                                  (3)
    k = B β' / f∞                    gain where β is not: the limit κ -> infinity                      (4)
    A <- A - k g,  μ <- μ + k (y_j - μ_j)                                                              (5)
    B <- B (I - β' β / f∞)           where β is not 0; `diffuse_start` computes it                     (6)
    -2 log p = log 2π f + (y_j - μ_j)² / f,  or log 2π f∞ (without log κ) where β is not 0             (7)

(5) is exact in the limit too: the part of the gain of order 1 / κ multiplies B β', which is zero after (6).

Time update, with Ω e = ω̂ + Z_ω (ξ, e) given the outputs:

    m+ = F m + c + ω̂                                                                                  (8)
    Z+ Z+' = (F Z + Z_ω)(F Z + Z_ω)' + W W',  Z+ lower triangular                                      (9)
    X+ = F X                                                                                          (10)

Every covariance is a factor times its transpose, hence positive semidefinite; no inverse and no difference of covariances
is formed. The row of an unseen output is skipped, even if its noise is correlated with that of the others.

References: T. Kailath, A. H. Sayed, B. Hassibi, Linear Estimation (2000), ch. 12, for (1), (9) (array algorithms);
J. Durbin, S. J. Koopman, Time Series Analysis by State Space Methods (2012), §5.2 for (4)-(6), (10) (exact diffuse start),
§6.4 for one output at a time, §7.2 for (7); Å. Björck, BIT 7 (1967) 1-21, for the accuracy of (5), modified Gram-Schmidt.
"""

from typing import NamedTuple

import jax.numpy as jnp

from . import diffuse_start
from .rounding import CONTRADICTION, DETERMINED, KNOWN, magnitude, next_size, terms
from .shapes import Bool, Float
from .small import Flag, Real, Scalar, apply, gram, product, repeat, triangularise
from .wrapping import nearest


class Gaussian(NamedTuple):
    """The belief x = m + Z ξ + X exp(log_scale) δ."""

    m: Float[Real, " n"]
    Z: Float[Real, "n k"]            # k >= n
    X: Float[Real, "n r"]
    size: Float[Real, " n"]          # of the terms that sum to m: it bounds the rounding of m
    log_scale: Float[Real, ""]


class Measurement(NamedTuple):
    """y = C x + d + V e, and the matrix Ω of cross noise, None where e is independent of the process noise.

    `period`: that of each output which is an angle, 0 for the others; None where no output is.
    """

    C: Float[Real, "p n"]
    d: Float[Real, " p"]
    V: Float[Real, "p p"]
    Ω: Float[Real, "n p"] | None = None
    period: Float[Real, " p"] | None = None


class Transition(NamedTuple):
    """x+ = F x + c + W e', without cross noise."""

    F: Float[Real, "n n"]
    c: Float[Real, " n"]
    W: Float[Real, "n q"]


class Drift(NamedTuple):
    """Ω e given the outputs: its mean, and its factor on the variables of Z."""

    m: Float[Real, " n"]
    Z: Float[Real, "n k"]


class Posterior(NamedTuple):
    """The result of one measurement update.

    The innovation covariance is NaN where it is infinite: for an output with a diffuse part. `error` and `variance` (p,)
    are y_j - μ_j and f of each output given those before it in the same sample, NaN where it carried no information about
    directions of finite variance. `contradicted`: an output differs from a value that was known exactly.
    """

    state: Gaussian
    drift: Drift | None
    innovation: Float[Real, " p"]
    innovation_covariance: Float[Real, "p p"]
    log_likelihood: Float[Real, ""]
    error: Float[Real, " p"]
    variance: Float[Real, " p"]
    contradicted: Bool[Real, ""]


class _Array(NamedTuple):
    A: Real                # rows: outputs, states, cross noise
    B: Real
    residual: Real         # of each row: (y, m, 0) - μ, with the m before the datum
    error: Real            # y_j - μ_j of each output, given those before it
    variance: Real         # its f, or f∞ where it opened
    opened: Real           # it determined a diffuse direction
    informed: Real         # it carried information about directions of finite variance


def correct(prior: Gaussian, measurement: Measurement, y: Float[Real, " p"], seen: Bool[Real, " p"]) -> Posterior:
    """Condition the belief on the entries of y that were seen. Cost: about 2 p (p + n) (p + k) multiplications."""
    (m, Z, X, size, log_scale), (C, d, V, Ω, period) = prior, measurement
    (p, n), k = C.shape, Z.shape[1]
    innovation = innovation_of(y, seen, C, m, d, period)
    A, B = _joint_factor(C, Z, V, Ω), _joint_directions(C, X, Ω)                           # (1)
    scale = magnitude(y, C, d, size)
    known = KNOWN * (terms(C, Z) + jnp.sum(V * V, axis=1) + scale**2)                      # f below it is rounding
    determined = DETERMINED * terms(C, X)                                                  # and so is f∞

    no = jnp.zeros(p, bool)
    residual = jnp.concatenate([innovation, jnp.zeros(len(A) - p)])
    before = _Array(A, B, residual, innovation, jnp.ones(p), opened=no, informed=no)
    after = repeat(p, lambda j, a: _condition_on_row(a, j, seen[j], known[j], determined[j], k), before)

    ignored = seen & ~after.opened & ~after.informed
    log_likelihood = _log_density(after, log_scale)
    infinite = jnp.sum(B[:p] ** 2, axis=1) > determined
    x, ω = slice(p, p + n), slice(p + n, None)                                             # rows
    return Posterior(
        state=Gaussian(m - after.residual[x], after.A[x], after.B[x], size, log_scale),
        drift=None if Ω is None else Drift(-after.residual[ω], after.A[ω]),
        innovation=jnp.where(seen, innovation, jnp.nan),
        innovation_covariance=jnp.where(infinite[:, None] | infinite[None, :], jnp.nan, gram(A[:p])),
        log_likelihood=log_likelihood,
        error=jnp.where(after.informed, after.error, jnp.nan),
        variance=jnp.where(after.informed, after.variance, jnp.nan),
        contradicted=jnp.any(ignored & (jnp.abs(after.error) > CONTRADICTION * scale)),
    )


def innovation_of(
    y: Float[Real, " p"],
    seen: Bool[Real, " p"],
    C: Float[Real, "p n"],
    m: Float[Real, " n"],
    d: Float[Real, " p"],
    period: Float[Real, " p"] | None,
) -> Float[Real, " p"]:
    """y - C m - d where it was seen, to the nearest turn of an angle, else zero."""
    return jnp.where(seen, nearest(y - apply(C, m) - d, period), 0.0)


def _joint_factor(
    C: Float[Real, "p n"], Z: Float[Real, "n k"], V: Float[Real, "p p"], Ω: Float[Real, "n p"] | None
) -> Float[Real, "_ k+p"]:
    """A of (1)."""
    (p, n), k = C.shape, Z.shape[1]
    outputs = jnp.concatenate([product(C, Z), V], axis=1)
    states = jnp.concatenate([Z, jnp.zeros((n, p))], axis=1)
    if Ω is None:
        return jnp.concatenate([outputs, states])
    return jnp.concatenate([outputs, states, jnp.concatenate([jnp.zeros((n, k)), Ω], axis=1)])


def _joint_directions(C: Float[Real, "p n"], X: Float[Real, "n r"], Ω: Float[Real, "n p"] | None) -> Float[Real, "_ r"]:
    """B of (1)."""
    if Ω is None:
        return jnp.concatenate([product(C, X), X])
    return jnp.concatenate([product(C, X), X, jnp.zeros_like(X)])


def _condition_on_row(a: _Array, j: int | Real, seen: Flag, known: Scalar, determined: Scalar, k: int) -> _Array:
    """Condition every row of the array on the datum of row j, where it was seen. k: the number of its columns for ξ."""
    g, β, error = a.A[j], a.B[j], a.residual[j]
    Ag, Bβ = apply(a.A, g), apply(a.B, β)
    f, f_diffuse = Ag[j], Bβ[j]                                                            # (2)
    opens = seen & (f_diffuse > determined)
    informs = seen & ~opens & (f > known)
    variance = jnp.where(opens, f_diffuse, jnp.where(informs, f, 1.0))
    gain = jnp.where(opens, Bβ, jnp.where(informs, Ag, 0.0)) / variance                    # (4), (3), or none
    own = jnp.where(jnp.arange(len(g)) < k, g, 0.0)                                        # g on ξ alone
    B = diffuse_start.remaining(a.B, a.A, β, own, opens, seen) if len(β) else a.B          # (6)
    at_j = jnp.arange(a.error.shape[0]) == j
    return _Array(
        A=a.A - gain[:, None] * g[None, :],                                                # (5)
        B=B,
        residual=a.residual - gain * error,                                                # (5)
        error=jnp.where(at_j, error, a.error),
        variance=jnp.where(at_j, variance, a.variance),
        opened=a.opened | (at_j & opens),
        informed=a.informed | (at_j & informs),
    )


def _log_density(a: _Array, log_scale: Float[Real, ""]) -> Float[Real, ""]:
    """The sum of (7), of X exp(log_scale)."""
    density = jnp.log(2 * jnp.pi * a.variance)
    density = density + jnp.where(a.opened, 2 * log_scale, a.error**2 / a.variance)
    return -jnp.sum(jnp.where(a.opened | a.informed, density, 0.0)) / 2


def predict(state: Gaussian, transition: Transition, drift: Drift | None = None) -> Gaussian:
    """The belief about x+ = F x + c + ω. Cost: about n² (2 k + q) multiplications."""
    (m, Z, X, size, log_scale), (F, c, W) = state, transition
    ω, Z_ω = (None, None) if drift is None else drift
    Z_next, m_next = _next_factor(F, Z, W, Z_ω), _next_mean(F, m, c, ω)                    # (9), (8)
    size = next_size(F, m, c, size)
    X_next, log_scale = diffuse_start.moved(F, X, log_scale)                               # (10)
    return Gaussian(m_next, Z_next, X_next, size, log_scale)


def _next_mean(
    F: Float[Real, "n n"], m: Float[Real, " n"], c: Float[Real, " n"], ω: Float[Real, " n"] | None
) -> Float[Real, " n"]:
    """(8)."""
    return apply(F, m) + c if ω is None else apply(F, m) + c + ω


def _next_factor(
    F: Float[Real, "n n"], Z: Float[Real, "n k"], W: Float[Real, "n q"], Z_ω: Float[Real, "n k"] | None
) -> Float[Real, "n n"]:
    """(9)."""
    return triangularise(product(F, Z) if Z_ω is None else product(F, Z) + Z_ω, W)
