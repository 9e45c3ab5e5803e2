"""Unknown inputs as one least-squares problem over the whole record: no recursion in time of any filter."""

import numpy as np

from .dense import joint
from .textbook import matrices


def maps(model, unknown, T):
    """What the unknown inputs d[0..T-1] (T d,) add to x[0..T-1] (T, n, T d) and to y (T, p, T d)."""
    d = len(unknown)
    X, Y, row = np.zeros((T, model.n, T * d)), np.zeros((T, model.p, T * d)), np.zeros((model.n, T * d))
    for k in range(T):
        A, B, C, D, *_ = matrices(model, k)
        at = slice(k * d, (k + 1) * d)
        X[k], Y[k] = row, C @ row
        Y[k][:, at] += D[:, unknown]
        row = A @ row
        row[:, at] += B[:, unknown]
    return X, np.where(np.abs(Y) < 1e-12, 0.0, Y)  # what cancels is zero


def least_squares(model, unknown, prior, y, u, k, j=None, *, state=None):
    """x[k] (or x[state]), or d[j], given y[0..k], with a flat prior on every d: mean, covariance, what stays open of it."""
    T, d = k + 1, len(unknown)
    u = np.array(u[:T], float)
    u[:, unknown] = 0.0
    mx, X, my, Y, cov = joint(model, prior, u, T)
    Hx, Hy = maps(model, unknown, T)
    seen = ~np.isnan(y[:T].ravel())
    Yf, e = Y.reshape(T * model.p, -1)[seen], (y[:T].ravel() - my.ravel())[seen]
    L = np.linalg.cholesky(Yf @ cov @ Yf.T) if seen.any() else np.zeros((0, 0))
    E, z = np.linalg.solve(L, Hy.reshape(T * model.p, -1)[seen]), np.linalg.solve(L, e)
    U, s, V = np.linalg.svd(E)
    rank = int(np.sum(s > 1e-10 * s.max(initial=0.0)))
    told, N = V[:rank].T / s[:rank], V[rank:].T
    if j is None:
        i = k if state is None else state
        mean, spread, M = mx[i], X[i] @ cov @ X[i].T, Hx[i]
        cross = np.linalg.solve(L, Yf @ cov @ X[i].T).T
    else:
        mean, spread, M, cross = (
            np.zeros(d),
            np.zeros((d, d)),
            np.eye(T * d)[j * d : (j + 1) * d],
            np.zeros((d, len(z))),
        )
    M = M - cross @ E
    mean = mean + cross @ z + M @ told @ (U[:, :rank].T @ z)
    return mean, spread - cross @ cross.T + (M @ told) @ (M @ told).T, M @ N
