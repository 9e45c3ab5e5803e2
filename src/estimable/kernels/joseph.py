"""A filter whose gain is given: what its error is after a sample, whatever the gain.

Letters: m, Z and X as in `kalman`, the error x - m = Z ξ with ξ unit white, X what nothing is known of; y = C x + d + V e with e
unit white, and of the process noise the part Ω e. The filter takes m + K (y - C m - d), over the outputs that were seen, hence
x - m becomes (I - K C) Z ξ - K V e: Joseph's form, P = (I - K C) P (I - K C)' + K R K', true of any K.

Reference: R. W. Bass (2005); P. D. Joseph, in R. S. Bucy, P. D. Joseph, Filtering for Stochastic Processes (1968), ch. XVI.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from .riccati import dlyap
from .shapes import Bool, Float
from .small import Real, apply, product


class Moved(NamedTuple):
    """Mean, factor (n, k + p) and diffuse part after a sample; mean and factor of the drift, None where Ω is."""

    m: Real
    Z: Real
    X: Real
    drift: Real | None
    Z_drift: Real | None


def correct(
    m: Float[Real, " n"],
    Z: Float[Real, "n k"],
    X: Float[Real, "n r"],
    K: Float[Real, "n p"],
    C: Float[Real, "p n"],
    d: Float[Real, " p"],
    V: Float[Real, "p p"],
    Ω: Float[Real, "n p"] | None,
    y: Float[Real, " p"],
    seen: Bool[Real, " p"],
) -> Moved:
    """Move the mean by K times what was seen to differ. Cost: about n p (2 k + p) multiplications."""
    K = jnp.where(seen[None, :], K, 0.0)
    e = jnp.where(seen, y - apply(C, m) - d, 0.0)
    Z_next = jnp.concatenate([Z - product(K, product(C, Z)), -product(K, V)], axis=1)      # on (ξ, e)
    X_next = X - product(K, product(C, X))
    if Ω is None:
        return Moved(m + apply(K, e), Z_next, X_next, None, None)
    return Moved(m + apply(K, e), Z_next, X_next, jnp.zeros_like(m), jnp.concatenate([jnp.zeros_like(Z), Ω], axis=1))


def stationary(
    A: Float[np.ndarray, "n n"],
    C: Float[np.ndarray, "p n"],
    K: Float[np.ndarray, "n p"],
    GQG: Float[np.ndarray, "n n"],
    R: Float[np.ndarray, "p p"],
    GS: Float[np.ndarray, "n p"] | None = None,
) -> Float[np.ndarray, "n n"]:
    """The covariance after a sample to which the error settles. NumPy. Raises `AssumptionError` where it does not.

    M = (A J) M (A J)' + A K R K' A' + G Q G' - A K (G S)' - G S (A K)' before a sample, J = I - K C.
    """
    J = np.eye(len(A)) - K @ C
    Q = A @ K @ R @ K.T @ A.T + GQG
    if GS is not None:
        Q = Q - A @ K @ GS.T - GS @ (A @ K).T
    M = dlyap(A @ J, (Q + Q.T) / 2)
    P = J @ M @ J.T + K @ R @ K.T
    return (P + P.T) / 2
