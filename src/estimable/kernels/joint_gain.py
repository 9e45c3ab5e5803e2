"""The state and the loop gain as one linear time-varying state (x, θ), given the measured input.

Letters: B(θ) = B0 + Σ θ_i B_i and D(θ) = D0 + Σ θ_i D_i; [b0 b1 .. bp] = [B0 u, B1 u, .. Bp u] is the effect of the
input, one column for each block. With p = 1, B0 = 0, B1 = b it is the augmented model of M. Pachter (1999) and A. G.
Sillence (1999): F[k] = [[A, b u[k]], [0, 1]], H = [C 0].
"""

import jax.numpy as jnp

from .shapes import Float
from .small import Real


def effects(blocks: Float[Real, "n columns"], u: Float[Real, " m"], count: int) -> Float[Real, "n count"]:
    """[B0 u, B1 u, ..] from [B0 B1 ..] side by side."""
    n = blocks.shape[0]
    return jnp.sum(blocks.reshape(n, count, u.shape[0]) * u[None, None, :], axis=2)


def transition(A: Float[Real, "n n"], b: Float[Real, "n p"]) -> Float[Real, "n+p n+p"]:
    """F of x+ = A x + b θ, θ+ = θ."""
    n, p = b.shape
    return jnp.concatenate([jnp.concatenate([A, b], axis=1), jnp.concatenate([jnp.zeros((p, n)), jnp.eye(p)], axis=1)])


def observation(C: Float[Real, "y n"], d: Float[Real, "y p"]) -> Float[Real, "y n+p"]:
    """H of y = C x + d θ."""
    return jnp.concatenate([C, d], axis=1)


def block_diagonal(M: Float[Real, "n k"], N: Float[Real, "p r"]) -> Float[Real, "n+p k+r"]:
    """[[M, 0], [0, N]]: what enters x and θ independently."""
    (n, k), (p, r) = M.shape, N.shape
    upper = jnp.concatenate([M, jnp.zeros((n, r))], axis=1)
    return jnp.concatenate([upper, jnp.concatenate([jnp.zeros((p, k)), N], axis=1)])
