"""From moments to a verdict: the common part of estimability and regulability."""

from typing import Any

import numpy as np

from ..kernels.echelon import echelon, leading_sign
from ..kernels.reach import DOUBTFUL, ZERO, Reach
from .moments import StateMoments
from .tolerance import judged, scale


def assess(moments: StateMoments) -> dict[str, Any]:
    """The common fields of `Estimability` and `Regulability`."""
    Π, Σ = moments.Π, moments.Σ
    D = scale(np.diagonal(Π))
    λ, V = np.linalg.eigh(Π / (D[:, None] * D))
    certain = λ <= ZERO * max(λ[-1], 0.0)
    known = V[:, certain]
    ρ2, which = _canonical(Σ / (D[:, None] * D), V[:, ~certain] / np.sqrt(λ[~certain]))
    return {
        "verdict": judged(moments.predictor.distance),
        "filter_verdict": judged(moments.filter.distance),
        "distance": moments.predictor.distance,
        "filter_distance": moments.filter.distance,
        "tolerance": (ZERO, DOUBTFUL),
        "singular_values": _singular_values(moments.Γ),
        "directions": _rows(_beside(moments.predictor, known), D),
        "filter_directions": _rows(_beside(moments.filter, known), D),
        "known_directions": _rows(known, D),
        "squared_correlations": ρ2,
        "correlation_directions": (_unit(which / D[:, None])).T,
        "variance_reduction": _share(Σ, Π),
        "filter_variance_reduction": _share(moments.Σ_filter, Π),
        "prior_covariance": Π,
        "covariance": (Π - Σ + (Π - Σ).T) / 2,
    }


def _canonical(Σ: np.ndarray, T: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues of (Σ, Π), ascending, and their vectors, where T T' = Π^-1."""
    ρ2, U = np.linalg.eigh(T.T @ Σ @ T)
    return np.clip(ρ2, 0.0, 1.0), T @ U


def _beside(reach: Reach, known: np.ndarray) -> np.ndarray:
    """The unreached directions, without those known from the start."""
    from scipy.linalg import orth

    left = reach.Z - known @ (known.T @ reach.Z)
    return orth(left, rcond=1e-6) if np.linalg.norm(left) > 1e-6 else left[:, :0]


def _rows(Z: np.ndarray, D: np.ndarray) -> np.ndarray:
    """Directions g with g'x = z' D^-1 x, one per row, with few entries and norm 1."""
    return echelon(Z / D[:, None]).T


def _unit(G: np.ndarray) -> np.ndarray:
    G = G / np.linalg.norm(G, axis=0)
    return G * leading_sign(G)


def _share(Σ: np.ndarray, Π: np.ndarray) -> np.ndarray:
    """Σ_ii / Π_ii, and 0 where Π_ii is 0: a known state cannot be improved."""
    whole = np.diagonal(Π)
    return np.clip(np.where(whole > 0, np.diagonal(Σ) / np.where(whole > 0, whole, 1.0), 0.0), 0.0, 1.0)


def _singular_values(Γ: np.ndarray) -> np.ndarray:
    """All n singular values: zeros where Γ has fewer columns."""
    σ = np.linalg.svd(Γ, compute_uv=False)
    return np.pad(σ, (0, max(len(Γ) - len(σ), 0)))
