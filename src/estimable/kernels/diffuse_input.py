"""Unmeasured inputs as variables of infinite variance: conditioning on the outputs is then exact.

Letters: s = (x, d[-L], .., d[0]) is the state with the unknown inputs of the last instants, the newest last. The belief
about s is the Gaussian of `kernels.kalman`: the directions of d that the outputs do not determine stay in X, and the finite
part of the others is generalised least squares. With D of full column rank this is the filter of S. Gillijns and B. De
Moor, Automatica 43 (2007) 934-937; with D = 0 and CB of full column rank it is that of Automatica 43 (2007) 111-116. Here
both, and the cases between them, are one.
"""

import jax.numpy as jnp

from .rounding import is_rounding
from .shapes import Float
from .small import Real, apply, product, triangularise

LARGE = 2.0**20  # X is scaled back above this: an unstable state would grow until a new input is lost in its rounding


def transition(
    A: Float[Real, "n n"], B: Float[Real, "n d"] | None, slots: int, width: int
) -> Float[Real, "s s"]:
    """F of s: x+ = A x + B d[0] (without B: the newest input has already acted), each input one step older, the newest zero."""
    n, d = A.shape[0], width
    at = jnp.zeros((n, d)) if B is None else B
    top = jnp.concatenate([A, jnp.zeros((n, d * (slots - 1))), at], axis=1)
    older = jnp.concatenate([jnp.zeros((d * (slots - 1), n + d)), jnp.eye(d * (slots - 1))], axis=1)
    return jnp.concatenate([top, older, jnp.zeros((d, n + d * slots))])


def entrance(B: Float[Real, "n d"] | None, n: int, slots: int, width: int) -> Float[Real, "s d"]:
    """The columns by which the newest input enters s: its own, and x through B where it acts on x at once."""
    at = jnp.zeros((n, width)) if B is None else B
    return jnp.concatenate([at, jnp.zeros((width * (slots - 1), width)), jnp.eye(width)])


def spread(
    X: Float[Real, "s s"], F: Float[Real, "s s"], E: Float[Real, "s d"], log_scale: Float[Real, ""]
) -> tuple[Float[Real, "s s"], Float[Real, ""]]:
    """The diffuse directions after a step, with a new input of infinite variance; the last d rows of F are zero.

    Only the span of X counts: F X is replaced by its triangular factor, so that X does not grow with the new columns.
    """
    d = E.shape[1]
    L = triangularise(product(F[:-d], X))
    terms = apply(jnp.abs(F[:-d]), jnp.sqrt(jnp.sum(X * X, axis=1)))       # the size of a row without cancellation
    L = jnp.where(is_rounding(L, terms[:, None]), 0.0, L)
    peak = jnp.max(jnp.abs(L))
    power = jnp.where(peak > LARGE, jnp.exp2(-jnp.round(jnp.log2(jnp.where(peak > 0, peak, 1.0)))), 1.0)
    left = jnp.concatenate([power * L, jnp.zeros((d, L.shape[1]))])
    return jnp.concatenate([left, E], axis=1), jnp.where(peak > 0, log_scale - jnp.log(power), 0.0)
