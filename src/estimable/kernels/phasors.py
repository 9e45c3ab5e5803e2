"""A transfer function from sinusoids: in-phase and quadrature parts, then linear equations for its coefficients. NumPy.

Letters: y = Σ_k A_k sin ω_k t + B_k cos ω_k t + c + e, so that H(jω_k) = A_k + j B_k where u = sin ω_k t (9), (11). J. Sillence
(1999) ch. 2; his -a_i are our a_i: H = Σ b_i s^(n-i) / (s^n + Σ a_i s^(n-i)).
"""

from typing import NamedTuple

import numpy as np

from .regression import regress

ROUNDS = 3  # of alternating weights and coefficients


class Phasors(NamedTuple):
    """Y_k (K,) complex of a signal, their covariance (2K, 2K) (all real parts, then all imaginary) for noise of variance 1,
    and the residuals (N,) of the known rows."""

    values: np.ndarray
    covariance: np.ndarray
    e: np.ndarray


def phasors(y: np.ndarray, t: np.ndarray, ω: np.ndarray, σ: np.ndarray) -> Phasors:
    """The phasors of y (T,) at times t (T,), NaN where not seen, at ω (K,) rad/s, weighted by σ (T,), the standard deviations of
    the noise; a constant is fitted as well."""
    seen, K = ~np.isnan(y), len(ω)
    angle, σ = np.outer(t[seen], ω), σ[seen]
    Φ = np.concatenate([np.sin(angle), np.cos(angle), np.ones((len(angle), 1))], axis=1)
    found = regress(Φ / σ[:, None], y[seen] / σ)
    return Phasors(found.θ[:K] + 1j * found.θ[K : 2 * K], found.inverse[: 2 * K, : 2 * K], y[seen] - Φ @ found.θ)


def rotated(Σ: np.ndarray, g: np.ndarray) -> np.ndarray:
    """The covariance of g_k Y_k for known complex g (K,), from that of Y."""
    T = np.block([[np.diag(np.real(g)), -np.diag(np.imag(g))], [np.diag(np.imag(g)), np.diag(np.real(g))]])
    return T @ Σ @ T.T


class Equations(NamedTuple):
    """θ = (a, b) (d,), its covariance (d, d), and the rank of the equations."""

    θ: np.ndarray
    covariance: np.ndarray
    rank: int


def coefficients(H: np.ndarray, Σ: np.ndarray, q: np.ndarray, n: int) -> Equations:
    """a_1..a_n and b_1..b_n of H_k = Σ_i q_k^i b_i / (1 + Σ_i q_k^i a_i), q = 1/(jω) (12) or z^-1, weighted by the covariance Σ.

    Two real equations per phasor (14). More than n of them are solved by least squares, with the weights of the last solution.
    """
    powers = q[:, None] ** np.arange(1, n + 1)
    Φ = _real(np.concatenate([-H[:, None] * powers, powers], axis=1))
    found = regress(Φ, _real(H[:, None])[:, 0])
    rank = int(np.linalg.matrix_rank(Φ / np.maximum(np.linalg.norm(Φ, axis=0), 1e-300), tol=1e-10))
    for _ in range(ROUNDS):
        W = np.linalg.pinv(_root(rotated(Σ, 1 + powers @ found.θ[:n])))  # of the equations' errors, (1 + Σ q^i a_i) δH
        found = regress(W @ Φ, W @ _real(H[:, None])[:, 0])
    return Equations(found.θ, found.inverse, rank)


def _real(M: np.ndarray) -> np.ndarray:
    return np.concatenate([np.real(M), np.imag(M)])


def _root(Σ: np.ndarray) -> np.ndarray:
    values, vectors = np.linalg.eigh((Σ + Σ.T) / 2)
    return (vectors * np.sqrt(np.maximum(values, 1e-14 * values.max(initial=1e-300)))) @ vectors.T


def second_order(A: float, B: float, ω: float) -> tuple[float, float]:
    """ω_n and ζ of ω_n² / (s² + 2 ζ ω_n s + ω_n²) with the phasor A + j B at ω, §2.2.1 (his ζω in the second line is ζω_n)."""
    r = A**2 + B**2
    return ω * float(np.sqrt(r / (r - A))), -B / (2 * float(np.sqrt((r - A) * r)))
