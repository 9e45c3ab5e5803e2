"""Subspace identification: N4SID, MOESP and CVA, from one factorisation. NumPy, outside jit.

Letters: block rows U_f, Y_f of s future and W_p = [U_p; Y_p] of s past samples, N columns; [U_f; W_p; Y_f] = L Q', and every
step works on L alone. O = Γ X is the part of Y_f that the past determines: Γ = [C; CA; ..], X the states.

References: P. Van Overschee, B. De Moor, Subspace Identification (1996), Figs 4.6-4.8, Table 4.1 (weights); M. Verhaegen, P.
Dewilde, Int. J. Control 56 (1992) 1187 (A, C by shift; B, D by regression on the outputs).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

WEIGHTINGS = ("n4sid", "moesp", "cva")
CHUNK = 1000  # rows folded into the factor at a time
EXACT = 1e-9  # of the largest: the least variation assumed for the outputs in a direction


class Factor(NamedTuple):
    """L (k, k) of [U_f; W_p; Y_f], its sizes, and the number of columns N."""

    L: np.ndarray
    s: int
    m: int
    p: int
    N: int


class NoisyDynamics(NamedTuple):
    """A (n, n), C (p, n), the singular values, and the joint covariance (n + p, n + p) of the noises w and v."""

    A: np.ndarray
    C: np.ndarray
    singular_values: np.ndarray
    noise: np.ndarray


def factor(data: Sequence[tuple[np.ndarray, np.ndarray]], s: int) -> Factor:
    """L of several experiments (u, y), (T, m) and (T, p) each."""
    (m, p), R, total = (data[0][0].shape[1], data[0][1].shape[1]), np.zeros((0, 0)), 0
    for u, y in data:
        N, total = len(u) - 2 * s + 1, total + max(len(u) - 2 * s + 1, 0)
        for first in range(0, N, CHUNK):
            rows = min(CHUNK, N - first)
            U, Y = (np.concatenate([x[first + i : first + i + rows] for i in range(2 * s)], axis=1) for x in (u, y))
            H = np.concatenate([U[:, s * m :], U[:, : s * m], Y], axis=1)
            R = np.asarray(np.linalg.qr(np.concatenate([R, H]) if len(R) else H, mode="r"))
    return Factor(R.T, s, m, p, total)


class Shift(NamedTuple):
    """A (n, n), C (p, n), Γ (s p, n), the singular values, and O in the columns of L."""

    A: np.ndarray
    C: np.ndarray
    Γ: np.ndarray
    singular_values: np.ndarray
    oblique: np.ndarray


def shift(found: Factor, n: int, weighting: str) -> Shift:
    """A and C of a model with n states. In O, A maps Γ without its last block to Γ without its first."""
    L, s, m, p, _ = found
    f, k = s * m, s * (2 * m + p)
    U_f, W_p, Y_f = L[:f], L[f:k], L[k:]
    oblique = _oblique(Y_f, U_f, W_p)  # O
    without_u = Y_f[:, f:k] if weighting != "n4sid" else oblique
    W = np.eye(len(Y_f))
    if weighting == "cva":  # W1^-1, a root of Y_f Π Y_f'; directions without noise get a little
        axes, size, _ = np.linalg.svd(Y_f[:, f:])
        W = axes * np.maximum(size, EXACT * size[0])
    left, values, _ = np.linalg.svd(np.linalg.solve(W, without_u), full_matrices=False)
    Γ = (W @ left[:, :n]) * np.sqrt(values[:n])
    return Shift(np.linalg.lstsq(Γ[:-p], Γ[p:], rcond=None)[0], Γ[:p], Γ, values, oblique)


def dynamics(found: Factor, n: int, weighting: str) -> NoisyDynamics:
    """A, C and the noise of a model with n states."""
    L, s, m, p, N = found
    f, k = s * m, s * (2 * m + p)
    U_f, W_p, Y_f = L[:f], L[f:k], L[k:]
    A, C, Γ, values, oblique = shift(found, n, weighting)
    later = _oblique(Y_f[p:], U_f[m:], np.concatenate([W_p, U_f[:m], Y_f[:p]]))
    X, X_next = (np.linalg.lstsq(G, states, rcond=None)[0] for G, states in ((Γ, oblique), (Γ[:-p], later)))
    now = np.concatenate([X_next - A @ X, Y_f[:p] - C @ X])
    e = now - np.linalg.lstsq(U_f.T, now.T, rcond=None)[0].T @ U_f
    return NoisyDynamics(A, C, values, e @ e.T / N)


def _oblique(Y: np.ndarray, U: np.ndarray, W: np.ndarray) -> np.ndarray:
    """The oblique projection of Y on W along U."""
    both = np.concatenate([U, W])
    return np.linalg.lstsq(both.T, Y.T, rcond=1e-12)[0].T[:, len(U) :] @ W


def inputs_of(
    A: np.ndarray, C: np.ndarray, data: Sequence[tuple[np.ndarray, np.ndarray]], feedthrough: bool
) -> tuple[np.ndarray, np.ndarray]:
    """B (n, m) and D (p, m) with which the simulation is nearest to the outputs, each record from its own initial state.

    y = Γ x0 + Σ_ij b_ij (response of state i to input j) + D u is linear in them. NaN in y: not seen.
    """
    n, p, m = len(A), len(C), data[0][0].shape[1]
    θ = _least_norm(*regressors(A, C, data, feedthrough))
    D = θ[n * m : n * m + p * m].reshape(p, m) if feedthrough else np.zeros((p, m))
    return θ[: n * m].reshape(n, m), D


def regressors(
    A: np.ndarray, C: np.ndarray, data: Sequence[tuple[np.ndarray, np.ndarray]], feedthrough: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Φ (N, d) and y (N,) of the seen outputs, y = Φ (B, D, x0 of each record)."""
    n, p, m = len(A), len(C), data[0][0].shape[1]
    rows, right = [], []
    for k, (u, y) in enumerate(data):
        states = _responses(A, u)  # (T, n, n m + n): the states due to each entry of B and x0
        Φ = np.einsum("pn,tnk->tpk", C, states)
        starts = np.zeros((len(u), p, n * len(data)))
        starts[:, :, n * k : n * (k + 1)] = Φ[:, :, n * m :]
        direct = np.einsum("pq,tm->tpqm", np.eye(p), u).reshape(len(u), p, p * m)
        columns = [Φ[:, :, : n * m], *([direct] if feedthrough else []), starts]
        seen = ~np.isnan(y)
        rows.append(np.concatenate(columns, axis=2)[seen])
        right.append(y[seen])
    return np.concatenate(rows), np.concatenate(right)


def _responses(A: np.ndarray, u: np.ndarray) -> np.ndarray:
    n, (T, m) = len(A), u.shape
    states = np.zeros((T, n, n * m + n))
    X = np.concatenate([np.zeros((n, n * m)), np.eye(n)], axis=1)
    own = np.arange(n)
    for k in range(T):
        states[k] = X
        X = A @ X
        X[:, : n * m].reshape(n, n, m, copy=False)[own, own] += u[k]
    return states


def _least_norm(Φ: np.ndarray, y: np.ndarray) -> np.ndarray:
    Q, R = np.linalg.qr(Φ)
    return np.linalg.lstsq(R, Q.T @ y, rcond=1e-12)[0]
