"""A basis of directions with few nonzero entries, easy to read. NumPy, outside jit."""

import numpy as np


def echelon(Z: np.ndarray) -> np.ndarray:
    """A basis (n, k) of the span of Z's columns with few nonzero entries, found by pivoting; unit norms.

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
    """The signs that make the first of the largest entries of each column positive."""
    first = (np.abs(G) > (1 - 1e-6) * np.abs(G).max(axis=0)).argmax(axis=0)
    return np.sign(G[first, np.arange(G.shape[1])])
