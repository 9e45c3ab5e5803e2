"""The response of one output of an output-error model between equal steps: at stamps that are multiples of none. NumPy, SciPy.

Letters: x+ = F x + G u, y = C x + D u, the companion form at the nominal step, u held; F = V diag(λ) V^-1. The continuous system
with these matrices has, over ρ nominal steps, V diag(λ^ρ) V^-1 and V diag((λ^ρ - 1)/(λ - 1)) V^-1 G (Higham 2008, th. 1.31).
"""

from typing import NamedTuple

import numpy as np

from .uncertain_input_likelihood import companion

STEP = 1e-5  # of a parameter, or of 1: of central differences, whose error is then near 1e-10
INTEGRATOR = 1e-6  # |λ - 1| below which (λ^ρ - 1)/(λ - 1) is ρ to first order


class Modes(NamedTuple):
    """λ (n,), β = V^-1 G (n, m), γ = C V (n,), D (m,) and V^-1 (n, n)."""

    λ: np.ndarray
    β: np.ndarray
    γ: np.ndarray
    D: np.ndarray
    inverse: np.ndarray


def modes(a: np.ndarray, b: np.ndarray, delay: int) -> Modes:
    """The modes of B/A; a pole at zero, which no continuous system has, is a very fast one."""
    F, G, D = (np.asarray(M) for M in companion(a, b, delay, 0.0)[:3])
    λ, V = np.linalg.eig(F.astype(complex))
    inverse = np.linalg.inv(V + 1e-12 * np.eye(len(V)))
    return Modes(np.where(np.abs(λ) < 1e-12, 1e-12, λ), inverse @ G, V[0], D, inverse)


def response(a: np.ndarray, b: np.ndarray, delay: int, u: np.ndarray, ρ: np.ndarray, x: np.ndarray | None) -> np.ndarray:
    """y (T,) of u (T, m) held for ρ (T - 1,) nominal steps each, from the state x (n,); None: from rest."""
    m = modes(a, b, delay)
    power = m.λ ** ρ[:, None]
    far = np.abs(m.λ - 1) > INTEGRATOR
    held = np.where(far, (power - 1) / np.where(far, m.λ - 1, 1.0), ρ[:, None])
    start = np.zeros(len(m.λ), complex) if x is None else m.inverse @ x
    y = u @ m.D + 0j
    for i, γ in enumerate(m.γ):
        y += γ * _recursion(power[:, i], held[:, i] * (u[:-1] @ m.β[i]), complex(start[i]))
    return np.real(y)


def free(a: np.ndarray, b: np.ndarray, delay: int, ρ: np.ndarray) -> np.ndarray:
    """dy/dx (T, n): the response to the state at row 0."""
    m = modes(a, b, delay)
    elapsed = np.concatenate([[0.0], np.cumsum(ρ)])
    return np.real((m.γ * m.λ ** elapsed[:, None]) @ m.inverse)


def slopes(
    a: np.ndarray, b: np.ndarray, delay: int, u: np.ndarray, ρ: np.ndarray, x: np.ndarray | None
) -> np.ndarray:
    """dy/dθ (T, d), θ = (a, b): central differences for a; y is linear in b, from rest."""
    columns = []
    for i in range(len(a)):
        h = STEP * np.eye(len(a))[i] * max(abs(a[i]), 1.0)
        up, down = (response(a + side * h, b, delay, u, ρ, x) for side in (1, -1))
        columns.append((up - down) / (2 * h[i]))
    for entry in np.ndindex(b.shape):
        one = np.zeros(b.shape)
        one[entry] = 1.0
        columns.append(response(a, one, delay, u, ρ, None))
    return np.stack(columns, axis=1) if columns else np.zeros((len(u), 0))


def _recursion(power: np.ndarray, driven: np.ndarray, start: complex) -> np.ndarray:
    """ξ (T,) of ξ[k+1] = power[k] ξ[k] + driven[k]; what grows without bound overflows to zeros and infinities."""
    from scipy.linalg.lapack import ztbtrs  # type: ignore[attr-defined]

    band = np.ones((2, len(power) + 1), complex)
    band[1, :-1] = -power
    with np.errstate(over="ignore", invalid="ignore"):
        found, _ = ztbtrs(band, np.concatenate([[start], driven])[:, None], uplo="L", diag="U")
    return np.nan_to_num(found[:, 0], nan=0.0, posinf=1e150, neginf=-1e150)
