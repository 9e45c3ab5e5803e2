"""The common part of the polynomial models: degrees, the vector of parameters, the companion form.

Letters: A_i = 1 + a_i1 z^-1 + .., B_ij = z^-delay (b_ij0 + ..), a (p, na), b (p, m, nb+1).
"""

from collections.abc import Sequence
from typing import Any, Self

import numpy as np

from ..annotations import Numbers
from ..frozen import replace


class Polynomials:
    """A model in polynomial form with `a` and `b`; θ consists of the fields in `PARTS` that are not None."""

    PARTS: tuple[str, ...] = ("a", "b")
    a: Any
    b: Any

    @property
    def na(self) -> int:
        """Degree of A."""
        return degrees(self.a, self.b)[0]

    @property
    def nb(self) -> int:
        """Degree of B without its delay."""
        return degrees(self.a, self.b)[1]

    @property
    def _parts(self) -> dict[str, Any]:
        parts = {name: getattr(self, name) for name in self.PARTS}
        return {name: part for name, part in parts.items() if part is not None}

    @property
    def parameters(self) -> np.ndarray:
        """θ: output by output the entries of `PARTS`, those of b input by input."""
        return joined(*self._parts.values())

    def with_parameters(self, parameters: Numbers) -> Self:
        """The same model with another θ."""
        parts = self._parts
        return replace(self, **dict(zip(parts, parted(parameters, list(parts.values())), strict=True)))


def degrees(a: np.ndarray, b: np.ndarray) -> tuple[int, int]:
    """na and nb."""
    return a.shape[-1], b.shape[-1] - 1


def joined(*parts: np.ndarray) -> np.ndarray:
    """θ: output by output, the entries of each part (p, ..) in turn.

    >>> joined(np.array([[1.0], [2.0]]), np.array([[[3.0, 4.0]], [[5.0, 6.0]]])).tolist()
    [1.0, 3.0, 4.0, 2.0, 5.0, 6.0]
    """
    return np.concatenate([np.reshape(part, (len(part), -1)) for part in parts], axis=1).ravel()


def parted(θ: Numbers, like: Sequence[np.ndarray]) -> list[np.ndarray]:
    """The parts of θ, shaped as those in `like`: the inverse of `joined`."""
    rows = np.asarray(θ, float).reshape(len(like[0]), -1)
    ends = np.cumsum([0, *(np.size(part) // len(part) for part in like)])
    return [rows[:, i:j].reshape(np.shape(part)) for part, i, j in zip(like, ends[:-1], ends[1:], strict=True)]


def companion(a: np.ndarray, b: np.ndarray, delay: int, states: int = 1) -> tuple[np.ndarray, ...]:
    """A, B, C, D of B_ij/A_i: one observable companion form for each output, each with at least `states` states.

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
