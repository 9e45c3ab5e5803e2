"""The steps of a filter with uncertain model entries φ, between the state x and the gains θ in (x, φ, θ).

Letters: A(φ) = A + Σ φ_j dA_j, and B, B_end and C likewise; q the number of entries. Given the belief at x^, θ^, φ^:

    F_xφ[:, j] = dA_j x^ + Σ_i θ~^_i (dB_ij u + dB_end_ij u_end),  θ~ = (1, θ)          (1)
    H_φ[:, j] = dC_j x^                                                                 (2)

"considered": rows φ of the filter gain are zero (`kernels.schmidt`), so that φ^ = 0. "estimated": they are not; the filter is
then the extended Kalman filter of (x, φ, θ), with the tangents at its estimate.
Reference: G. J. Bierman, Factorization Methods for Discrete Sequential Estimation (1977), ch. VIII.
"""

from typing import NamedTuple

import jax.numpy as jnp

from .. import checks
from ..annotations import Array
from ..kernels.joint_gain import block_diagonal, effects
from ..models.sampled import SampledModel
from ..models.uncertainty import ModelUncertainty, Tangents
from ..results import Interval
from .belief import Belief, side_by_side


class Parts(NamedTuple):
    """x, φ and θ~ = (1, θ) of a mean."""

    x: Array
    φ: Array
    θ: Array


def parts(mean: Array, q: int, p: int) -> Parts:
    """Split a mean; p gains."""
    n = mean.shape[0] - q - p
    return Parts(mean[:n], mean[n : n + q], jnp.concatenate([jnp.ones(1), mean[n + q :]]))


def with_entries(state: Belief, sigma: Array, mean: Array | float = 0.0) -> Belief:
    """The belief about (x, φ) before the record; `sigma` (q,): the deviations of the entries."""
    q = sigma.shape[0]
    φ = jnp.zeros(q) + mean
    return side_by_side(state, Belief(φ, jnp.eye(q) * sigma[:, None], jnp.zeros((q, 0)), jnp.abs(φ), jnp.zeros(())))


def motion(model: SampledModel, tangents: Tangents, now: Parts, interval: Interval) -> tuple[Array, Array, Array]:
    """The transition (n + q, n + q) of (x, φ), the effect (n + q, 1 + p) of each block of the input, and a constant."""
    (x, φ, θ), u = now, interval.u - model.point.inputs
    there = tangents.moved(model, φ)
    count = θ.shape[0]
    b = effects(there.B, u, count)
    if model.B_end is not None:
        b = b + effects(there.B_end, interval.u_end - model.point.inputs, count)
    columns = []
    for j in range(tangents.count):  # (1)
        db = effects(tangents.B[j], u, count)
        if model.B_end is not None:
            db = db + effects(tangents.B_end[j], interval.u_end - model.point.inputs, count)
        columns.append(jnp.sum(tangents.A[j] * x[None], axis=1) + jnp.sum(db * θ[None], axis=1))
    Fφ = jnp.stack(columns, axis=1)
    n, q = Fφ.shape
    F = jnp.concatenate([
        jnp.concatenate([there.A, Fφ], axis=1), jnp.concatenate([jnp.zeros((q, n)), jnp.eye(q)], axis=1)
    ])  # fmt: skip
    constant = -jnp.sum(Fφ * φ[None], axis=1)  # the mean moves by A(φ^) x^ + B(φ^) u
    return F, _padded(b, q), jnp.concatenate([constant, jnp.zeros(q)])


def observation(model: SampledModel, tangents: Tangents, now: Parts) -> tuple[Array, Array]:
    """The rows (y, n + q) of C for (x, φ), and the constant (y,)."""
    there = tangents.moved(model, now.φ)
    Hφ = jnp.stack([jnp.sum(tangents.C[j] * now.x[None], axis=1) for j in range(tangents.count)], axis=1)  # (2)
    return jnp.concatenate([there.C, Hφ], axis=1), -jnp.sum(Hφ * now.φ[None], axis=1)


def refuse_smoothing(given: ModelUncertainty | None) -> None:
    """For the smoother, which needs a linear model."""
    if given is not None:
        checks.refuse("smooth does not support `uncertainty`: run it on the same filter without it.")


def noise(W: Array, q: int) -> Array:
    """The process noise of (x, φ): φ is constant."""
    return block_diagonal(W, jnp.zeros((q, 0)))


def _padded(b: Array, q: int) -> Array:
    return jnp.concatenate([b, jnp.zeros((q, b.shape[1]))])
