"""The whole record as one Gaussian vector: no recursion in time of any filter."""

import numpy as np

from .textbook import matrices


def joint(model, prior, u, T):
    """Mean and covariance of (x[0..T-1], y[0..T-1]) by stacking every noise, and the map from a diffuse x[0]."""
    n, p = model.n, model.p
    noise_size = T * (n + p)
    X, Y = np.zeros((T, n, n + noise_size)), np.zeros((T, p, n + noise_size))  # on (x0 - mean, noises)
    mx, my = np.zeros((T, n)), np.zeros((T, p))
    x, row = np.array(prior.mean, float), np.hstack([np.eye(n), np.zeros((n, noise_size))])
    cov = np.zeros((n + noise_size, n + noise_size))
    cov[:n, :n] = prior.covariance
    for k in range(T):
        A, B, C, D, Q, R, GS = matrices(model, k)
        at = n + k * (n + p)
        w, v = slice(at, at + n), slice(at + n, at + n + p)
        cov[w, w], cov[v, v], cov[w, v], cov[v, w] = Q, R, GS, GS.T
        mx[k], X[k] = x, row
        my[k], Y[k] = C @ x + D @ u[k], C @ row
        Y[k][:, v] += np.eye(p)
        x, row = A @ x + B @ u[k], A @ row
        row[:, w] += np.eye(n)
    return mx, X, my, Y, cov


def conditioned(model, prior, y, u, k):
    """Mean and covariance of x[k] given y[0..k], and the log-likelihood of all of y."""
    T = len(y)
    mx, X, my, Y, cov = joint(model, prior, u, T)
    Yf, m = Y.reshape(T * model.p, -1), my.ravel()
    seen = ~np.isnan(y.ravel())
    early = seen & (np.arange(T * model.p) < (k + 1) * model.p)
    S = Yf[early] @ cov @ Yf[early].T
    cross = X[k] @ cov @ Yf[early].T
    gain = np.linalg.solve(S, cross.T).T if early.any() else np.zeros((model.n, 0))
    mean = mx[k] + gain @ (y.ravel() - m)[early]
    covariance = X[k] @ cov @ X[k].T - gain @ cross.T
    everything = Yf[seen] @ cov @ Yf[seen].T
    e = (y.ravel() - m)[seen]
    sign, logdet = np.linalg.slogdet(everything) if seen.any() else (1, 0.0)
    assert sign > 0
    total = -0.5 * (len(e) * np.log(2 * np.pi) + logdet + e @ np.linalg.solve(everything, e)) if seen.any() else 0.0
    return mean, covariance, total


def diffuse_conditioned(model, prior, y, u, k):
    """x[k] given y[0..k] where x[0] is diffuse along `prior.diffuse`: generalised least squares with a flat prior.

    Returns mean, covariance, and the directions of x[k] that stay undetermined.
    """
    T = k + 1
    mx, X, my, Y, cov = joint(model, prior, u[:T], T)
    seen = ~np.isnan(y[:T].ravel())
    Yf, e = Y.reshape(T * model.p, -1)[seen], (y[:T].ravel() - my.ravel())[seen]
    H, J = Yf[:, : model.n] @ prior.diffuse, X[k][:, : model.n] @ prior.diffuse
    S, cross = Yf @ cov @ Yf.T, X[k] @ cov @ Yf.T
    Sinv = np.linalg.inv(S)
    information = H.T @ Sinv @ H
    values, vectors = np.linalg.eigh(information)
    known = values > 1e-9 * max(values.max(), 1e-300)
    spread = vectors[:, known] @ np.diag(1 / values[known]) @ vectors[:, known].T
    δ = spread @ H.T @ Sinv @ e
    mean = mx[k] + cross @ Sinv @ (e - H @ δ) + J @ δ
    M = J - cross @ Sinv @ H
    covariance = X[k] @ cov @ X[k].T - cross @ Sinv @ cross.T + M @ spread @ M.T
    return mean, covariance, J @ vectors[:, ~known]


def diffuse_log_likelihood(model, prior, y, u):
    """The limit of the log-likelihood plus r/2 log κ where the prior variance along `diffuse` is κ -> infinity."""
    T = len(y)
    mx, X, my, Y, cov = joint(model, prior, u, T)
    seen = ~np.isnan(y.ravel())
    Yf, e = Y.reshape(T * model.p, -1)[seen], (y.ravel() - my.ravel())[seen]
    H, S = Yf[:, : model.n] @ prior.diffuse, Yf @ cov @ Yf.T
    Sinv = np.linalg.inv(S)
    information = H.T @ Sinv @ H
    δ = np.linalg.solve(information, H.T @ Sinv @ e)
    r = e - H @ δ
    return -0.5 * (
        len(e) * np.log(2 * np.pi) + np.linalg.slogdet(S)[1] + np.linalg.slogdet(information)[1] + r @ Sinv @ r
    )


def smoothed(model, prior, y, u):
    """Means and covariances of x[0..T-1] given all of y; where x[0] is diffuse, by least squares with a flat prior."""
    T = len(y)
    mx, X, my, Y, cov = joint(model, prior, u, T)
    seen = ~np.isnan(y.ravel())
    Yf, e = Y.reshape(T * model.p, -1)[seen], (y.ravel() - my.ravel())[seen]
    S = Yf @ cov @ Yf.T
    cross = np.einsum("tij,jk,lk->til", X, cov, Yf)
    gain = np.linalg.solve(S, np.swapaxes(cross, 1, 2).reshape(T, len(e), model.n)).swapaxes(1, 2)
    mean, covariance = mx + gain @ e, X @ cov @ np.swapaxes(X, 1, 2) - gain @ np.swapaxes(cross, 1, 2)
    if prior.diffuse is None:
        return mean, covariance
    H, J = Yf[:, : model.n] @ prior.diffuse, X[:, :, : model.n] @ prior.diffuse
    spread = np.linalg.inv(H.T @ np.linalg.solve(S, H))
    M = J - gain @ H
    return mean + M @ (spread @ (H.T @ np.linalg.solve(S, e))), covariance + M @ spread @ np.swapaxes(M, 1, 2)
