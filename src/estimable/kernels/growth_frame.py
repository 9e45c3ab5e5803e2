"""The real Schur form of A by falling growth. NumPy and LAPACK, outside jit."""

from typing import Any

import numpy as np

from .shapes import Float

Real = np.ndarray


def growth_frame(A: Float[Real, "n n"], *, continuous: bool = False) -> tuple[Real, Real]:
    """Orthogonal Q and T = Q'AQ, real Schur by falling |λ| (real part where continuous), exactly zero below its blocks.

    LAPACK's trexc moves one block at a time, the largest first.
    """
    import scipy.linalg

    lapack: Any = scipy.linalg.lapack

    T, Q = scipy.linalg.schur(A, output="real")[:2]
    left, done = list(growths(T, continuous=continuous).items()), 0
    while done < len(A):
        starts = [i for i, _ in left]
        widths = np.diff([*starts, len(A)])
        largest = max(range(len(left)), key=lambda i: left[i][1])
        T, Q, _ = lapack.dtrexc(T, Q, starts[largest] + 1, done + 1)
        width = int(widths[largest])
        done += width
        if width == 2 and T[done - 1, done - 2] == 0:                        # a pair that has split
            done -= 2
            left = [(i, size) for i, size in growths(T, continuous=continuous).items() if i >= done]
            continue
        left = [(i + width if i < starts[largest] else i, size) for i, size in left if i != starts[largest]]
    return Q, T


def growths(T: Float[Real, "n n"], *, continuous: bool) -> dict[int, float]:
    """|λ| (the real part where continuous) of each diagonal block, by its first row."""
    return {i: _size(T, i, continuous) for i in range(len(T)) if i == 0 or T[i, i - 1] == 0}


def _size(T: Real, i: int, continuous: bool) -> float:
    pair = i + 1 < len(T) and T[i + 1, i] != 0
    block = T[i : i + 2, i : i + 2] if pair else T[i : i + 1, i : i + 1]
    λ = np.linalg.eigvals(block)
    return float(λ.real.max() if continuous else np.abs(λ).max())
