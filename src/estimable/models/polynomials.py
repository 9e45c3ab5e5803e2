"""What the polynomial models share: degrees, the vector of parameters, the companion form.

Letters: A_i = 1 + a_i1 z^-1 + .., B_ij = z^-delay (b_ij0 + ..), a (p, na), b (p, m, nb+1).
"""

from collections.abc import Sequence
from typing import Any

import numpy as np


def degrees(a: Any, b: Any) -> tuple[int, int]:
    """na and nb."""
    return a.shape[-1], b.shape[-1] - 1


def joined(*parts: Any) -> np.ndarray:
    """θ: output by output, the entries of each part (p, ..) in turn.

    >>> joined(np.array([[1.0], [2.0]]), np.array([[[3.0, 4.0]], [[5.0, 6.0]]])).tolist()
    [1.0, 3.0, 4.0, 2.0, 5.0, 6.0]
    """
    return np.concatenate([np.reshape(part, (len(part), -1)) for part in parts], axis=1).ravel()


def parted(θ: Any, like: Sequence[Any]) -> list[np.ndarray]:
    """The parts of θ, shaped as those in `like`: `joined` undone."""
    rows = np.asarray(θ, float).reshape(len(like[0]), -1)
    ends = np.cumsum([0, *(np.size(part) // len(part) for part in like)])
    return [rows[:, i:j].reshape(np.shape(part)) for part, i, j in zip(like, ends[:-1], ends[1:], strict=True)]


def companion(a: Any, b: Any, delay: int, states: int = 1) -> tuple[np.ndarray, ...]:
    """A, B, C, D of B_ij/A_i: one observable companion form an output, each with at least `states` states.

    >>> companion(np.array([[0.5]]), np.array([[[1.0, 2.0]]]), 0)[1].tolist()
    [[1.5]]
    """
    (na, nb), (p, m) = degrees(a, b), b.shape[:2]
    n = max(na, nb + delay, states)
    A, B, C, D = np.zeros((p * n, p * n)), np.zeros((p * n, m)), np.zeros((p, p * n)), np.zeros((p, m))
    for i in range(p):
        rows = slice(i * n, (i + 1) * n)
        a_i = np.pad(a[i], (0, n - na))
        b_i = np.pad(b[i], ((0, 0), (delay, n - nb - delay)))  # (m, n + 1)
        A[rows, rows] = np.column_stack([-a_i, np.eye(n)[:, : n - 1]])
        D[i] = b_i[:, 0]
        B[rows] = (b_i[:, 1:] - np.outer(b_i[:, 0], a_i)).T
        C[i, i * n] = 1.0
    return A, B, C, D
