"""The motion of actuators under held commands, in closed form, and the response of a linear plant to it.

dp/dt = b (c - p), |dp/dt| <= r: while |c - p| > r / b ("reach") the position p moves at the rate r, then exponentially. An
interval of length h ends with an exponential part of length τ. With p1 the position at its beginning, and v = ±r:

    p(h) = c + (p1 - c) E(τ),   x(h) = Φ(h) x + Γ0(h) p + v [Γ1(h) - Γ1(τ)] + (c - p1) Γl(τ)

Γ0, Γ1, Γl: the responses to a unit step, to a unit ramp and to a unit step through the lag; E(τ) = e^{-b τ}. Without rate limits
τ = h, and these are numbers; else they are Chebyshev series in τ. All functions take one number for each actuator, (m,).
"""

from typing import Any, NamedTuple

import jax.numpy as jnp

from ..annotations import Array


class Ramp(NamedTuple):
    """The part of an interval at the rate limit: the position at its end, its speed, and the rest τ of the interval."""

    end: Any
    speed: Any
    rest: Any


def ramp(p: Array, c: Array, rate: Array, reach: Array, h: Array) -> Ramp:
    """From position p towards the command c at the largest rate, over at most h seconds."""
    error = c - p
    distance = jnp.minimum(jnp.maximum(jnp.abs(error) - reach, 0.0), rate * h)
    end = p + jnp.sign(error) * distance
    return Ramp(end, jnp.where(distance > 0, jnp.sign(error) * rate, 0.0), jnp.maximum(h - distance / rate, 0.0))


def series(coefficients: Array, s: Array):
    """Σ_k coefficients[k] T_k(s), by Clenshaw's recursion; coefficients (degree + 1, .., m), s (m,) in [-1, 1]."""
    s = jnp.broadcast_to(s, coefficients.shape[1:])
    ahead = after = jnp.zeros(s.shape)
    for k in range(coefficients.shape[0] - 1, 0, -1):
        ahead, after = coefficients[k] + 2 * s * ahead - after, ahead
    return coefficients[0] + s * ahead - after


def decay(τ: Array, bandwidth: Array, rate: Array):
    """E(τ). Without a lag (an infinite bandwidth) the position jumps to the command, or arrives there at the end of its ramp."""
    lagging = bandwidth < jnp.inf
    return jnp.where(lagging, jnp.exp(-jnp.where(lagging, bandwidth, 0.0) * τ), jnp.where(rate < jnp.inf, 1.0, 0.0))


def glide(p: Array, c: Array, bandwidth: Array, rate: Array, reach: Array, h: Array) -> tuple[Any, Any]:
    """The position after h seconds, and its integral over them."""
    moved = ramp(p, c, rate, reach, h)
    E = decay(moved.rest, bandwidth, rate)
    return c + (moved.end - c) * E, area(p, c, moved, bandwidth, E, h)


def area(p: Array, c: Array, moved: Ramp, bandwidth: Array, E: Array, h: Array):
    """The integral of the position over an interval of h seconds."""
    lag = jnp.where(bandwidth < jnp.inf, (1 - E) / bandwidth, 0.0)  # ∫ E over the rest
    return (h - moved.rest) * (p + moved.end) / 2 + moved.rest * c + (moved.end - c) * lag
