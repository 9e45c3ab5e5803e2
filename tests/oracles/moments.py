"""Moments of functions of a Gaussian by brute force, and textbook nonlinear filters that use nothing of the library."""

import itertools

import numpy as np
from scipy.integrate import solve_ivp


def quadrature(g, mean, P, points=7):
    """Mean of g, its covariance, and its covariance with x, by Gauss-Hermite quadrature: exact for low polynomials."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(points)
    L, n = np.linalg.cholesky(P), len(mean)
    grid = np.array(list(itertools.product(nodes, repeat=n)))
    w = np.prod(list(itertools.product(weights / weights.sum(), repeat=n)), axis=1)
    x = mean + grid @ L.T
    y = np.array([g(xi) for xi in x])
    m = w @ y
    return m, (w[:, None] * (y - m)).T @ (y - m), (w[:, None] * (x - mean)).T @ (y - m)


def moment_filter(f, h, Q, R, mean, P, ys, moments):
    """The Gaussian filter whose expectations `moments(g, m, P)` gives; channels that are NaN are deleted."""
    means, covariances, likelihood = [], [], 0.0
    for y in ys:
        seen = ~np.isnan(y)
        if seen.any():
            m, S, C = moments(h, mean, P)
            m, S, C = m[seen], S[np.ix_(seen, seen)] + R[np.ix_(seen, seen)], C[:, seen]
            e, K = y[seen] - m, C @ np.linalg.inv(S)
            likelihood -= (e @ np.linalg.solve(S, e) + np.linalg.slogdet(2 * np.pi * S)[1]) / 2
            mean, P = mean + K @ e, P - K @ S @ K.T
        means.append(mean)
        covariances.append(P)
        mean, P, _ = moments(f, mean, P)
        P = P + Q
    return np.array(means), np.array(covariances), likelihood


def unscented(κ):
    """The unscented moments as Julier and Uhlmann print them: points, weights, sums."""

    def moments(g, mean, P):
        n = len(mean)
        L = np.linalg.cholesky((n + κ) * P)
        points = np.concatenate([[mean], mean + L.T, mean - L.T])
        w = np.r_[κ / (n + κ), np.full(2 * n, 1 / (2 * (n + κ)))]
        y = np.array([g(x) for x in points])
        m = w @ y
        return m, (w[:, None] * (y - m)).T @ (y - m), (w[:, None] * (points - mean)).T @ (y - m)

    return moments


def second_order_flow(f, F, hessians, noise, mean, P, dt):
    """Jazwinski (9.41)-(9.42) by an ODE solver of SciPy: ṁ = f + ½ f'':P, Ṗ = F P + P F' + noise."""
    n = len(mean)

    def derivative(t, z):
        m, P = z[:n], z[n:].reshape(n, n)
        drift = f(m) + np.einsum("ijk,jk->i", hessians(m), P) / 2
        return np.r_[drift, (F(m) @ P + P @ F(m).T + noise).ravel()]

    end = solve_ivp(derivative, (0, dt), np.r_[mean, P.ravel()], rtol=1e-11, atol=1e-13).y[:, -1]
    return end[:n], end[n:].reshape(n, n)
