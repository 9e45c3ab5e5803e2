"""Recursive identification of one output of an output-error model, from incomplete data.

Letters (Fang 2009, ch. 3): θ = (a, b), φ (3.17), the auxiliary model's output x = φ'θ (3.16), innovation e = y - φ'θ,
gain K (3.14); r the noise variance. Ours: ψ = dx/dθ the slope of the auxiliary output, L with P = L L' that sets the gain,
Z with Σ = Z Z' the covariance of the error of θ at the gain in use, λ in (0, 1] the share of P^-1 that remains after a step.
"""

import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from .shapes import Float
from .small import Real, apply, triangularise

NEAREST = 1e-4  # of 1: how near a reflection coefficient may come (a pole of one lag: 0.9999, 10,000 samples of memory)


def regressor(outputs: Float[Real, " na"], lags: Float[Real, " q"]) -> Float[Real, " d"]:
    """φ: past auxiliary outputs, and the inputs that were applied."""
    return jnp.concatenate([-outputs, lags])                               # (3.17)


def slope(φ: Float[Real, " d"], a: Float[Real, " na"], slopes: Float[Real, "na d"]) -> Float[Real, " d"]:
    """ψ = dx/dθ of x = φ'θ, with the slopes of the outputs in φ."""
    return φ - jnp.sum(a[:, None] * slopes, axis=0)


def learn(
    L: Float[Real, "d d"], g: Float[Real, " d"], r: Float[Real, ""], λ: Float[Real, ""]
) -> tuple[Float[Real, " d"], Float[Real, "d d"]]:
    """K = P g / (λ r + g'P g) and the factor of (P - K g'P) / λ, by Potter's square root. Cost: 3 d² multiplications."""
    f = apply(L.T, g)
    s = λ * r + jnp.sum(f * f)                                             # (3.14), denominator
    K = apply(L, f) / s
    shrunk = 1 / (1 + jnp.sqrt(λ * r / s))                                 # L - L f f' / (s + sqrt(λ r s))
    return K, (L - (K * shrunk)[:, None] * f[None, :]) / jnp.sqrt(λ)       # (3.15)


def recall(
    L: Float[Real, "d d"], h: Float[Real, " d"], w: Float[Real, ""]
) -> tuple[Float[Real, " d"], Float[Real, "d d"]]:
    """K and the factor of P after a datum h'θ of variance 1/w, which may be infinite (w = 0)."""
    f = apply(L.T, h)
    s = 1 + w * jnp.sum(f * f)
    K = apply(L, f) * (w / s)
    return K, L - (K / (1 + jnp.sqrt(1 / s)))[:, None] * f[None, :]


def spread(
    Z: Float[Real, "d d"],
    ψ: Float[Real, " d"],
    K: Float[Real, " d"],
    r: Float[Real, ""],
    h: Float[Real, " d"],
    K_recalled: Float[Real, " d"],
    w: Float[Real, ""],
) -> Float[Real, "d d"]:
    """The factor of Σ after θ + K (ψ'(θ° - θ) + v) and then θ + K_recalled h'(θ0 - θ), at any gains (Joseph's form)."""
    def without(M: Real, K: Real, g: Real) -> Real:
        """M - K (g' M)."""
        return M - K[:, None] * jnp.sum(g[:, None] * M, axis=0)[None, :]

    noisy = jnp.concatenate([without(Z, K, ψ), (jnp.sqrt(r) * K)[:, None]], axis=1)
    noise = K_recalled / jnp.sqrt(jnp.where(w > 0, w, 1.0))
    return triangularise(jnp.concatenate([without(noisy, K_recalled, h), noise[:, None]], axis=1))


def stabilise(a: Float[Real, " na"]) -> Float[Real, " na"]:
    """A(z) with its roots inside the unit circle. A stable A(z) is unchanged; otherwise the outer roots are mirrored.

    Schur-Cohn recursion: A is stable exactly when all reflection coefficients are below 1 in size. A larger coefficient is
    replaced by its inverse, as a root outside the circle would be.
    """
    a, xp = (a, jnp) if isinstance(a, Tracer) else (np.asarray(a), np)          # known numbers need no compilation
    na = a.shape[0]
    stable, reflections = a, []
    for order in range(na, 0, -1):
        k = stable[order - 1]
        outside = xp.abs(k) > 1
        k = xp.clip(xp.where(outside, 1 / xp.where(outside, k, 1.0), k), -1 + NEAREST, 1 - NEAREST)
        reflections.insert(0, k)
        stable = (stable[: order - 1] - k * stable[: order - 1][::-1]) / (1 - k * k)
    for order in range(na):
        k = reflections[order]
        stable = xp.concatenate([stable + k * stable[::-1], k[None]])
    unchanged = xp.max(xp.abs(stable - a), initial=0.0) <= 1e-9 * (1 + xp.max(xp.abs(a), initial=0.0))
    return xp.where(unchanged, a, stable)                                    # to the last bit, not to rounding


def corrected(outputs: Float[Real, " na"], slopes: Float[Real, "na d"], change: Float[Real, " d"]) -> Float[Real, " na"]:
    """Past auxiliary outputs as the changed θ would have given them, to first order."""
    return outputs + apply(slopes, change)


