"""The information in later samples about a state, gathered backwards: the second half of a two-filter smoother.

The samples k, k+1, .. are summarised in data about x = x[k], at most one for each state. They are a likelihood, without a prior:

    z = H x + V ε,   ε unit white                                                                      (1)

Model, with e, e' unit white and δ an unknown input without prior (there may be none):

    y = C x + d + v,   x+ = F x + c + E δ + ω,   v = V_y e,  ω = Ω e + W e'   (Ω: cross noise, or None)

Data H+ x+ + V+ ε = z+ about the next state are data about this one, to which the sample adds its own:

    z+ - H+ c = [H+ F, H+ E] [x; δ] + H+ (Ω e + W e') + V+ ε                                           (2)
    y - d     = [C,    0   ] [x; δ] + V_y e                                                            (3)

More data than states are combined by elimination. With i the most precise datum of state j, the one of least noise for its
coefficient, state j leaves every other datum l that is still free:

    (H, V, z)_l <- (H, V, z)_l - (H_lj / H_ij) (H, V, z)_i                                             (4)

Precise data are not mixed with the noise of worse ones. The unknown input is eliminated first, and its data are dropped.
What remains without a state is a datum on the noises alone; with ν its row of V, the noises are conditioned on it:

    V <- V - k ν,  z <- z - k z_i,  k = V ν' / ν ν'                                                    (5)

The smoothed state is the prediction from earlier samples, corrected once by (1). No covariance is subtracted or inverted,
and every noise may be zero.

References: D. C. Fraser, J. E. Potter, IEEE TAC 14 (1969) 387-390, and D. Q. Mayne, Automatica 4 (1966) 73-92 (two
filters); C. C. Paige, SIAM J. Numer. Anal. 16 (1979) 165-171 (least squares with a singular noise, by its factor).
"""

from typing import NamedTuple

import jax.numpy as jnp

from .kalman import Measurement, Transition
from .rounding import KNOWN, MEMORY, is_rounding
from .shapes import Bool, Float
from .small import Real, Scalar, apply, product, repeat, triangularise


class Evidence(NamedTuple):
    """Data (1); a row of zeros carries no information."""

    H: Float[Real, "s n"]
    V: Float[Real, "s _"]
    z: Float[Real, " s"]
    size: Float[Real, " s"]        # squared, of what z and V were computed from


class Instant(NamedTuple):
    """One row of a linear Gaussian model: the measurement here, and the step from here to the next row."""

    transition: Transition
    measurement: Measurement
    E: Float[Real, "n d"] | None = None    # where an unknown input enters the next state; None where there is none


def nothing(n: int) -> Evidence:
    """No information about n states: before any sample."""
    return Evidence(jnp.zeros((n, n)), jnp.zeros((n, n)), jnp.zeros(n), jnp.zeros(n))


def earlier(later: Evidence, instant: Instant, y: Float[Real, " p"], seen: Bool[Real, " p"]) -> Evidence:
    """Data about (x[k], δ[k]) from the samples k, k+1, .., given those about x[k+1] from the samples after k.

    Rows and columns: states first. Cost: about 2 n (n + p)(2 n + 2 p + q) multiplications.
    """
    (F, c, W), (C, d, V, Ω, _), E = instant
    (p, n), E = C.shape, jnp.zeros((len(F), 0)) if E is None else E
    FE = jnp.concatenate([F, E], axis=1)
    H = product(later.H, FE)                                                               # (2)
    H = jnp.where(is_rounding(H, product(jnp.abs(later.H), jnp.abs(FE))), 0.0, H)
    W_all = W if Ω is None else jnp.concatenate([W, Ω], axis=1)
    noise = [product(later.H, W_all), jnp.zeros((n, p if Ω is None else 0)), later.V]      # (2), on (e', e, ε)
    size = later.size + apply(jnp.abs(later.H), jnp.abs(c)) ** 2
    H_now = jnp.concatenate([C, jnp.zeros((p, E.shape[1]))], axis=1)                       # (3)
    V_now = jnp.concatenate([jnp.zeros((p, W.shape[1])), V, jnp.zeros((p, n))], axis=1)    # (3), on (e', e, ε)
    size_now = jnp.sum(V * V, axis=1) + y**2 + d**2
    data = Evidence(
        H=jnp.concatenate([H, jnp.where(seen[:, None], H_now, 0.0)]),
        V=jnp.concatenate([jnp.concatenate(noise, axis=1), jnp.where(seen[:, None], V_now, 0.0)]),
        z=jnp.concatenate([later.z - apply(later.H, c), jnp.where(seen, y - d, 0.0)]),
        size=jnp.concatenate([size, jnp.where(seen, size_now, 0.0)]),
    )
    return _combined(data, E.shape[1])


def about_state(joint: Evidence, n: int) -> Evidence:
    """The data about x alone, for any δ."""
    return Evidence(joint.H[:n, :n], joint.V[:n, :n], joint.z[:n], joint.size[:n])


def _combined(data: Evidence, unknown: int) -> Evidence:
    """The same likelihood with one datum per column, those about δ last."""
    s, columns = data.H.shape
    n = columns - unknown

    def eliminate(j: int | Real, carry: tuple[Evidence, Real, Real]) -> tuple[Evidence, Real, Real]:
        """Eliminate column j from all free data except its pivot: δ first, then x."""
        data, free, chosen = carry
        column = jnp.where(j < unknown, j + n, j - unknown)
        data, pivot = _eliminated(data, free, column)
        return data, free & ~pivot, jnp.where((jnp.arange(columns) == column)[:, None], pivot[None, :], chosen)

    data, free, chosen = repeat(columns, eliminate, (data, jnp.ones(s, bool), jnp.zeros((columns, s), bool)))
    data = repeat(s, lambda i, a: _condition_on_noise(a, i, free), data)
    pick = jnp.where(chosen, 1.0, 0.0)
    H, V, z, size = product(pick, data.H), product(pick, data.V), apply(pick, data.z), apply(pick, data.size)
    return _scaled(H, triangularise(V), z, size)


def _eliminated(data: Evidence, free: Bool[Real, " s"], column: Scalar) -> tuple[Evidence, Real]:
    """(4): the free data without one column, and the index of its pivot."""
    h = jnp.sum(jnp.where(jnp.arange(data.H.shape[1])[None, :] == column, data.H, 0.0), axis=1)
    variance = jnp.sum(data.V * data.V, axis=1)
    candidate = free & (h != 0)
    exact = candidate & (variance == 0)
    precision = jnp.where(exact | jnp.any(exact), h**2, h**2 / jnp.where(variance > 0, variance, 1.0))
    precision = jnp.where(jnp.where(jnp.any(exact), exact, candidate), precision, -1.0)
    pivot = (jnp.arange(len(h)) == jnp.argmax(precision)) & candidate
    p = jnp.where(pivot, 1.0, 0.0)
    h_pivot = jnp.sum(p * h)
    ratio = jnp.where(free & ~pivot, h, 0.0) / jnp.where(h_pivot != 0, h_pivot, 1.0)       # H_lj / H_ij

    def without(M: Real) -> Real:
        taken = ratio[:, None] * jnp.sum(p[:, None] * M, axis=0)[None, :]
        return jnp.where(is_rounding(M - taken, jnp.abs(M) + jnp.abs(taken)), 0.0, M - taken)

    gone = (jnp.arange(data.H.shape[1])[None, :] == column) & (free & ~pivot)[:, None]
    return Evidence(
        H=jnp.where(gone, 0.0, without(data.H)),
        V=without(data.V),
        z=data.z - ratio * jnp.sum(p * data.z),
        size=data.size + ratio**2 * jnp.sum(p * data.size),
    ), pivot


def _condition_on_noise(data: Evidence, i: int | Real, free: Bool[Real, " s"]) -> Evidence:
    """(5), where row i is a datum on the noises alone."""
    ν = data.V[i]
    f = jnp.sum(ν * ν)
    informs = free[i] & (f > KNOWN * data.size[i])
    k = jnp.where(informs, apply(data.V, ν), 0.0) / jnp.where(informs, f, 1.0)
    return data._replace(V=data.V - k[:, None] * ν[None, :], z=data.z - k * data.z[i])


def _scaled(H: Real, V: Real, z: Real, size: Real) -> Evidence:
    """Each row times a power of two, which changes its size only."""
    peak = jnp.maximum(jnp.max(jnp.abs(H), axis=1), jnp.max(jnp.abs(V), axis=1))
    power = jnp.where(peak > 0, jnp.exp2(-jnp.round(jnp.log2(jnp.where(peak > 0, peak, 1.0)))), 1.0)
    power = jnp.where(jnp.max(jnp.abs(H), axis=1) > 0, power, 0.0)
    z = power * z
    size = jnp.maximum(jnp.sum((power[:, None] * V) ** 2, axis=1) + z**2, MEMORY * power**2 * size)
    return Evidence(power[:, None] * H, power[:, None] * V, z, size)
