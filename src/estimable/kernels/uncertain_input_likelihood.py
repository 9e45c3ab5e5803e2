"""The likelihood of one output of an output-error model whose inputs are known in mean and variance only.

Letters: x = (B u)/A, y = x + v, u = ū + w with w white, its variances W known row by row; in observable companion form
s+ = F s + G u, y = s_1 + D u + v, so that w is process noise and measurement noise at once. Predicted s ~ (s, P), innovation e of
variance V, gain K.
"""


import jax
import jax.numpy as jnp

from .shapes import Float
from .small import Real, Scalar


def companion(a: Float[Real, " na"], b: Float[Real, "m lags"], delay: int) -> tuple:
    """F (n, n), G (n, m) and D (m,) of B/A."""
    m, lags = b.shape
    n = max(a.shape[0], lags - 1 + delay, 1)
    a = jnp.concatenate([a, jnp.zeros(n - a.shape[0])])
    b = jnp.concatenate([jnp.zeros((m, delay)), b, jnp.zeros((m, n + 1 - delay - lags))], axis=1)
    F = jnp.concatenate([-a[:, None], jnp.eye(n)[:, : n - 1]], axis=1)
    return F, (b[:, 1:] - b[:, :1] * a[None]).T, b[:, 0]


def log_likelihood(
    a: Float[Real, " na"], b: Float[Real, "m lags"], r: Scalar, s: Float[Real, " n"], delay: int, rows: tuple
) -> tuple[Float[Real, ""], Float[Real, " T"], Float[Real, " T"]]:
    """The log likelihood of the seen outputs; innovations and their variances, row by row. `rows`: ū, W (T, m), y, seen (T,)."""
    F, G, D = companion(a, b, delay)

    def step(carry: tuple[Real, ...], row: tuple[Real, ...]) -> tuple[tuple[Real, ...], tuple[Real, ...]]:
        s, P, total = carry
        ū, W, y, seen = row
        V = P[0, 0] + jnp.sum(D * D * W) + r
        e = y - s[0] - jnp.sum(D * ū)
        K = jnp.where(seen, (jnp.sum(F * P[:, 0][None, :], axis=1) + jnp.sum(G * (W * D)[None], axis=1)) / V, 0.0)
        drift = jnp.sum(G[:, None, :] * G[None, :, :] * W[None, None], axis=2)
        moved = jnp.sum(F[:, :, None] * P[None], axis=1)
        P = jnp.sum(moved[:, None, :] * F[None], axis=2) + drift - K[:, None] * K[None] * V
        s = jnp.sum(F * s[None], axis=1) + jnp.sum(G * ū[None], axis=1) + K * e
        total = total - jnp.where(seen, 0.5 * (jnp.log(2 * jnp.pi * V) + e * e / V), 0.0)
        return (s, P, total), (e, V)

    start = (s, jnp.zeros((s.shape[0], s.shape[0])), jnp.zeros(()))
    (_, _, total), (e, V) = jax.lax.scan(step, start, rows)
    return total, e, V
