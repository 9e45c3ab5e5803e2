"""Directions of the state, as numbers and as a reader sees them."""

import numpy as np

from .. import checks

SHOWN = 0.005  # entries below this part of the largest are not written
TERMS = 6  # written at most


def echelon(Z: np.ndarray) -> np.ndarray:
    """A basis (n, k) of the span of Z's columns in which each vector has as few entries as pivoting gives; unit norms.

    >>> echelon(np.array([[1.0, 1.0], [1.0, -1.0], [0.0, 0.0]])).round(12).tolist()
    [[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]]
    """
    if Z.shape[1] == 0:
        return Z
    from scipy.linalg import qr

    pivots = np.sort(qr(Z.T, mode="r", pivoting=True)[-1][: Z.shape[1]])
    basis = np.linalg.solve(Z[pivots].T, Z.T).T
    basis = basis / np.linalg.norm(basis, axis=0)
    basis = np.where(np.abs(basis) < 1e-9, 0.0, basis)
    return basis * leading_sign(basis)


def leading_sign(G: np.ndarray) -> np.ndarray:
    """The signs with which the first of each column's largest entries is positive."""
    first = (np.abs(G) > (1 - 1e-6) * np.abs(G).max(axis=0)).argmax(axis=0)
    return np.sign(G[first, np.arange(G.shape[1])])


def words(direction: np.ndarray, names: tuple[str, ...]) -> str:
    """A direction in the names of the states.

    >>> words(np.array([0.894, -0.447, 0.0]), ("alpha", "q", "h")), words(np.array([0.0, 1.0]), ("alpha", "q"))
    ('0.89 alpha - 0.45 q', 'q')
    """
    largest = np.abs(direction).max()
    entries = [i for i in np.argsort(-np.abs(direction), kind="stable") if abs(direction[i]) > SHOWN * largest]
    if len(entries) == 1:
        return names[entries[0]]
    shown = sorted(entries[:TERMS])
    text = "".join(
        f"{' - ' if direction[i] < 0 else ' + '}{abs(direction[i]):.2g} {names[i]}" for i in shown
    ).removeprefix(" + ")
    text = f"-{text[3:]}" if text.startswith(" - ") else text
    return text + (f" + .. ({checks.counted(len(entries) - TERMS, 'more term')})" if len(entries) > TERMS else "")
