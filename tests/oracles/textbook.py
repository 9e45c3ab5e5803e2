"""The Kalman filter as textbooks print it, in a loop that really deletes the rows that were not seen."""

import numpy as np


def matrices(model, k):
    """A, B, C, D, GQG', R, GS at row k of a discrete model."""

    def at(name):
        M = getattr(model, name)
        return M[k] if name in model.varying else M

    A, B, C, D, G, Q, R = (at(name) for name in ("A", "B", "C", "D", "G", "Q", "R"))
    GS = G @ (np.zeros((Q.shape[0], R.shape[0])) if model.S is None else at("S"))
    return A, B, C, D, G @ Q @ G.T, R, GS


def kalman(model, prior, y, u):
    """Filtered means, covariances and the log-likelihood; cross noise through the one-step predictor form."""
    x, P = np.array(prior.mean, float), np.array(prior.covariance, float)
    means, covariances, total = [], [], 0.0
    for k in range(len(y)):
        A, B, C, D, Q, R, GS = matrices(model, k)
        seen = ~np.isnan(y[k])
        C, R, GS = C[seen], R[np.ix_(seen, seen)], GS[:, seen]
        e = y[k, seen] - C @ x - (D @ u[k])[seen]
        S = C @ P @ C.T + R
        Sinv = np.linalg.inv(S) if seen.any() else np.zeros((0, 0))
        total -= 0.5 * (len(e) * np.log(2 * np.pi) + (np.linalg.slogdet(S)[1] if seen.any() else 0.0) + e @ Sinv @ e)
        means.append(x + P @ C.T @ Sinv @ e)
        covariances.append(P - P @ C.T @ Sinv @ C @ P)
        K = (A @ P @ C.T + GS) @ Sinv
        x, P = A @ x + B @ u[k] + K @ e, A @ P @ A.T + Q - K @ S @ K.T
    return np.array(means), np.array(covariances), total


def scalar_gain(A, b, C, Q, R, x, K, Pxx, PxK, PKK, u, z):
    """Pachter (1999) (42)-(49) with one measurement: the steps from (x, K) at k to those at k + 1, for z[1], z[2], ..

    The covariance is propagated as printed, in the form P - gain variance gain' (equal to (47)-(49) by (33)-(34)).
    """
    n, rows = len(A), []
    c = C[0]
    for uk, zk in zip(u, z, strict=True):
        Mx = A @ Pxx @ A.T + uk * (A @ np.outer(PxK, b) + np.outer(b, PxK) @ A.T) + uk**2 * PKK * np.outer(b, b) + Q
        MK = A @ PxK + uk * PKK * b
        variance = c @ Mx @ c + R  # (45)
        e = zk - c @ A @ x - K * (c @ b) * uk
        gain_x, gain_K = Mx @ c / variance, (MK @ c) / variance  # (44), (46)
        x, K = A @ x + K * b * uk + gain_x * e, K + gain_K * e  # (42), (43)
        Pxx = Mx - np.outer(gain_x, c @ Mx)
        PxK, PKK = MK - gain_x * (c @ MK), PKK - gain_K * (c @ MK)
        rows.append((x, K, Pxx, PxK, PKK))
    assert n == len(x)
    return rows
