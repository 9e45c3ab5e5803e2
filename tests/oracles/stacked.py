"""The state and all outputs as one linear map of independent variables: their covariances without any recursion."""

import numpy as np


def covariances(model, start, steps):
    """cov x[K]; cov(x[K], Y) and cov Y with Y = (y[0], .., y[K]); the last p entries are the present output."""
    n, p, q = model.n, model.p, model.G.shape[-1]

    def at(name, k):
        M = getattr(model, name)
        return M if M is None or M.ndim == 2 else M[min(k, len(M) - 1)]

    size = n + (steps + 1) * (q + p)
    x = np.zeros((n, size))
    x[:, :n] = np.eye(n)
    joint = np.zeros((size, size))
    joint[:n, :n] = start
    rows = []
    for k in range(steps + 1):
        w = slice(n + k * (q + p), n + k * (q + p) + q)
        v = slice(w.stop, w.stop + p)
        joint[w, w], joint[v, v] = at("Q", k), at("R", k)
        if model.S is not None:
            joint[w, v], joint[v, w] = at("S", k), at("S", k).T
        y = at("C", k) @ x
        y[:, v] += np.eye(p)
        rows.append(y)
        if k < steps:
            x = at("A", k) @ x
            x[:, w] += at("G", k)
    Y = np.vstack(rows)
    return x @ joint @ x.T, x @ joint @ Y.T, Y @ joint @ Y.T


def explained(cross, outputs):
    """The part of cov x that outputs with this covariance explain."""
    return cross @ np.linalg.solve(outputs, cross.T)
