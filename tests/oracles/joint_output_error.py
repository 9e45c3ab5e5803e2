"""Outputs, inputs and parameters of an output-error model as one Gaussian, with its covariance written out: for one channel."""

import numpy as np


def joint_recursion(y, u, na, nb, r, mean, P, arrived=None, rate=1.0, lost="zero"):
    """θ (T, d), its covariance (T, d, d), predicted outputs (T,) and their variances (T,); y is NaN where it was lost.

    The belief holds na past outputs, the inputs u[k], .., u[k-nb] that were applied, and θ.
    """
    n, nu = na + nb + 1, nb + 1
    m = np.concatenate([np.zeros(n), mean])
    C = np.zeros((len(m), len(m)))
    C[n:, n:] = P
    found = []
    for k in range(len(y)):
        m, C = _send(m, C, na, nu, u[k], rate if arrived is None or np.isnan(arrived[k]) else arrived[k], lost)
        x, row, variance = _next(m, C, na, nu)
        m_x, C_x = np.append(x, m), np.block([[np.atleast_2d(variance), row[None]], [row[:, None], C]])
        predicted, S = x, variance + r
        if not np.isnan(y[k]):
            K = C_x[:, 0] / S
            m_x, C_x = m_x + K * (y[k] - x), C_x - np.outer(K, C_x[0])
        keep = [i for i in range(len(m_x)) if i != na]  # the oldest output goes
        m, C = m_x[keep], C_x[np.ix_(keep, keep)]
        found.append((m[n:], C[n:, n:], predicted, S))
    return tuple(np.array(column) for column in zip(*found, strict=True))


def _send(m, C, na, nu, u, p, lost):
    """u[k] is applied with probability p, else nothing or the input before."""
    T = np.eye(len(m))
    T[na : na + nu] = 0.0
    for j in range(1, nu):
        T[na + j, na + j - 1] = 1.0
    last = m[na] if lost == "hold" else 0.0
    spread = (u - last) ** 2 + (C[na, na] if lost == "hold" else 0.0)
    if lost == "hold":
        T[na, na] = 1 - p
    m, C = T @ m, T @ C @ T.T
    m[na] += p * u
    C[na, na] += p * (1 - p) * spread
    return m, C


def _next(m, C, na, nu):
    """Mean of the next output, its covariance with all else, and its variance, term by term (Isserlis)."""
    n = na + nu
    pairs = [(n + i, i, -1.0) for i in range(na)] + [(n + na + j, na + j, 1.0) for j in range(nu)]
    x = sum(s * (m[i] * m[j] + C[i, j]) for i, j, s in pairs)
    row = sum(s * (m[i] * C[j] + m[j] * C[i]) for i, j, s in pairs)
    variance = 0.0
    for i, j, s in pairs:
        for k, h, q in pairs:
            variance += s * q * (
                m[i] * m[k] * C[j, h] + m[i] * m[h] * C[j, k] + m[j] * m[k] * C[i, h] + m[j] * m[h] * C[i, k]
                + C[i, k] * C[j, h] + C[i, h] * C[j, k]
            )  # fmt: skip
    return x, row, variance
