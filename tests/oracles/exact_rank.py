"""Is a model estimable? With mpmath at 50 digits: the covariances of the state with past outputs, and their rank."""

import mpmath as mp
import numpy as np

mp.mp.dps = 50


def _matrix(M):
    return mp.matrix(np.asarray(M).tolist())


def smallest_ratio(F, Q, H, R, start, steps):
    """sigma_min / sigma_max of [cov(x[k], y[j] for j < k)] at the worst n <= k <= steps, in unit-free states and outputs."""
    F, Q, H, R, Π = map(_matrix, (F, Q, H, R, start))
    n, p, worst = F.rows, H.rows, mp.inf
    blocks = []
    for k in range(1, steps + 1):
        S = H * Π * H.T + R
        M = F * Π * H.T
        for j in range(p):
            for i in range(n):
                M[i, j] /= mp.sqrt(S[j, j]) if S[j, j] > 0 else 1
        blocks = [F * block for block in blocks] + [M]
        Π = F * Π * F.T + Q
        if k >= n:
            worst = min(worst, _ratio(blocks, Π))
    return float(worst)


def _ratio(blocks, Π):
    n = Π.rows
    W = mp.zeros(n, n)
    for block in blocks:
        W += block * block.T
    for i in range(n):
        for j in range(n):
            size = mp.sqrt(Π[i, i] * Π[j, j])
            W[i, j] /= size if size > 0 else 1
    eigenvalues = mp.eigsy(W, eigvals_only=True)
    largest = max(eigenvalues)
    return mp.sqrt(max(min(eigenvalues), 0) / largest) if largest > 0 else mp.mpf(0)
