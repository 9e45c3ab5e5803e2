"""The gain of a filter whose noises lie among several corners: its loss at each corner, and the best such gain. NumPy.

Letters: K a gain, Ψ = (I - K C) A; N = G Q G' and R of one corner, P(K) the stationary covariance there, K* its Kalman gain,
P* = P(K*), S* = C M* C' + R. Completing the square in Joseph's form,

    P(K) - P* = Ψ (P(K) - P*) Ψ' + (K - K*) S* (K - K*)',    tr W (P(K) - P*) = tr Y (K - K*) S* (K - K*)',   Y = Ψ'Y Ψ + W,

so that the loss of a gain is a sum of squares, never below 0, and one Lyapunov equation serves all corners. P(K) is linear in
(N, R), and P* concave: the loss is largest at a corner of the convex hull, and min over K of Σ λ_i (a_i + s_i tr W P_i(K)) is
at the Kalman gain of Σ λ_i s_i (N_i, R_i). Where the λ that maximise this minimum leave each loss at most equal to it, the gain
is the minimax gain, and that Kalman filter's noise is the least favourable.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from .joseph import stationary
from .riccati import dare, dlyap
from .shapes import Float

Real = np.ndarray
ROUNDING = 1e-13      # of the loss, to which the active corners are equalised
ACTIVE = 1e-5         # share of the mixture from which a corner is active
ROUNDS = 60           # of stabilising an unstable start
STALLED = 1e-4        # increase of the scale in a round without progress


class WeightedPlant(NamedTuple):
    """A, C, and the weight W of the error."""

    A: Real
    C: Real
    W: Real


class Corner(NamedTuple):
    """N = G Q G' and R, and the Kalman filter that knows them: K*, P*, S*, tr W P*."""

    N: Real
    R: Real
    K: Real
    P: Real
    S: Real
    cost: float


def corner(plant: WeightedPlant, N: Float[Real, "n n"], R: Float[Real, "p p"]) -> Corner:
    """The Kalman filter of one corner. Raises `AssumptionError` where there is no stationary one."""
    A, C, W = plant
    M = dare(A.T, C.T, N, R).X
    S = C @ M @ C.T + R
    K = np.linalg.solve(S, C @ M).T
    J = np.eye(len(A)) - K @ C
    P = J @ M @ J.T + K @ R @ K.T
    return Corner(N, R, K, (P + P.T) / 2, S, float(np.sum(W * P)))


def losses(plant: WeightedPlant, corners: list[Corner], K: Float[Real, "n p"]) -> Float[Real, " V"]:
    """tr W (P(K) - P*) at each corner; infinite where the error grows."""
    A, C, W = plant
    Ψ = A - K @ C @ A
    if np.abs(np.linalg.eigvals(Ψ)).max() >= 1 - 1e-12:
        return np.full(len(corners), np.inf)
    Y = dlyap(Ψ.T, W)
    return np.array([np.sum(Y * ((K - one.K) @ one.S @ (K - one.K).T)) for one in corners])


def slopes(plant: WeightedPlant, corners: list[Corner], K: Float[Real, "n p"]) -> Float[Real, "V n p"]:
    """The derivative of each loss: 2 Y (K S - M C'), M and S = C M C' + R those of the gain K."""
    A, C, W = plant
    Y = dlyap((A - K @ C @ A).T, W)
    M = [A @ stationary(A, C, K, one.N, one.R) @ A.T + one.N for one in corners]
    return np.array([2 * Y @ (K @ (C @ m @ C.T + one.R) - m @ C.T) for m, one in zip(M, corners, strict=True)])


class MixedWeights(NamedTuple):
    """The least favourable shares λ (V,), the noise that they mix, and its Kalman filter."""

    shares: Real
    corner: Corner


def mixture(plant: WeightedPlant, corners: list[Corner], a: Float[Real, " V"], s: Float[Real, " V"]) -> MixedWeights:
    """The λ that maximise the minimum over K of Σ λ_i (a_i + s_i loss_i(K)); its Kalman gain is the minimax."""
    from scipy.optimize import minimize

    N, R = np.array([one.N for one in corners]), np.array([one.R for one in corners])

    def mixed(λ: Real) -> Corner:
        part = np.maximum(λ, 0) * s
        part = part / part.sum()                                           # any multiple has the same gain
        return corner(plant, np.tensordot(part, N, 1), np.tensordot(part, R, 1))

    def charge(λ: Real) -> Real:
        return a + s * losses(plant, corners, mixed(λ).K)

    V = len(corners)
    size = max(float(charge(np.full(V, 1 / V)).max()), np.finfo(float).tiny)

    def downhill(λ: Real) -> tuple[float, Real]:
        f = charge(λ) / size
        return -float(np.maximum(λ, 0) @ f), -f                                   # the envelope: K(λ) is where the sum is least

    total = {"type": "eq", "fun": lambda λ: λ.sum() - 1, "jac": lambda λ: np.ones(V)}
    start = np.full(V, 1 / V)
    found = minimize(downhill, start, jac=True, bounds=[(0, 1)] * V, constraints=total, method="SLSQP",
                     options={"ftol": 1e-15, "maxiter": 500})  # fmt: skip
    λ = np.maximum(found.x, 0) / np.maximum(found.x, 0).sum()
    λ = _levelled(charge, λ, size)
    return MixedWeights(λ, mixed(λ))


def _levelled(charge: Callable[[Real], Real], λ: Real, size: float) -> Real:
    """λ after solving for equal losses of the active corners, where that reduces the largest loss."""
    from scipy.optimize import root

    active = np.flatnonzero(λ > ACTIVE)
    if len(active) < 2:
        return λ

    def spread(shares: Real) -> Real:
        trial = np.zeros_like(λ)
        trial[active] = np.append(shares, 1 - shares.sum())
        f = charge(trial)[active] / size
        return f[:-1] - f[-1]

    found = root(spread, λ[active][:-1], tol=ROUNDING)
    better = np.zeros_like(λ)
    better[active] = np.append(found.x, 1 - found.x.sum())
    return better if np.all(better >= 0) and charge(better).max() <= charge(λ).max() else λ


def restricted(
    plant: WeightedPlant, corners: list[Corner], a: Float[Real, " V"], s: Float[Real, " V"], K: Float[Real, "n p"], free: Real
) -> Real | None:
    """A gain, zero except where `free`, that locally minimises the largest a_i + s_i loss_i from K; None where none was found.

    An unstable start is stabilised: with A scaled down it is stable, and each solution tolerates a larger scale. The problem is
    not convex: this is a local minimum.
    """
    K, scale = np.where(free, K, 0.0), 0.0
    for _ in range(ROUNDS):
        before, bears = scale, 1 / max(np.abs(np.linalg.eigvals(plant.A - K @ plant.C @ plant.A)).max(), 1e-300)
        scale = 1.0 if bears > 1 + 1e-9 else scale + 0.9 * (bears - scale)
        if scale - before < STALLED:
            return None
        near = plant._replace(A=scale * plant.A)
        at_scale = corners if scale == 1 else [corner(near, one.N, one.R) for one in corners]
        K = _descend(near, at_scale, a, s, K, free)
        if scale == 1:
            return K
    return None


def _descend(plant: WeightedPlant, corners: list[Corner], a: Real, s: Real, K: Real, free: Real) -> Real:
    """Least t with a_i + s_i loss_i <= t, over the free entries of K, from a stable start."""
    from scipy.optimize import minimize

    first = a + s * losses(plant, corners, K)
    if first.max() == 0 or not free.any():
        return K
    size, unit = float(first.max()), max(float(np.abs(K).max()), 1e-3)

    def gain(z: Real) -> Real:
        full = np.zeros(free.shape)
        full[free] = unit * z[:-1]
        return full

    def slack(z: Real) -> Real:
        f = a + s * losses(plant, corners, gain(z))
        return np.where(np.isfinite(f), z[-1] - f / size, -1e6)

    def slope(z: Real) -> Real:
        lost = losses(plant, corners, gain(z))
        rows = np.zeros((len(corners), free.sum())) if not np.isfinite(lost).all() else (
            -unit * s[:, None] * slopes(plant, corners, gain(z))[:, free] / size)  # fmt: skip
        return np.hstack([rows, np.ones((len(corners), 1))])

    last = np.append(np.zeros(int(free.sum())), 1.0)
    found = minimize(
        lambda z: (z[-1], last), np.append(K[free] / unit, 1.0), jac=True, method="SLSQP",
        constraints={"type": "ineq", "fun": slack, "jac": slope}, options={"ftol": 1e-14, "maxiter": 500},
    )  # fmt: skip
    best = gain(found.x)
    return best if (a + s * losses(plant, corners, best)).max() <= first.max() else K
