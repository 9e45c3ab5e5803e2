"""What later samples say of a state, gathered backwards: the second half of a two-filter smoother.

Letters: everything that the samples k, k+1, .. say of x = x[k] is kept as at most as many data as there are states,
z = H x + V ε, ε unit white: a likelihood, which knows of no prior. Model: x+ = F x + c + E δ + ω, y = C x + d + N δ + v,
v = Vy e, ω = Ω e + W e', with e, e' unit white (Ω: cross noise) and δ an input of which nothing is known (E and N may
have no column). Smoothed is then the prediction of x[k] from earlier samples, corrected once by these data: a sum of
squares, so that no covariance is subtracted or inverted, in the past or in the future.

No noise is inverted either, and none need exist. Data are combined by elimination, the most precise datum being the pivot,
so that no datum is drowned in the noise of a worse one; what remains without a state is a datum on the noises alone, and
they are conditioned on it. An input of which nothing is known is eliminated first, and its data dropped.

References: D. C. Fraser, J. E. Potter, IEEE TAC 14 (1969) 387-390, and D. Q. Mayne, Automatica 4 (1966) 73-92 (two
filters); C. C. Paige, SIAM J. Numer. Anal. 16 (1979) 165-171 (least squares with a singular noise, by its factor).
"""

from typing import NamedTuple

import jax.numpy as jnp

from .kalman import KNOWN, MEMORY, SNAPPED
from .shapes import Bool, Float
from .small import Real, apply, product, repeat, triangularise


class Evidence(NamedTuple):
    """Data z = H x + V ε; a row of zeros says nothing. `size`: square of what z and V were computed from."""

    H: Real
    V: Real
    z: Real
    size: Real


class Moved(NamedTuple):
    """x+ = F x + c + E δ + ω, the noise ω = Ω e + W e' (Ω may be None)."""

    F: Real
    c: Real
    E: Real
    W: Real
    Ω: Real | None


class Measured(NamedTuple):
    """y = C x + d + N δ + V e."""

    C: Real
    d: Real
    N: Real
    V: Real


class Instant(NamedTuple):
    """One row of a linear Gaussian model: how x moves from here, and what is measured here."""

    moved: Moved
    measured: Measured

    @staticmethod
    def of(
        F: Float[Real, "n n"], c: Float[Real, " n"], W: Float[Real, "n q"], Ω: Float[Real, "n p"] | None,
        C: Float[Real, "p n"], d: Float[Real, " p"], V: Float[Real, "p p"],
        *, E: Float[Real, "n d"] | None = None, N: Float[Real, "p d"] | None = None,
    ) -> "Instant":  # fmt: skip
        """An instant from its matrices; without E and N every input is known."""
        E = jnp.zeros((F.shape[0], 0)) if E is None else E
        N = jnp.zeros((C.shape[0], E.shape[1])) if N is None else N
        return Instant(Moved(F, c, E, W, Ω), Measured(C, d, N, V))


def nothing(n: int) -> Evidence:
    """Before any sample, nothing is said of n states."""
    return Evidence(jnp.zeros((n, n)), jnp.zeros((n, n)), jnp.zeros(n), jnp.zeros(n))


def earlier(later: Evidence, moved: Moved, measured: Measured, y: Float[Real, " p"], seen: Bool[Real, " p"]) -> Evidence:
    """What is said of (x[k], δ[k]) by the samples k, k+1, .., from what those after k say of x[k+1].

    Rows and columns: states first. Cost: about 2 n (n + p)(2 n + 2 p + q) multiplications.
    """
    (F, c, E, W, Ω), (C, d, N, V) = moved, measured
    n, p = F.shape[0], C.shape[0]
    H = jnp.concatenate([F, E], axis=1)
    H = jnp.where(_is_rounding(G := product(later.H, H), product(jnp.abs(later.H), jnp.abs(H))), 0.0, G)
    W_all = W if Ω is None else jnp.concatenate([W, Ω], axis=1)
    noise = [product(later.H, W_all), jnp.zeros((n, p if Ω is None else 0)), later.V]    # on e', e, ε
    offset = apply(later.H, c)
    size = later.size + apply(jnp.abs(later.H), jnp.abs(c)) ** 2
    now = jnp.concatenate([C, N], axis=1)
    now_noise = jnp.concatenate([jnp.zeros((p, W.shape[1])), V, jnp.zeros((p, n))], axis=1)
    now_size = jnp.sum(V * V, axis=1) + y**2 + d**2
    rows = _Rows(
        H=jnp.concatenate([H, jnp.where(seen[:, None], now, 0.0)]),
        V=jnp.concatenate([jnp.concatenate(noise, axis=1), jnp.where(seen[:, None], now_noise, 0.0)]),
        z=jnp.concatenate([later.z - offset, jnp.where(seen, y - d, 0.0)]),
        size=jnp.concatenate([size, jnp.where(seen, now_size, 0.0)]),
    )
    return _combine(rows, E.shape[1])


def about_state(joint: Evidence, n: int) -> Evidence:
    """What is said of x alone, δ being anything."""
    return Evidence(joint.H[:n, :n], joint.V[:n, :n], joint.z[:n], joint.size[:n])


class _Rows(NamedTuple):
    H: Real
    V: Real
    z: Real
    size: Real


def _combine(rows: _Rows, unknown: int) -> Evidence:
    """The same likelihood in as many rows as there are columns, those that tell of δ last."""
    s, columns = rows.H.shape
    n = columns - unknown

    def eliminate(j, carry):
        """Take column j out of all rows but its pivot: δ first, then x."""
        rows, free, chosen = carry
        column = (j + n) % columns
        row, pivot = _eliminate(rows, free, column)
        return row, free & ~pivot, jnp.where((jnp.arange(columns) == column)[:, None], pivot[None, :], chosen)

    rows, free, chosen = repeat(columns, eliminate, (rows, jnp.ones(s, bool), jnp.zeros((columns, s), bool)))
    rows = repeat(s, lambda i, r: _condition(r, i, free), rows)
    pick = jnp.where(chosen, 1.0, 0.0)
    H, V, z, size = product(pick, rows.H), product(pick, rows.V), apply(pick, rows.z), apply(pick, rows.size)
    return _scaled(H, triangularise(V), z, size)


def _eliminate(rows: _Rows, free: Bool[Real, " s"], column) -> tuple[_Rows, Real]:
    """Take one column out of the free rows by the most precise of them: least noise beside its coefficient."""
    h = jnp.sum(jnp.where(jnp.arange(rows.H.shape[1])[None, :] == column, rows.H, 0.0), axis=1)
    variance = jnp.sum(rows.V * rows.V, axis=1)
    tells = free & (h != 0)
    exact = tells & (variance == 0)
    precision = jnp.where(exact | jnp.any(exact), h**2, h**2 / jnp.where(variance > 0, variance, 1.0))
    precision = jnp.where(jnp.where(jnp.any(exact), exact, tells), precision, -1.0)
    pivot = (jnp.arange(len(h)) == jnp.argmax(precision)) & tells
    p = jnp.where(pivot, 1.0, 0.0)
    h_pivot = jnp.sum(p * h)
    factor = jnp.where(free & ~pivot, h, 0.0) / jnp.where(h_pivot != 0, h_pivot, 1.0)

    def without(M):
        taken = factor[:, None] * jnp.sum(p[:, None] * M, axis=0)[None, :]
        return jnp.where(_is_rounding(M - taken, jnp.abs(M) + jnp.abs(taken)), 0.0, M - taken)

    gone = (jnp.arange(rows.H.shape[1])[None, :] == column) & (free & ~pivot)[:, None]
    return _Rows(
        H=jnp.where(gone, 0.0, without(rows.H)),
        V=without(rows.V),
        z=rows.z - factor * jnp.sum(p * rows.z),
        size=rows.size + factor**2 * jnp.sum(p * rows.size),
    ), pivot


def _condition(rows: _Rows, i, free: Bool[Real, " s"]) -> _Rows:
    """Condition the noises on row i, where it is a datum on them alone."""
    ν = rows.V[i]
    f = jnp.sum(ν * ν)
    informs = free[i] & (f > KNOWN * rows.size[i])
    gain = jnp.where(informs, apply(rows.V, ν), 0.0) / jnp.where(informs, f, 1.0)
    return rows._replace(V=rows.V - gain[:, None] * ν[None, :], z=rows.z - gain * rows.z[i])


def _scaled(H, V, z, size) -> Evidence:
    """Each row times a power of two, which changes nothing but its size."""
    peak = jnp.maximum(jnp.max(jnp.abs(H), axis=1), jnp.max(jnp.abs(V), axis=1))
    power = jnp.where(peak > 0, jnp.exp2(-jnp.round(jnp.log2(jnp.where(peak > 0, peak, 1.0)))), 1.0)
    tells = jnp.max(jnp.abs(H), axis=1) > 0
    power = jnp.where(tells, power, 0.0)
    z = power * z
    size = jnp.maximum(jnp.sum((power[:, None] * V) ** 2, axis=1) + z**2, MEMORY * power**2 * size)
    return Evidence(power[:, None] * H, power[:, None] * V, z, size)


def _is_rounding(difference, terms):
    """Whether what is left of a difference is the rounding of its terms."""
    return jnp.abs(difference) <= SNAPPED * terms
