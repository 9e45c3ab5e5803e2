"""The response of a closed loop to each kind of disturbance, for many designs at once.

Letters: A (b, 2n, 2n) the loops in (x, x - x^), in the units of the scaling; W, V the noises of process and measurement.
Reference: R. W. Bass (2005), criteria [1]-[6]; discrete time in its own formulas.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..kernels import courses as kernel
from ..kernels.decay import nearest_instability
from ..kernels.riccati import clyap, dlyap
from ..models.state_space import StateSpace
from ..results.designs import BEST

ROOM = 4_000_000  # numbers in the powers of all loops computed together
RESONANCE = 1e-6  # relative tolerance of a peak


def bandwidths(A: np.ndarray, dt: float) -> Any:
    """sqrt(σ_min σ_max) of each loop, of log(A) / dt in discrete time: infinite where a pole has no logarithm."""
    if dt == 0:
        return kernel.bandwidth(A)
    log = kernel.logarithm(A)
    known = np.isfinite(log).all(axis=(1, 2))
    found = np.full(len(A), np.inf)
    found[known] = kernel.bandwidth(log[known] / dt)
    return found


def evaluate(
    model: StateSpace, gains: Sequence[tuple[np.ndarray, np.ndarray]], loops: np.ndarray, scaling: np.ndarray
) -> tuple[dict[str, Any], str]:
    """Every criterion of every loop, and the noise to which `dispersion` and `control` refer."""
    continuous, both = model.is_continuous, np.tile(scaling, 2)
    A = loops * (both / both[:, None])
    settled, ρ, total, rows = _over_time(A, continuous)
    away = A if continuous else np.eye(A.shape[1]) - A
    static = 1 / np.linalg.svd(away, compute_uv=False)[:, -1]
    peak = 1 / np.array([nearest_instability(loop, continuous, RESONANCE)[0] for loop in A])
    peak = np.maximum(peak, static)
    dispersion, control, noise = _stochastic(model, gains, loops, both)
    step = 1.0 if continuous else model.dt
    found = (
        settled * step, ρ, 1 / total, 1 / ρ, rows.max(axis=1), dispersion, control, static, peak,
        peak / static,
    )  # fmt: skip
    return dict(zip(BEST, found, strict=True)), noise


def _over_time(A: np.ndarray, continuous: bool) -> tuple[Any, ...]:
    """Settling, ρ, the integrals of the norm and of the rows' norms, for as many loops at a time as fit in memory."""
    size = max(1, ROOM // (kernel.LEVELS * A.shape[1] ** 2))
    parts = []
    for i in range(0, len(A), size):
        some = A[i : i + size]
        course = kernel.courses(some, continuous)
        parts.append((kernel.settling(course), kernel.margins(some, course, continuous), course.total, course.rows))
    return tuple(np.concatenate(part) for part in zip(*parts, strict=True))


def _stochastic(
    model: StateSpace, gains: Sequence[tuple[np.ndarray, np.ndarray]], loops: np.ndarray, both: np.ndarray
) -> tuple[Any, Any, str]:
    """The rms of the state, in units of the scaling, and of the input."""
    own = model.R is not None and np.any(model.Q)
    values = []
    for (K, gain), A in zip(gains, loops, strict=True):
        Q = _noise(model, gain) if own else np.diag(both**2)
        P = (clyap if model.is_continuous else dlyap)(A, Q)
        of_u = np.hstack([-K, K])
        values.append((np.trace(P / (both[:, None] * both)), np.trace(of_u @ P @ of_u.T)))
    dispersion, control = np.sqrt(np.maximum(np.transpose(values), 0.0))
    return dispersion, control, "the model's" if own else "unit white"


def _noise(model: StateSpace, gain: np.ndarray) -> Any:
    """The covariance (per step or second) of the effect of process and measurement noise on (x, x - x^)."""
    n, G = model.n, model.G
    left = np.eye(n) if model.is_continuous else np.eye(n) - gain @ model.C
    W = np.vstack([G, left @ G])
    V = np.vstack([np.zeros_like(gain), gain])
    return W @ model.Q @ W.T + V @ model.R @ V.T
