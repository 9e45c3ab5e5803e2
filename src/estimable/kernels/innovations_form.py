"""The response of a discrete state-space model, and its predictions one step ahead. NumPy, one record.

Letters: x+ = A x + B u + w, y = C x + D u + v, cov(w, v) = [[Q, S], [S', R]]; Q and S include the G of the model.
"""

from typing import NamedTuple

import numpy as np

BLOCK = 32  # rows of a stable system at a time
FAR = 1e100  # an unbounded response is cut off here
SETTLED = 1e-14  # change of P, relative to the initial P and Q, below which it counts as constant


class System(NamedTuple):
    """The matrices of a discrete model."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    Q: np.ndarray
    R: np.ndarray
    S: np.ndarray


def response(system: System, u: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Outputs (T, p, ..) from the state x (n, ..), driven by u (T, m, ..), and the state after the last row."""
    A, B, C, D = system[:4]
    outputs, blocks = [], len(u) // BLOCK if np.abs(np.linalg.eigvals(A)).max(initial=0.0) <= 1 else 0
    if blocks:
        first, x = _in_blocks(system, u[: blocks * BLOCK], x)
        outputs.append(first)
    rows = []
    for row in u[blocks * BLOCK :]:
        rows.append(C @ x + D @ row)
        x = np.clip(A @ x + B @ row, -FAR, FAR)
    outputs += [np.stack(rows)] if rows else []
    return np.concatenate(outputs), x


def _in_blocks(system: System, u: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`response` of `BLOCK` rows at a time, y = Γ x + H u and x+ = A^L x + Δ u: the same numbers, to rounding."""
    A, B, C, D = system[:4]
    (n, m), p = B.shape, len(C)
    powers = [np.eye(n)]
    for _ in range(BLOCK):
        powers.append(A @ powers[-1])
    Γ = np.concatenate([C @ power for power in powers[:BLOCK]])
    Δ = np.concatenate([power @ B for power in powers[BLOCK - 1 :: -1]], axis=1)
    M = np.concatenate([D[None], (Γ @ B).reshape(BLOCK, p, m)[:-1]])
    lag = np.arange(BLOCK)[:, None] - np.arange(BLOCK)
    H = np.where((lag >= 0)[:, :, None, None], M[np.maximum(lag, 0)], 0.0).transpose(0, 2, 1, 3).reshape(BLOCK * p, BLOCK * m)
    rest, outputs = u.shape[2:], []
    for block in u.reshape(len(u) // BLOCK, BLOCK * m, *rest):
        outputs.append(Γ @ x + H @ block)
        x = powers[BLOCK] @ x + Δ @ block
    return np.concatenate(outputs).reshape(len(u), p, *rest), x


def initial_state(system: System, u: np.ndarray, y: np.ndarray) -> np.ndarray:
    """x[0] (n,) from which the response is nearest to the outputs y (T, p) seen (NaN: not seen)."""
    n, m = system.B.shape
    zero, _ = response(system, u, np.zeros(n))
    free, _ = response(system, np.zeros((len(u), m, n)), np.eye(n))
    seen = ~np.isnan(y)
    return np.linalg.lstsq(np.clip(free[seen], -FAR, FAR), (y - zero)[seen], rcond=1e-10)[0]


def predictions(system: System, u: np.ndarray, y: np.ndarray, x: np.ndarray, P: np.ndarray) -> tuple:
    """Outputs predicted from earlier ones (T, p), the covariances of their errors (T, p, p), and (x, P) after the last row."""
    A, B, C, D = system[:4]
    predicted, covariances, known = [], [], ~np.isnan(y)
    size = max(np.abs(P).max(initial=0.0), np.abs(system.Q).max(initial=0.0))
    step, seen, settled = _step(system, P, known[0]), known[0], False
    whole = range(len(y) - int(np.argmin(np.append(np.all(known, axis=1)[::-1], False))), len(y))  # from here nothing is missing
    for k, (row, datum, seen_now) in enumerate(zip(u, y, known, strict=True)):
        if settled and seen.all() and k in whole:
            later, x = _steadily(system, step.K, u[k:], y[k:], x)
            return (*_joined(predicted, covariances, later, step.V), (x, step.P))
        if not settled or np.any(seen_now != seen):
            seen, step = seen_now, _step(system, P, seen_now)
            settled = bool(np.all(np.abs(step.P - P) <= SETTLED * size))
        ŷ = C @ x + D @ row
        predicted.append(ŷ)
        covariances.append(step.V)
        x, P = np.clip(A @ x + B @ row + step.K @ (datum - ŷ)[seen], -FAR, FAR), step.P
    return np.stack(predicted), np.stack(covariances), (x, P)


def _steadily(system: System, K: np.ndarray, u: np.ndarray, y: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Predictions with a constant gain: x+ = (A - K C) x + (B - K D) u + K y."""
    A, B, C, D = system[:4]
    none = np.zeros((len(C), len(C)))
    filtered = system._replace(A=A - K @ C, B=np.hstack([B - K @ D, K]), D=np.hstack([D, none]))
    return response(filtered, np.concatenate([u, y], axis=1), x)


def _joined(predicted: list, covariances: list, later: np.ndarray, V: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All predictions and their covariances; the later covariances are all V."""
    first = np.reshape(predicted, (-1, later.shape[1]))
    spread = np.concatenate([np.reshape(covariances, (-1, *V.shape)), np.broadcast_to(V, (len(later), *V.shape))])
    return np.concatenate([first, later]), spread


class RiccatiStep(NamedTuple):
    """Covariance V of the predicted outputs, the gain K of the seen outputs, and P for the next row."""

    V: np.ndarray
    K: np.ndarray
    P: np.ndarray


def _step(system: System, P: np.ndarray, seen: np.ndarray) -> RiccatiStep:
    A, _, C, _, Q, R, S = system
    V = C @ P @ C.T + R
    M = (A @ P @ C.T + S)[:, seen]
    K = np.linalg.lstsq(V[np.ix_(seen, seen)], M.T, rcond=1e-12)[0].T
    P = A @ P @ A.T + Q - K @ M.T
    return RiccatiStep(V, K, (P + P.T) / 2)
