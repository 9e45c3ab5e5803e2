"""A joint Gaussian belief about outputs, inputs and parameters, moved through the product that gives the next output.

Letters: x = θ'φ with θ = (a, b) and φ = (-past outputs, inputs) both uncertain, jointly Gaussian with factors Θ, Φ of one unit
white vector (C_θθ = ΘΘ', C_θφ = ΘΦ', C_φφ = ΦΦ'). The first two moments of a product of Gaussian numbers are exact:
E x = θ'φ + tr C_θφ, var x = |Φ'θ + Θ'φ|² + Σ_ij (C_θθ)_ij (C_φφ)_ij + (C_θφ)_ij (C_θφ)_ji. The covariance of x with any of them
comes from the linear part alone (third moments of a Gaussian are zero). Athans, Wishner & Bertolini (1968).
"""

import jax.numpy as jnp

from .shapes import Float
from .small import Real, apply, product


def product_moments(
    θ: Float[Real, " d"], φ: Float[Real, " d"], Θ: Float[Real, "d c"], Φ: Float[Real, "d c"]
) -> tuple[Float[Real, ""], Float[Real, " c"], Float[Real, ""]]:
    """For x = θ'φ: E x, its linear part on the white vector, and the variance of the nonlinear rest."""
    shared = product(Θ, Φ.T)                                               # C_θφ
    d = θ.shape[0]
    mean = jnp.sum(θ * φ) + jnp.sum(shared * jnp.eye(d))
    linear = apply(Θ.T, φ) + apply(Φ.T, θ)
    rest = jnp.sum(product(Θ, Θ.T) * product(Φ, Φ.T)) + jnp.sum(shared * shared.T)
    return mean, linear, jnp.maximum(rest, 0.0)


def observe(
    m: Float[Real, " n"], Z: Float[Real, "n n"], e: Float[Real, ""], r: Float[Real, ""]
) -> tuple[Float[Real, " n"], Float[Real, "n n"]]:
    """The belief after an innovation e in its first entry, of noise variance r, by Potter's square root."""
    f = Z[0]
    s = r + jnp.sum(f * f)
    K = apply(Z, f) / s
    return m + K * e, Z - (K / (1 + jnp.sqrt(r / s)))[:, None] * f[None, :]


def come(
    u: Float[Real, ""], last: Float[Real, ""], V: Float[Real, " c"], p: Float[Real, ""]
) -> tuple[Float[Real, ""], Float[Real, " c"], Float[Real, ""]]:
    """Mean, linear part and remaining variance of λ u + (1 - λ) u_last, λ one with probability p, u_last ~ (last, V V')."""
    spread = (u - last) ** 2 + jnp.sum(V * V)
    return p * u + (1 - p) * last, (1 - p) * V, p * (1 - p) * spread
