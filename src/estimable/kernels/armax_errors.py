"""The prediction errors of one output of an ARMAX model, and their derivatives. NumPy, one call a record.

Letters: C ε = A y - B u - z, z (n,) impulses that represent the past before row 0; θ = (a, b, c).
Reference: L. Ljung (1999) (7.14), §10.3.
"""

import numpy as np

from .output_error_response import delayed, over


def errors(a: np.ndarray, b: np.ndarray, c: np.ndarray, delay: int, u: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """ε (T,) of y (T,) without missing samples."""
    w = y.copy()
    for i, a_i in enumerate(a):
        w += a_i * delayed(y, i + 1)
    for j, lag in np.ndindex(b.shape):
        w -= b[j, lag] * delayed(u[:, j], delay + lag)
    w[: len(z)] -= z[: len(w)]
    return over(c, w)


def slopes(
    c: np.ndarray, orders: tuple[int, int, int], delay: int, u: np.ndarray, y: np.ndarray, ε: np.ndarray, past: int
) -> np.ndarray:
    """dε/dθ and dε/dz (T, d + past): z^-i y / C, - z^-(delay+l) u / C, - z^-i ε / C, - z^-i / C."""
    na, nb, nc = orders
    y_filtered, ε_filtered, impulse, *u_filtered = over(c, np.column_stack([y, ε, np.eye(len(y), 1), u])).T
    columns = [delayed(y_filtered, i + 1) for i in range(na)]
    for u_j in u_filtered:
        columns += [-delayed(u_j, delay + lag) for lag in range(nb + 1)]
    columns += [-delayed(ε_filtered, i + 1) for i in range(nc)]
    columns += [-delayed(impulse, i) for i in range(past)]
    return np.stack(columns, axis=1)
