"""Nonlinear least squares within bounds that a projection keeps (Levenberg-Marquardt). NumPy, outside jit.

Letters: e (N,) residuals, J (N, d) their derivatives, p a step, D the scale of the unknowns, λ the damping, ρ the gain ratio.
Reference: J. Moré (1978) for D and the tests of convergence; H. Nielsen (1999), (2.18)-(2.21), for λ.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

CONVERGED = 1e-13  # relative change of the unknowns or of the sum of squares, or angle to the gradient
STEPS = 200  # at most
FIRST = 1e-3  # damping of the first step, of the scale of the unknowns


class Found(NamedTuple):
    """The unknowns x (d,) at the end, the residuals e there, half their sum of squares, and whether the search converged."""

    x: np.ndarray
    e: np.ndarray
    cost: float
    converged: bool


def search(
    residual: Callable[[np.ndarray], np.ndarray],
    slopes: Callable[[np.ndarray], np.ndarray],
    start: np.ndarray,
    inside: Callable[[np.ndarray], np.ndarray],
    tolerance: float = CONVERGED,
) -> Found:
    """The minimum of |e(x)|² reached from `start`; `inside(x)` brings each trial back within the bounds."""
    x = inside(start)
    e = residual(x)
    cost, D, λ, ν = 0.5 * float(e @ e), np.zeros(len(x)), FIRST, 2.0
    for _ in range(STEPS):
        J = slopes(x)
        D = np.maximum(D, np.linalg.norm(J, axis=0))
        both, d = np.asarray(np.linalg.qr(np.column_stack([J, e]), mode="r")), len(x)
        R, g, size = both[:d, :d], both[:d, d], np.where(D > 0, D, 1.0)  # J = Q R, g = Q'e
        if np.abs(R.T @ g / size).max(initial=0.0) <= tolerance * np.sqrt(2 * cost):  # the angle of e to the columns of J
            return Found(x, e, cost, True)
        while True:
            p = _step(R, g, np.sqrt(λ) * size)
            trial = inside(x + p)
            e_trial = residual(trial)
            new = 0.5 * float(e_trial @ e_trial)
            expected = 0.5 * float(g @ g) - 0.5 * float(np.sum((g + R @ p) ** 2))
            small = np.linalg.norm(size * (trial - x)) <= tolerance * np.linalg.norm(size * x)
            if new < cost:
                break
            if small or expected <= tolerance * cost or λ > 1e30:
                return Found(x, e, cost, True)
            λ, ν = λ * ν, 2 * ν
        ρ = (cost - new) / expected if expected > 0 else 0.0
        done = small or (expected <= tolerance * cost and cost - new <= tolerance * cost)
        x, e, cost = trial, e_trial, new
        if done:
            return Found(x, e, cost, True)
        λ, ν = λ * max(1 / 3, 1 - (2 * ρ - 1) ** 3) if ρ > 0 else λ, 2.0
    return Found(x, e, cost, False)


def _step(R: np.ndarray, g: np.ndarray, damping: np.ndarray) -> np.ndarray:
    """p with (J'J + λ D²) p = -J'e."""
    rows = np.concatenate([R, np.diag(damping)])
    return -np.linalg.lstsq(rows, np.concatenate([g, np.zeros(len(damping))]), rcond=None)[0]


def within(a: np.ndarray, bound: float) -> np.ndarray:
    """a (n,) with the roots of z^n + a_1 z^(n-1) + .. mirrored into the unit circle and cut to |z| <= bound."""
    if not len(a) or np.abs(a).sum() < bound ** len(a):  # Σ |a_i| |z|^-i < 1 on and outside the bound: no root there
        return a
    z = np.roots(np.append(1.0, a))
    if np.abs(z).max(initial=0.0) <= bound * (1 + 1e-12):
        return a
    z = np.where(np.abs(z) > 1, 1 / np.conj(np.where(z == 0, 1.0, z)), z)
    z = z * np.minimum(1.0, bound / np.maximum(np.abs(z), np.finfo(float).tiny))
    return np.real(np.poly(z))[1:]
