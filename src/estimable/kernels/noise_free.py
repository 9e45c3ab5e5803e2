"""A sample without noise, by channels, for the elements of `square_root_elements`. NumPy, outside jit.

A channel without noise gives infinite information about coordinates that have no noise themselves, so that S must hold the prior.
"""

import numpy as np

from .shapes import Float
from .square_root_elements import Element, compressed, lower

Real = np.ndarray
ROUNDING = 1e-13  # of the terms of a channel, below which nothing new is left in it


def of_known_prior(L: Float[Real, "n l"], D: Float[Real, "n d"]) -> Element:
    """A prior whose finite part is in S: Φ has the diffuse directions only."""
    return Element(D, L, np.zeros((0, D.shape[1])))


def moved(E: Element, A: Float[Real, "n n"], g: Float[Real, "n w"]) -> Element:
    """x+ = A x + g w."""
    return Element(A @ E.Φ, compressed(np.hstack([A @ E.S, g])), E.Z)


def corrected(E: Element, C: Float[Real, "p n"], R: Float[Real, "p p"]) -> Element:
    """The sample y = C x + v, cov v = R of any rank, channel by channel after a rotation of R."""
    size = np.sqrt(np.maximum(np.diagonal(R), 0.0))
    unit = np.where(size > 0, size, 1.0)
    λ, V = np.linalg.eigh(R / unit[:, None] / unit)
    noisy = λ > len(R) * np.finfo(float).eps
    for c, r in zip(V.T @ (C / unit[:, None]), np.sqrt(np.where(noisy, λ, 0.0)), strict=True):
        E = _channel(E, c, float(r))
    return E


def _channel(E: Element, c: Real, r: float) -> Element:
    f, e, n = c @ E.S, c @ E.Φ, len(c)
    largest = np.abs(c) @ np.abs(E.S).max(axis=1, initial=0.0)
    if r == 0 and np.abs(f).max(initial=0.0) <= ROUNDING * largest:
        E = Element(E.Φ, E.S, E.Z)
        return _diffuse_channel(E, e) if np.abs(e).max(initial=0.0) > ROUNDING else E
    array = np.vstack([np.append(r, f), np.hstack([np.zeros((n, 1)), E.S])])
    both = lower(array)
    s, K, S = both[0, 0], both[1:, 0], both[1:, 1:]
    return Element(E.Φ - np.outer(K, e / s), S, compressed(np.vstack([E.Z, e[None] / s]).T).T)


def _diffuse_channel(E: Element, e: Real) -> Element:
    """The coordinate e c is known exactly: only those orthogonal to e are left."""
    rest = np.linalg.qr(e[:, None], mode="complete")[0][:, 1:]
    return Element(E.Φ @ rest, E.S, E.Z @ rest)
