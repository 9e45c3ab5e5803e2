"""The α-β tracker: exact stationary covariance of its error, and gains by index and by poles.

Letters after R. W. Bass (2005): x = (r, v), Φ = [1 T; 0 1], ΓQΓ' = σ_a² [T³/3 T²/2; T²/2 T], R = σ_s²/T, K = (α, β/T).
P11 = φ σ_a² T³/3 + ψ σ_s²/T as on the slides; P12 and P22 by the same Lyapunov equation, P = Ψ P Ψ' + (I-KH)ΓQΓ'(I-KH)' + KRK'.
α-β-γ: x = (r, v, a), K = (α, β/T, γ/T²); others write γ/(2T²), twice our γ. P. R. Kalata, IEEE TAES 20 (1984) 174.
"""

from typing import Any

import jax
import numpy as np

UNSTABLE = "an α-β tracker is stable for 0 < α < 2 and 0 < β < 2 (2 - α) only. Got α = {:g}, β = {:g}."


def stable(α: float, β: float) -> bool:
    """0 < α < 2 and 0 < β < 2 (2 - α)."""
    return 0 < α < 2 and 0 < β < 2 * (2 - α)


def manoeuvre(α: float, β: float) -> float:
    """φ: the variance of r due to acceleration noise, in units of σ_a² T³/3."""
    return (1 - α) ** 2 / α * (3 * (2 - α) - β) / (β * (2 * (2 - α) - β))


def noise(α: float, β: float) -> float:
    """ψ: the variance of r due to sensor noise, in units of σ_s²/T."""
    return (2 * α**2 + (2 - 3 * α) * β) / (α * (2 * (2 - α) - β))


def of_manoeuvre(α: float, β: float, T: float) -> tuple[float, float, float]:
    """P11, P12, P22 for σ_a² = 1 and no sensor noise; M = Φ P Φ' + ΓQΓ' is the predicted covariance."""
    M11 = T**3 / 3 * (3 * (2 - α) - β) / (α * β * (2 * (2 - α) - β))   # P11 = (1 - α)² M11
    M12 = T**2 / (2 * β) + β * M11 / (2 * T)                           # P22 = P22 + T - 2 (β/T) M12 + (β/T)² M11
    P12 = (1 - α) * (M12 - β * M11 / T)
    return T**3 / 3 * manoeuvre(α, β), P12, (M12 - P12) / T - T / 2    # M12 = P12 + T P22 + T²/2


def of_noise(α: float, β: float, T: float) -> tuple[float, float, float]:
    """P11, P12, P22 for σ_s² = 1 (R = 1/T) and no acceleration noise."""
    common = α * (2 * (2 - α) - β)
    return noise(α, β) / T, β * (2 * α - β) / (common * T**2), 2 * β**2 / (common * T**3)


def kalata(Λ: float | jax.Array) -> tuple[Any, Any]:
    """The optimal α and β for an acceleration constant over each step, of index Λ = σ_w T² / σ_v. Accepts JAX arrays.

    s² = 1 - α solves 2 (1 - s)² = Λ s (Kalata 1984), from which β = 2 (1 - s)²; 1 - s without its cancellation for a small Λ.
    """
    root = (8 * Λ + Λ**2) ** 0.5
    s = 4 / (4 + Λ + root)
    rest = (Λ + root) / (4 + Λ + root)                                 # 1 - s
    return rest * (1 + s), 2 * rest**2


def kalata_gamma(Λ: float) -> tuple[float, float, float]:
    """The same where the acceleration is increased at each step: with q = 1 - s, 2 q³ = Λ (1 - q) (2 - q), γ = β² / (2 α)."""
    roots = np.roots([2.0, -Λ, 3 * Λ, -2 * Λ])
    q = float(min(roots, key=lambda z: abs(z.imag) + max(0.0, -z.real) + max(0.0, z.real - 1)).real)
    for _ in range(3):                                                 # Newton removes the rounding of `roots`
        q -= (2 * q**3 - Λ * (1 - q) * (2 - q)) / (6 * q**2 + Λ * (3 - 2 * q))
    return q * (2 - q), 2 * q**2, 2 * q**3 / (2 - q)


def fading(θ: float) -> tuple[float, float, float]:
    """α, β, γ with all three poles of the error at θ."""
    return 1 - θ**3, 1.5 * (1 - θ) ** 2 * (1 + θ), (1 - θ) ** 3


def poles(*gains: float) -> np.ndarray:
    """The poles of the error with the gains (α, β) or (α, β, γ), K = (α, β / T, γ / T²); they do not depend on T."""
    Φ = np.array([[1.0, 1.0, 0.5], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]])[: len(gains), : len(gains)]
    return np.linalg.eigvals(Φ - np.outer(gains, Φ[0]))
