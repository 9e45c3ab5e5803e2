"""From moments to a verdict: the common part of estimability and regulability."""

from typing import Any

import numpy as np

from ..kernels.echelon import echelon, leading_sign
from ..kernels.reach import DOUBTFUL, ZERO, Reach
from .moments import StateMoments
from .tolerance import judged, scale


def assess(moments: StateMoments) -> dict[str, Any]:
    """The common fields of `Estimability` and `Regulability`."""
    D, pairs = scale(np.diagonal(moments.Π)), moments.pairs
    known = D[:, None] * pairs.known
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
        "squared_correlations": pairs.squared,
        "correlation_directions": (_unit(pairs.g)).T,
        "variance_reduction": moments.share,
        "filter_variance_reduction": moments.share_filter,
        "prior_covariance": moments.Π,
        "covariance": moments.P,
    }


def _beside(reach: Reach, known: np.ndarray) -> np.ndarray:
    """The unreached directions, without those known from the start."""
    from scipy.linalg import orth

    if known.shape[1] == 0 or reach.Z.shape[1] == 0:
        return reach.Z
    known = orth(known)
    left = reach.Z - known @ (known.T @ reach.Z)
    return orth(left, rcond=1e-6) if np.linalg.norm(left) > 1e-6 else left[:, :0]


def _rows(Z: np.ndarray, D: np.ndarray) -> np.ndarray:
    """Directions g with g'x = z' D^-1 x, one per row, with few entries and norm 1."""
    return echelon(Z / D[:, None]).T


def _unit(G: np.ndarray) -> np.ndarray:
    G = G / np.linalg.norm(G, axis=0)
    return G * leading_sign(G)


def _singular_values(Γ: np.ndarray) -> np.ndarray:
    """All n singular values: zeros where Γ has fewer columns."""
    σ = np.linalg.svd(Γ, compute_uv=False)
    return np.pad(σ, (0, max(len(Γ) - len(σ), 0)))
