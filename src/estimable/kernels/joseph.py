"""A filter with a given gain K: its belief after a sample, for any K.

Letters as in `kalman`, e unit white. The mean moves by K times the innovations that were seen:

    m <- m + K (y - C m - d)                                                                           (1)
    Z <- [(I - K C) Z, -K V]                    on (ξ, e): x - m becomes (I - K C) Z ξ - K V e         (2)
    X <- (I - K C) X                                                                                   (3)

(2) is Joseph's form, P <- (I - K C) P (I - K C)' + K R K', which holds for every K.

Reference: R. W. Bass (2005); P. D. Joseph, in R. S. Bucy, P. D. Joseph, Filtering for Stochastic Processes (1968), ch. XVI.
"""

import jax.numpy as jnp
import numpy as np

from .kalman import Drift, Gaussian, Measurement, innovation_of
from .riccati import dlyap
from .shapes import Bool, Float
from .small import Real, apply, product


def correct(
    prior: Gaussian, K: Float[Real, "n p"], measurement: Measurement, y: Float[Real, " p"], seen: Bool[Real, " p"]
) -> tuple[Gaussian, Drift | None]:
    """The belief after the entries of y that were seen. Cost: about n p (2 k + p) multiplications."""
    (m, Z, X, _, _), (C, d, V, Ω, period) = prior, measurement
    K = jnp.where(seen[None, :], K, 0.0)
    e = innovation_of(y, seen, C, m, d, period)
    Z_next = _factor(K, C, V, Z)                                                           # (2)
    state = prior._replace(m=m + apply(K, e), Z=Z_next, X=X - product(K, product(C, X)))   # (1), (3)
    return state, None if Ω is None else _drift(Z, Ω)


def _factor(
    K: Float[Real, "n p"], C: Float[Real, "p n"], V: Float[Real, "p p"], Z: Float[Real, "n k"]
) -> Float[Real, "n k+p"]:
    """(2)."""
    return jnp.concatenate([Z - product(K, product(C, Z)), -product(K, V)], axis=1)


def _drift(Z: Float[Real, "n k"], Ω: Float[Real, "n p"]) -> Drift:
    """Ω e: of mean zero, since the gain does not use the cross noise."""
    return Drift(jnp.zeros(len(Z)), jnp.concatenate([jnp.zeros_like(Z), Ω], axis=1))


def stationary(
    A: Float[np.ndarray, "n n"],
    C: Float[np.ndarray, "p n"],
    K: Float[np.ndarray, "n p"],
    GQG: Float[np.ndarray, "n n"],
    R: Float[np.ndarray, "p p"],
    GS: Float[np.ndarray, "n p"] | None = None,
) -> Float[np.ndarray, "n n"]:
    """The stationary covariance of the error after a sample. NumPy. Raises `AssumptionError` where there is none.

    Before a sample it is M = (A J) M (A J)' + A K R K' A' + G Q G' - A K (G S)' - G S (A K)', with J = I - K C.
    """
    J = np.eye(len(A)) - K @ C
    Q = A @ K @ R @ K.T @ A.T + GQG
    if GS is not None:
        Q = Q - A @ K @ GS.T - GS @ (A @ K).T
    M = dlyap(A @ J, (Q + Q.T) / 2)
    P = J @ M @ J.T + K @ R @ K.T
    return (P + P.T) / 2
