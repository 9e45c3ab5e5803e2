"""The input that brings the next output of an output-error model to its reference.

Letters (Fang 2009, ch. 4): A = 1 + a1 z^-1 + .., B = b0 + b1 z^-1 + .., x the past outputs that are fed back, u the inputs, r
the reference. Ours: B~ = D (1 + β~1 z^-1 + ..) with its zeros inside the unit circle and B~(1) = B(1); δ with
A δ = (B~ - B) u, so that ξ = x + δ obeys A ξ = B~ u and can be set to r at once.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp

from .auxiliary_model import stabilise
from .shapes import Float
from .small import Flag, Real, Scalar, apply, factor, product, solve_lower

DOUBT = 0.5  # standard deviations: a smaller divisor is raised to this
LEAST = 1e-3  # of the sum of |b|: the smallest divisor


class Numerator(NamedTuple):
    """B~: its divisor D, its coefficients (nb+1,), the variance of D, and whether B has all zeros inside already."""

    divisor: Any
    coefficients: Any
    variance: Any
    minimum_phase: Any


def forecast(
    a: Float[Real, "p na"], b: Float[Real, "p m lags"], x: Float[Real, "p na"], u: Float[Real, "m q"], delay: int
) -> Float[Real, "p na"]:
    """Past outputs `delay` samples later, for already known inputs u (newest first)."""
    lags = b.shape[2]
    for j in range(delay):
        window = u[:, delay - 1 - j : delay - 1 - j + lags]
        now = jnp.sum(b * window[None], axis=(1, 2)) - jnp.sum(a * x, axis=1)   # (4.2)
        x = jnp.concatenate([now[:, None], x], axis=1)[:, : x.shape[1]]
    return x


def as_given(b: Float[Real, " lags"], P: Float[Real, "lags lags"]) -> Numerator:
    """B itself, taken as exact; the input then cancels its zeros."""
    return Numerator(b[0], b, jnp.zeros(()), jnp.asarray(True))


def mirrored(b: Float[Real, " lags"], P: Float[Real, "lags lags"]) -> Numerator:
    """B with the zeros outside the unit circle mirrored and its static gain unchanged; B itself where there are none."""
    β = b[1:] / jnp.where(b[0] != 0, b[0], 1.0)
    β = jnp.where(b[0] != 0, β, b[1:] / (LEAST**2 * jnp.maximum(jnp.sum(jnp.abs(b)), 1e-300)))   # b0 = 0: a zero far out
    inside = stabilise(β)
    same = jnp.sum(jnp.abs(inside - β)) == 0
    size = 1 + jnp.sum(inside)                                             # B~(1) / D > 0
    D = jnp.where(same & (b[0] != 0), b[0], jnp.sum(b) / size)
    variance = jnp.where(same, P[0, 0], jnp.sum(P) / size**2)
    return Numerator(D, D * jnp.concatenate([jnp.ones(1), inside]), variance, same)


def guarded(divisor: Scalar, variance: Scalar, b: Float[Real, " lags"], lower: Scalar) -> Real:
    """The divisor with its sign, no nearer to zero than `lower` and than its uncertainty allows."""
    floor = jnp.maximum(jnp.maximum(lower, DOUBT * jnp.sqrt(variance)), LEAST * jnp.sum(jnp.abs(b)))
    return jnp.where(jnp.abs(divisor) >= floor, divisor, jnp.where(divisor < 0, -floor, floor))


def least_squares(B: Float[Real, "p p"], wanted: Float[Real, " p"], damping: Scalar) -> Float[Real, " p"]:
    """u with B u = wanted, and smaller where B is nearly singular: (B'B + damping I)^-1 B' wanted."""
    L = factor(product(B.T, B) + damping * jnp.eye(B.shape[0]))
    right = apply(B.T, wanted)[:, None]
    return solve_lower(L, solve_lower(L, right), transpose=True)[:, 0]


def deviate(
    ε: Float[Real, " na"], P: Float[Real, "na na"], a: Float[Real, " na"], e: Scalar, seen: Flag, q: Scalar
) -> tuple[Float[Real, " na"], Float[Real, "na na"]]:
    """Past deviations from the model's outputs, A ε = w, by a Kalman filter of e = ε + v; q = var w / var v."""
    na = ε.shape[0]
    first = jnp.where(jnp.arange(na) == 0, 1.0, 0.0)
    F = jnp.concatenate([-a[None], jnp.eye(na)[: na - 1]])
    P = product(product(F, P), F.T) + q * first[:, None] * first[None, :]
    ε = apply(F, ε)
    K = P[:, 0] / (P[0, 0] + 1)
    J = jnp.eye(na) - K[:, None] * first[None, :]
    P_seen = product(product(J, P), J.T) + K[:, None] * K[None, :]
    return jnp.where(seen > 0, ε + K * (e - ε[0]), ε), jnp.where(seen > 0, P_seen, P)
