"""A filter with a given gain, its estimate written out on every noise of the record: covariances without their recursion."""

import numpy as np

from .dense import joint
from .textbook import matrices


def run(model, prior, y, u, K):
    """Means (T, n) and the covariances (T, n, n) of their errors."""
    T, n = len(y), model.n
    mx, X, my, Y, noises = joint(model, prior, u, T)
    x, row = np.array(prior.mean, float), np.zeros_like(X[0])  # the estimate: its value, and on (x0 - mean, noises)
    means, covariances = [], []
    for k in range(T):
        A, B, C, D, *_ = matrices(model, k)
        for j in np.flatnonzero(~np.isnan(y[k])):  # each against the estimate before the sample
            before, row_before = (x, row) if j == np.flatnonzero(~np.isnan(y[k]))[0] else (before, row_before)
            x = x + K[:, j] * (y[k, j] - C[j] @ before - D[j] @ u[k])
            row = row + np.outer(K[:, j], Y[k][j] - C[j] @ row_before)
        means.append(x)
        covariances.append((X[k] - row) @ noises @ (X[k] - row).T)
        x, row = A @ x + B @ u[k], A @ row
    assert np.shape(mx) == (T, n)
    assert np.shape(my) == (T, model.p)
    return np.array(means), np.array(covariances)
