"""What a discrete state-space model says of outputs: its response, and its predictions one step ahead. NumPy, one record.

Letters: x+ = A x + B u + w, y = C x + D u + v, cov(w, v) = [[Q, S], [S', R]]; Q, S with the G of the model in them.
"""

from typing import NamedTuple

import numpy as np

FAR = 1e100  # where a response that grows without bound is cut off
SETTLED = 1e-14  # relative change of P from which it counts as constant


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
    outputs = []
    for row in u:
        outputs.append(C @ x + D @ row)
        x = np.clip(A @ x + B @ row, -FAR, FAR)
    return np.stack(outputs), x


def initial_state(system: System, u: np.ndarray, y: np.ndarray) -> np.ndarray:
    """x[0] (n,) from which the response is nearest to the outputs y (T, p) seen (NaN: not seen)."""
    n, m = system.B.shape
    zero, _ = response(system, u, np.zeros(n))
    free, _ = response(system, np.zeros((len(u), m, n)), np.eye(n))
    seen = ~np.isnan(y)
    return np.linalg.lstsq(np.clip(free[seen], -FAR, FAR), (y - zero)[seen], rcond=1e-10)[0]


def predictions(system: System, u: np.ndarray, y: np.ndarray, x: np.ndarray, P: np.ndarray) -> tuple:
    """Outputs predicted from those before (T, p), the covariances of their errors (T, p, p), and (x, P) after the last row."""
    A, B, C, D = system[:4]
    predicted, covariances, known = [], [], ~np.isnan(y)
    step, seen, settled = _step(system, P, known[0]), known[0], False
    for row, datum, seen_now in zip(u, y, known, strict=True):
        if not settled or np.any(seen_now != seen):
            seen, step = seen_now, _step(system, P, seen_now)
            settled = bool(np.all(np.abs(step.P - P) <= SETTLED * np.abs(P).max(initial=0.0)))
        ŷ = C @ x + D @ row
        predicted.append(ŷ)
        covariances.append(step.V)
        x, P = np.clip(A @ x + B @ row + step.K @ (datum - ŷ)[seen], -FAR, FAR), step.P
    return np.stack(predicted), np.stack(covariances), (x, P)


class Step(NamedTuple):
    """Covariance V of the predicted outputs, the gain K of those seen, and P for the next row."""

    V: np.ndarray
    K: np.ndarray
    P: np.ndarray


def _step(system: System, P: np.ndarray, seen: np.ndarray) -> Step:
    A, _, C, _, Q, R, S = system
    V = C @ P @ C.T + R
    M = (A @ P @ C.T + S)[:, seen]
    K = np.linalg.lstsq(V[np.ix_(seen, seen)], M.T, rcond=1e-12)[0].T
    P = A @ P @ A.T + Q - K @ M.T
    return Step(V, K, (P + P.T) / 2)
