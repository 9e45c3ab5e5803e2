"""The obvious JAX code for the filter alone: a masked Joseph form in one `lax.scan`, jitted."""

import jax.numpy as jnp
from jax import lax
from jax.scipy.linalg import cho_solve, solve_triangular

from .peers_jax import compiled


def contender(model, prior, y, keep):
    """A function that filters the record once; a missing output has unit noise and sees no state."""
    A, C, Q, R = (jnp.asarray(getattr(model, letter)) for letter in "ACQR")

    def step(belief, datum):
        m, P = belief
        seen = ~jnp.isnan(datum)
        H, V = jnp.where(seen[:, None], C, 0.0), jnp.where(seen[:, None] & seen, R, jnp.eye(model.p))
        e = jnp.where(seen, datum - C @ m, 0.0)
        L = jnp.linalg.cholesky(H @ P @ H.T + V)
        K = cho_solve((L, True), H @ P).T
        J, z = jnp.eye(model.n) - K @ H, solve_triangular(L, e, lower=True)
        m, P = m + K @ e, J @ P @ J.T + K @ V @ K.T
        total = -0.5 * (z @ z + seen.sum() * jnp.log(2 * jnp.pi)) - jnp.log(jnp.diagonal(L)).sum()
        return (A @ m, A @ P @ A.T + Q), (total, m, P)

    def filtered(y):
        totals, *kept = lax.scan(step, (jnp.asarray(prior.mean), jnp.asarray(prior.covariance)), y)[1]
        return totals.sum(), *kept

    return compiled(filtered, keep)(y)
