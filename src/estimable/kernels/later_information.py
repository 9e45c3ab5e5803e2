"""The information in later samples about a state, where every seen output has noise: a square-root information filter, backwards.

The special case of `smoothing` without unknown inputs, cross noise, and noise-free outputs. The samples k, k+1, .. are n data
of unit noise about the deviation of x = x[k] from a nominal m, here the prediction of x from earlier samples:

    ζ = L' (x - m) + ε,   ε unit white, L lower triangular: the information is L L'                     (1)

Model: x+ = F x + c + W e and y = C x + d + V v, with e, v unit white. With L+, ζ+ and m+ of the next state,

    ζ+ - L+' (F m + c - m+) = L+' F (x - m) + L+' W e + ε                                              (2)
    V^-1 (y - C m - d) = V^-1 C (x - m) + v                                                            (3)

e has unit variance, so it is eliminated from (2) by the rotations that condition the array [L+; ζ+'] on the data W' of unit
noise, in `independent`: the time update of information is the measurement update of its dual. (2) and (3) are then
triangularised together. Nothing is inverted but V. Neither L nor what multiplies ζ depends on the data, so both settle.

References: P. Dyer, S. McReynolds, J. Optim. Theory Appl. 3 (1969) 444-458 (square-root information filter); G. J. Bierman,
Factorization Methods for Discrete Sequential Estimation (1977), ch. X; D. C. Fraser, J. E. Potter, IEEE TAC 14 (1969) 387-390.
"""

from typing import NamedTuple

import jax.numpy as jnp

from . import all_outputs, independent
from .kalman import Gaussian, Measurement, innovation_of
from .shapes import Bool, Float
from .small import Real, Scalar, apply, diagonal, product, settled, solve_lower, triangularise
from .smoothing import Instant

EVEN = 1e-5  # the least ratio of the precisions of outputs that are mixed


class Later(NamedTuple):
    """Data (1)."""

    L: Float[Real, "n n"]
    ζ: Float[Real, " n"]
    m: Float[Real, " n"]


def no_later(n: int) -> Later:
    """No information about n states."""
    return Later(jnp.zeros((n, n)), jnp.zeros(n), jnp.zeros(n))


def gathered(
    later: Later, instant: Instant, y: Float[Real, " p"], seen: Bool[Real, " p"], m: Float[Real, " n"]
) -> tuple[Later, Scalar]:
    """Data about x[k] - m from the samples k, k+1, .., given those about x[k+1] from the samples after k.

    The second result is False where an output without noise, or one far more precise than another, needs `smoothing`.
    Cost: about 2 n² (n + p + q) multiplications.
    """
    (F, c, W), measurement, _ = instant
    n = len(m)
    ζ = later.ζ - apply(later.L.T, apply(F, m) + c - later.m)                               # (2)
    Z = _without_noise(jnp.concatenate([later.L, ζ[None, :]]), W)
    moved = jnp.concatenate([product(F.T, Z[:n]), Z[n:]])
    own, even = _whitened(measurement, y, seen, m)                                         # (3)
    N = triangularise(moved, own.T)
    return Later(settled(N[:n, :n], later.L), N[n, :n], m), even


def _without_noise(A: Float[Real, "rows n"], W: Float[Real, "n q"]) -> Float[Real, "rows _"]:
    """The array [L+; ζ+'] once e is eliminated."""
    (rows, k), q = A.shape, W.shape[1]
    update = (all_outputs if all_outputs.is_faster(k, q) else independent).correct
    zeros, C = jnp.zeros(rows), jnp.concatenate([W, jnp.zeros((1, q))]).T
    dual = Gaussian(zeros, A, jnp.zeros((rows, 0)), zeros, jnp.zeros(()))
    return update(dual, Measurement(C, jnp.zeros(q), jnp.eye(q)), jnp.zeros(q), jnp.ones(q, bool)).state.Z


def _whitened(
    measurement: Measurement, y: Float[Real, " p"], seen: Bool[Real, " p"], m: Float[Real, " n"]
) -> tuple[Real, Scalar]:
    """[V^-1 C, V^-1 (y - C m - d)] of the seen outputs, zero for the others; and whether their precisions are comparable."""
    C, d, V, _, period = measurement
    unseen = jnp.eye(len(seen)) * jnp.where(seen, 0.0, 1.0)[:, None]
    L = triangularise(jnp.where(seen[:, None], V, 0.0), unseen)
    residual = innovation_of(y, seen, C, m, d, period)
    rows = jnp.where(seen[:, None], jnp.concatenate([C, residual[:, None]], axis=1), 0.0)
    scale, noise = jnp.sqrt(jnp.sum(C * C, axis=1)), diagonal(L)
    precision = jnp.where(seen & (noise > 0), scale / jnp.where(noise > 0, noise, 1.0), 0.0)
    even = (precision >= EVEN * jnp.max(precision)) & (noise > 0)
    return solve_lower(L, rows), jnp.all(even | ~seen | (scale == 0))


def unit_noise(later: Later) -> Measurement:
    """(1) as a measurement of x - m."""
    n = len(later.ζ)
    return Measurement(later.L.T, jnp.zeros(n), jnp.eye(n))
