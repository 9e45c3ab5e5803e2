"""What one sample says of unknown numbers θ: rows whose products, summed over the samples, are Fisher's information.

With e and S the innovation and its covariance, ∂_i their derivatives, and S = L L':

    H_ij = Σ_k [∂_i e' S^-1 ∂_j e + ½ tr(S^-1 ∂_i S S^-1 ∂_j S)]                                       (1)
         = Σ_k [u_i' u_j + ½ Σ_ab (W_i)_ab (W_j)_ab],   u = L^-1 ∂e,  W = L^-1 ∂S L'^-1               (2)

(2) needs the numbers of one direction alone, so that every direction is a run by itself.

Reference: K. J. Åström, Automatica 16 (1980) 551-574; N. K. Gupta, R. K. Mehra, IEEE TAC 19 (1974) 774-783.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeAlias

import jax.numpy as jnp
import numpy as np

from .shapes import Float
from .small import Real, diagonal, factor, solve_lower


def features(
    e: Float[Real, " p"], S: Float[Real, "p p"], de: Float[Real, " p"], dS: Float[Real, "p p"]
) -> Float[Real, " f"]:
    """u, and the entries of W with their weights: f = p + p (p + 1) / 2; zero for outputs with NaN in e or S."""
    seen = jnp.isfinite(e) & jnp.isfinite(diagonal(S)) & (diagonal(S) > 0)
    pair = seen[:, None] & seen[None, :]
    L = factor(jnp.where(pair, S, jnp.eye(len(e))))
    u = solve_lower(L, jnp.where(seen, de, 0.0)[:, None])[:, 0]
    W = solve_lower(L, solve_lower(L, jnp.where(pair, dS, 0.0)).T)
    rows, columns = np.tril_indices(len(e), -1)
    return jnp.concatenate([u, diagonal(W) * np.sqrt(0.5), W[rows, columns]])  # (2)


class Maximum(NamedTuple):
    """The end of a search: θ (d,), the log-likelihood and Fisher's information (d, d) there, and of each record the innovations
    (T, p) with their covariances (T, p, p); and whether the search has converged."""

    θ: np.ndarray
    log_likelihood: float
    information: np.ndarray
    innovations: Sequence[tuple[np.ndarray, np.ndarray]]
    converged: bool = True


Build: TypeAlias = Callable[[np.ndarray, int], tuple[Any, Any]]  # the step of record i and its prior, at θ (d,), also complex
# maximises a likelihood, given the samples of each record, a start (d,), and how far each unknown moves in a step of the search
Search: TypeAlias = Callable[[Build, Sequence[Any], np.ndarray, np.ndarray], Maximum]
