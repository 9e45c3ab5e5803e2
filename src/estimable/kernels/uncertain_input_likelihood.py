"""The likelihood of one output of an output-error model whose inputs are known in mean and variance only.

Letters: x = (B u)/A, y = x + v, u = ū + w with w white, its variances W known row by row; in observable companion form
s+ = F s + G u, y = s_1 + D u + v, so that w is process noise and measurement noise at once. Predicted s ~ (s, P), innovation e of
variance V, gain K.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from .shapes import Float, Inexact
from .small import Flag, Real, Scalar


class Companion(NamedTuple):
    """B/A in observable companion form, and the variance r of v."""

    F: Float[Real, "n n"]
    G: Float[Real, "n m"]
    D: Float[Real, " m"]
    r: Scalar


def companion(a: Inexact[np.ndarray, " na"], b: Inexact[np.ndarray, "m lags"], delay: int, r: Scalar) -> Companion:
    """The companion form, in NumPy."""
    m, lags = b.shape
    n = max(a.shape[0], lags - 1 + delay, 1)
    a = np.concatenate([a, np.zeros(n - a.shape[0])])
    b = np.concatenate([np.zeros((m, delay)), b, np.zeros((m, n + 1 - delay - lags))], axis=1)
    F = np.concatenate([-a[:, None], np.eye(n)[:, : n - 1]], axis=1)
    return Companion(F, (b[:, 1:] - b[:, :1] * a[None]).T, b[:, 0], r)


class RowLikelihood(NamedTuple):
    """What one row shows: the innovation, its variance, and the log-likelihood."""

    e: Scalar
    V: Scalar
    log_likelihood: Scalar


def step(
    model: Companion, s: Float[Real, " n"], P: Float[Real, "n n"],
    ū: Float[Real, " m"], W: Float[Real, " m"], y: Scalar, seen: Flag,
) -> tuple[Float[Real, " n"], Float[Real, "n n"], RowLikelihood]:
    """The next (s, P), and the row. An output not seen changes neither."""
    F, G, D, r = model
    V = P[0, 0] + jnp.sum(D * D * W) + r
    e = y - s[0] - jnp.sum(D * ū)
    K = jnp.where(seen, (jnp.sum(F * P[:, 0][None, :], axis=1) + jnp.sum(G * (W * D)[None], axis=1)) / V, 0.0)
    drift = jnp.sum(G[:, None, :] * G[None, :, :] * W[None, None], axis=2)
    moved = jnp.sum(F[:, :, None] * P[None], axis=1)
    P_next = jnp.sum(moved[:, None, :] * F[None], axis=2) + drift - K[:, None] * K[None] * V
    s_next = jnp.sum(F * s[None], axis=1) + jnp.sum(G * ū[None], axis=1) + K * e
    return s_next, P_next, RowLikelihood(e, V, -jnp.where(seen, 0.5 * (jnp.log(2 * jnp.pi * V) + e * e / V), 0.0))
