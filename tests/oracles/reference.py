"""Posterior means and covariances with no Gaussian assumption: importance sampling over x[0], and a grid of two states."""

import numpy as np
from scipy.stats import norm, qmc


def by_importance(paths, output, R, mean, covariance, y, *, points=4096, rounds=5, seed=0):
    """Mean, covariance at the last row and effective sample size, of a system without process noise.

    `paths`: x[0] (N, n) -> (T, N, n); `output`: (T, N, n) -> (T, N). Quasi-random points of a Gaussian proposal about x[0], which
    is fitted to the weighted points and drawn again, `rounds` times, with a tempered likelihood while few points count.
    """
    n, S = len(mean), np.linalg.cholesky(covariance)
    ξ = norm.ppf(np.clip(qmc.Sobol(n, seed=seed).random(points), 1e-12, 1 - 1e-12))
    centre, L, wider = np.zeros(n), np.eye(n), 1.0
    for _ in range(rounds):
        z = centre + wider * ξ @ L.T
        x = np.asarray(paths(mean + z @ S.T))
        fit = -0.5 * np.sum((y[:, None] - np.asarray(output(x))) ** 2, axis=0) / R
        logs = fit - 0.5 * np.sum(z**2, axis=1) + 0.5 * np.sum(ξ**2, axis=1)
        w, used = weights(logs), weights(logs)
        share = 1.0
        while 1 / np.sum(used**2) < points / 20:
            share *= 0.7
            used = weights(share * logs)
        centre = used @ z
        d, wider = z - centre, 1.3
        L = np.linalg.cholesky((d * used[:, None]).T @ d + 1e-12 * np.eye(n))
    m = w @ x[-1]
    e = x[-1] - m
    return m, (e * w[:, None]).T @ e, 1 / np.sum(w**2)


def weights(logs):
    """Proportional to exp(logs), with sum 1."""
    w = np.exp(logs - logs.max())
    return w / w.sum()


def by_grid(move, output, Q, R, mean, covariance, y, edges, *, size=50):
    """Means (runs, T, 2) and covariances of x+ = move(x) + w, y = output(x) + v, on a grid between `edges`: brute force.

    `move` and `output` take (2, N); `y` (runs, T). Every cell goes to every cell with the density of w (Q diagonal).
    """
    axes = [np.linspace(*edge, size) for edge in edges]
    x = np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")])
    to = move(x)
    density = [np.exp(-0.5 * np.subtract.outer(x[i], to[i]) ** 2 / Q[i, i]) for i in range(2)]
    transition = density[0] * density[1]
    transition /= np.maximum(transition.sum(axis=0), 1e-300)
    d = np.linalg.solve(np.linalg.cholesky(covariance), x - mean[:, None])
    p, means, covariances = np.exp(-0.5 * np.sum(d**2, axis=0))[:, None], [], []
    for row in y.T:
        p = p * np.exp(-0.5 * (row - output(x)[:, None]) ** 2 / R)
        p = p / p.sum(axis=0)
        m = (x @ p).T
        means.append(m)
        covariances.append(np.einsum("in,jn,nb->bij", x, x, p, optimize=True) - m[:, :, None] * m[:, None, :])
        p = transition @ p
    return np.stack(means, axis=1), np.stack(covariances, axis=1)
