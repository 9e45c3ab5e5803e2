"""The α-β tracker: exact stationary covariance of its error.

Letters after R. W. Bass (2005): x = (r, v), Φ = [1 T; 0 1], ΓQΓ' = σ_a² [T³/3 T²/2; T²/2 T], R = σ_s²/T, K = (α, β/T).
P11 = φ σ_a² T³/3 + ψ σ_s²/T as on the slides; P12 and P22 by the same Lyapunov equation, P = Ψ P Ψ' + (I-KH)ΓQΓ'(I-KH)' + KRK'.
"""


def stable(α: float, β: float) -> bool:
    """0 < α < 2 and 0 < β < 2 (2 - α)."""
    return 0 < α < 2 and 0 < β < 2 * (2 - α)


def manoeuvre(α: float, β: float) -> float:
    """φ: what σ_a² T³/3 of acceleration noise leaves of the variance of r."""
    return (1 - α) ** 2 / α * (3 * (2 - α) - β) / (β * (2 * (2 - α) - β))


def noise(α: float, β: float) -> float:
    """ψ: what σ_s²/T of sensor noise leaves of the variance of r."""
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
