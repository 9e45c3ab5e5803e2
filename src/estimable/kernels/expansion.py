"""A nonlinear function of a Gaussian as the nearest linear one: Taylor series to the first or second order, sigma points.

Letters: x = a + L ξ, with ξ (k,) unit white; g: R^n -> R^p. Each expansion gives g(x) ≈ ḡ + G (x - a) + E e, with e unit
white and independent of ξ: the mean ḡ (p,), the slope G (p, n), and the residual E (p, r) of the linear fit. E E' is a
sum of squares, so the covariance G L L' G' + E E' is positive semidefinite in spite of rounding.

References: A. H. Jazwinski, Stochastic Processes and Filtering Theory (1970), §9.3 (second-order filters); M. Athans,
R. P. Wishner, A. Bertolini, IEEE TAC 13 (1968) 504-514; A. P. Sage, J. L. Melsa, Estimation Theory (1971), ch. 9;
S. J. Julier, J. K. Uhlmann, Proc. IEEE 92 (2004) 401-422; I. Arasaratnam, S. Haykin, IEEE TAC 54 (2009) 1254-1269.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp

from .shapes import Float
from .small import Real, factor, gram, product
from .wrapping import nearest


class Expansion(NamedTuple):
    """g(x) ≈ mean + slope (x - a) + rest e; `bias` (p,) is mean - g(a), the effect of the curvature."""

    mean: Real
    slope: Real
    rest: Real
    bias: Real


def jacobian(g: Callable, a: Float[Real, " n"]) -> tuple[Real, Real]:
    """g(a) (p,) and its Jacobian (p, n), one direction at a time: n is small, so no batching."""
    value, push = jax.linearize(g, a)
    return value, jnp.stack([push(e) for e in jnp.eye(a.shape[0])], axis=-1)


def hessian(g: Callable, a: Float[Real, " n"]) -> tuple[Real, Real, Real]:
    """g(a) (p,), its Jacobian (p, n) and its second derivatives (p, n, n)."""
    (value, slope), push = jax.linearize(lambda x: jacobian(g, x), a)
    return value, slope, jnp.stack([push(e)[1] for e in jnp.eye(a.shape[0])], axis=-1)


def first_order(g: Callable, a: Float[Real, " n"], L: Float[Real, "n k"]) -> Expansion:
    """The tangent at a, as in the extended Kalman filter. Cost: g and n of its tangents."""
    value, slope = jacobian(g, a)
    return Expansion(value, slope, jnp.zeros((value.shape[0], 0)), jnp.zeros_like(value))


def second_order(g: Callable, a: Float[Real, " n"], L: Float[Real, "n k"]) -> Expansion:
    """The mean and covariance of the second-order Taylor series at a, exact for Gaussian x: the Gaussian second-order filter.

    ḡ = g + ½ Σ_a c_aa and E E' = ½ Σ_ab c_ab c_ab', with c_ab = g''[L_a, L_b] (Jazwinski §9.3; E[ξ_a ξ_b ξ_c ξ_d] of a
    Gaussian). Cost: n (n + 1) / 2 second derivatives and k² n products.
    """
    value, slope, H = hessian(g, a)
    c = curvatures(H, L)
    k = L.shape[1]
    bias = jnp.sum(jnp.stack([c[i][i] for i in range(k)]), axis=0) / 2
    pairs = [c[i][i] / jnp.sqrt(2.0) for i in range(k)] + [c[i][j] for i in range(k) for j in range(i)]  # c_ab = c_ba: twice
    return Expansion(value + bias, slope, jnp.stack(pairs, axis=1), bias)


def curvatures(H: Float[Real, "p n n"], L: Float[Real, "n k"]) -> list[list[Real]]:
    """c_ab = g''[L_a, L_b], (p,) for each a >= b."""
    p, n, _ = H.shape
    HL = product(H.reshape(p * n, n), L).reshape(p, n, L.shape[1])
    return [[jnp.sum(HL[:, :, i] * L[None, :, j], axis=1) for j in range(i + 1)] for i in range(L.shape[1])]


def bias_only(g: Callable, a: Float[Real, " n"], L: Float[Real, "n k"]) -> Expansion:
    """The second-order mean with the first-order covariance: the extended filter with its bias corrected (Jazwinski §9.3)."""
    full = second_order(g, a, L)
    return full._replace(rest=jnp.zeros((full.mean.shape[0], 0)))


def sigma_points(
    g: Callable, a: Float[Real, " n"], L: Float[Real, "n n"], κ: float, period: Float[Real, " p"] | None = None
) -> Expansion:
    """The unscented mean and covariance, from 2 n + 1 points a, a ± sqrt(n + κ) L_j; κ = 0 is the third-degree cubature.

    With d_j = (g+ - g-) / 2 and s_j = (g+ + g-) / 2 - ḡ of each pair, the covariance Σ (d_j d_j' + s_j s_j') / (n + κ) +
    κ / (n + κ) s_0 s_0' is that of the slope on ξ_j, d_j / sqrt(n + κ), plus squares: no weight is negative for κ >= 0.
    The slope here is on ξ, (p, n): where L is singular there is no slope on x. `period` (p,): angles of g are taken to the turn
    nearest to g(a).
    """
    spread = (a.shape[0] + κ) ** 0.5 * L
    points = [g(a + sign * spread[:, j]) for sign in (1, -1) for j in range(a.shape[0])]
    centre = g(a)
    values = jnp.stack(points, axis=1)
    if period is not None:
        values = centre[:, None] + nearest(values - centre[:, None], period[:, None])
    return from_points(values, centre, κ)


def from_points(values: Float[Real, "p pairs"], centre: Float[Real, " p"], κ: float) -> Expansion:
    """`sigma_points` from the values of g at the points a + reach L_j, then a - reach L_j, and at a itself."""
    n = values.shape[1] // 2
    reach, above, below = (n + κ) ** 0.5, values[:, :n], values[:, n:]
    mean = (jnp.sum(above + below, axis=1) / 2 + κ * centre) / (n + κ)
    rest = ((above + below) / 2 - mean[:, None]) / reach
    if κ > 0:
        rest = jnp.concatenate([rest, ((centre - mean) * (κ**0.5 / reach))[:, None]], axis=1)
    return Expansion(mean, (above - below) / (2 * reach), rest, mean - centre)


def lessened(L: Float[Real, "n n"], b: Float[Real, " n"]) -> Real:
    """The factor of L L' - b b'; NaN where that is not positive semidefinite."""
    P = gram(L) - b[:, None] * b[None, :]
    Z = factor(P)
    misses = jnp.max(jnp.abs(gram(Z) - P)) > 1e-9 * jnp.max(jnp.abs(gram(L)) + jnp.abs(P))
    return jnp.where(misses, jnp.nan, Z)
