"""H. Fang (2009), Algorithm 1: input and state with gains that neglect a correlation, and their true covariance.

Letters: x̂[k] is the state predicted from y[0..k-1], P̂ = Ẑ Ẑ' the algorithm's own covariance, P = Z Z' the true one,
d = H e the input, e = y - C x̂. v = V e_v, ω = Ω e_v + W e_w with e_v, e_w unit white. Every covariance is a factor
times its transpose. The printed line 11, which is not symmetric and can diverge, is therefore not needed.
"""

from typing import NamedTuple

import jax.numpy as jnp

from .shapes import Bool, Float
from .small import Real, apply, product, solve_lower, solve_upper, triangularise

DEFICIENT = 1e-12  # of the norm of a column of D: a smaller remainder after projection on the others is rounding


class Correction(NamedTuple):
    """Input and gains of one sample: x̂+ = A x̂ + K e. `Z_input` is the factor of the input's true covariance."""

    input: Real
    Z_input: Real
    H: Real
    innovation: Real
    deficient: Real


def correct(
    m: Float[Real, " n"],
    Z_hat: Float[Real, "n n"],
    Z: Float[Real, "n n"],
    C: Float[Real, "p n"],
    D: Float[Real, "p d"],
    c: Float[Real, " p"],
    V: Float[Real, "p p"],
    y: Float[Real, " p"],
    seen: Bool[Real, " p"],
) -> Correction:
    """The input of this sample from the outputs that were seen of y = C x + D d + c + v."""
    p = C.shape[0]
    e = jnp.where(seen, y - apply(C, m) - c, 0.0)
    C, D, V2 = masked(C, seen), masked(D, seen), noise(V, seen)
    Q_root = triangularise(jnp.concatenate([product(C, Z_hat), V2], axis=1))  # line 3: Q̂ = C P̂ C' + R
    H, deficient = weighted_left_inverse(D, Q_root)                            # line 4
    true = jnp.concatenate([product(C, Z), V2[:, :p]], axis=1)                 # of C x~ + v, by its true covariance
    return Correction(apply(H, e), product(H, true), H, jnp.where(seen, e, jnp.nan), deficient)


def masked(M: Float[Real, "p k"], seen: Bool[Real, " p"]) -> Float[Real, "p k"]:
    """M with zero rows for unseen outputs."""
    return jnp.where(seen[:, None], M, 0.0)


def noise(V: Float[Real, "p p"], seen: Bool[Real, " p"]) -> Float[Real, "p 2*p"]:
    """The factor of the noise of the seen outputs; an unseen output has its own unit noise and no influence."""
    return jnp.concatenate([masked(V, seen), jnp.where(seen[:, None], 0.0, jnp.eye(len(V)))], axis=1)


def weighted_left_inverse(D: Float[Real, "p d"], Q_root: Float[Real, "p p"]):
    """H = (D' Q^-1 D)^-1 D' Q^-1, (2.14), and whether D is rank-deficient."""
    p, d = D.shape
    D_white = solve_lower(Q_root, D)
    R = triangularise(D_white.T)                                               # R R' = D' Q^-1 D
    pivots = jnp.abs(jnp.sum(R * jnp.eye(d), axis=1))
    norms = jnp.sqrt(jnp.sum(R * R, axis=1))
    W = solve_lower(Q_root, jnp.eye(p))
    H = solve_upper(R.T, solve_lower(R, product(D_white.T, W)))
    return H, jnp.any(pivots <= DEFICIENT * norms)


class Prediction(NamedTuple):
    """x̂ of the next instant, with the algorithm's own covariance and the true one, as factors."""

    m: Real
    Z_hat: Real
    Z: Real


def predict(
    m: Float[Real, " n"],
    Z_hat: Float[Real, "n n"],
    Z: Float[Real, "n n"],
    H: Float[Real, "d p"],
    e: Float[Real, " p"],
    seen: Bool[Real, " p"],
    A: Float[Real, "n n"],
    B: Float[Real, "n d"],
    C: Float[Real, "p n"],
    D: Float[Real, "p d"],
    c: Float[Real, " n"],
    V: Float[Real, "p p"],
    Ω: Float[Real, "n p"] | None,
    W: Float[Real, "n q"],
) -> Prediction:
    """Lines 7 to 11, and (2.27) at the gain in use. Lines 7 to 10 use d~ = -H (C x~ + v) and then a new, independent v."""
    n, p = C.shape[1], C.shape[0]
    C, D, V2 = masked(C, seen), masked(D, seen), noise(V, seen)
    HV, fresh = product(H, V2), jnp.zeros((n, V2.shape[1]))
    x = jnp.concatenate([Z_hat, fresh], axis=1)                                # x~ on (own, v): line 8, Ô = [x; d][x; d]'
    d = jnp.concatenate([-product(H, product(C, Z_hat)), -HV], axis=1)
    Nf = jnp.concatenate([product(C, x) + product(D, d), V2], axis=1)          # Û = Nf Nf', line 9
    Mf = jnp.concatenate([product(A, x) + product(B, d), fresh], axis=1)
    array = triangularise(jnp.concatenate([Nf, Mf]))                           # [[Û^1/2, 0], [T̂ Û^-T/2, (Ŝ - L̂ T̂')^1/2]]
    U_root, T_root, rest = array[:p, :p], array[p:, :p], array[p:, p:]
    L = solve_lower(U_root, T_root.T, transpose=True).T                        # line 10: L̂ = T̂ Û^-1
    K = product(B, H) + L - product(L, product(D, H))                          # x̂+ = A x̂ + B d + L (e - D d)
    K = jnp.where(seen[None, :], K, 0.0)
    own = [rest, W] if Ω is None else [rest, Ω, W]
    F, KV = A - product(K, C), -product(K, V)
    true = jnp.concatenate([product(F, Z), KV if Ω is None else Ω + KV, W], axis=1)
    return Prediction(apply(A, m) + c + apply(K, e), triangularise(jnp.concatenate(own, axis=1)), triangularise(true))
