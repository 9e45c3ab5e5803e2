"""The part of the state that outputs never show and that does not die out. NumPy, outside jit.

Letters: Q1 spans the modes that do not decay, A Q1 = Q1 A11. U spans the directions of Q1 that (A11, C Q1) hides: A U lies in U
and C U = 0. In the frame [N, U], N orthogonal to U, the other states move alone, and zeros that are exact stay exact when steps
are composed. In any other frame the rounding in C is a measurement of U, which a long horizon believes.

Reference: P. Van Dooren, IEEE TAC 26 (1981) 111, §III (staircase).
"""

import numpy as np

from .growth_frame import growth_frame, growths
from .reach import complement
from .shapes import Float

Real = np.ndarray
LASTING = 1e-7    # 1 - |λ| below which a mode counts as lasting
HIDDEN = 1e-10    # of the norm of a row of C, or of A11, below which a coupling is rounding


def undetectable(A: Float[Real, "n n"], C: Float[Real, "p n"], *, continuous: bool) -> Float[Real, "n u"]:
    """U, orthonormal.

    >>> undetectable(np.diag([1.0, 0.5, 1.0]), np.array([[1.0, 0.0, 0.0]]), continuous=False).round(12).T.tolist()
    [[0.0, 0.0, 1.0]]
    """
    Q1, A11 = _lasting(A, continuous)
    rows = np.linalg.norm(C, axis=1)
    shown = np.zeros((len(A11), 0))
    new, least = (C[rows > 0] / rows[rows > 0, None] @ Q1).T, HIDDEN
    while new.shape[1] and shown.shape[1] < len(A11):
        for _ in range(2):
            new = new - shown @ (shown.T @ new)
        U, σ, _ = np.linalg.svd(new, full_matrices=False)
        added = U[:, σ > least]
        shown = np.hstack([shown, added])
        new, least = A11.T @ added, HIDDEN * np.linalg.norm(A11)
    found = Q1 @ complement(shown) if len(A11) else Q1
    return found * np.sign(found[np.abs(found).argmax(axis=0), np.arange(found.shape[1])])


def _lasting(A: Real, continuous: bool) -> tuple[Real, Real]:
    Q, T = growth_frame(A, continuous=continuous)
    sizes = growths(T, continuous=continuous)
    edge = -1e-9 * np.abs(np.linalg.eigvals(A)).max(initial=0.0) if continuous else 1 - LASTING
    k = next((i for i, size in sizes.items() if size < edge), len(A))
    return Q[:, :k], T[:k, :k]


def split(A: Float[Real, "n n"], U: Float[Real, "n u"]) -> Float[Real, "n n"]:
    """The orthogonal frame [N, U]; entries of U that are rounding are zero, so that states without a part in U stay apart."""
    U = np.where(np.abs(U) < 1e-14, 0.0, U)
    if np.count_nonzero(U) == U.shape[1]:                                    # states themselves: no rotation
        order = [i for i in range(len(A)) if not U[i].any()] + [int(i) for i in np.abs(U).argmax(axis=0)]
        return np.eye(len(A))[:, order]
    return np.hstack([complement(U), U])
