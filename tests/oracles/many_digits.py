"""Covariances of the Kalman filter and of the model alone, by the textbook recursion with many digits (mpmath)."""

import mpmath as mp
import numpy as np


def digits(M):
    """An array of mpmath numbers, exactly those of floats."""
    M = np.asarray(M, float)
    return np.array([mp.mpf(float(x)) for x in M.ravel()], object).reshape(M.shape)


def inverse(M):
    """By mpmath's LU decomposition."""
    return np.array((mp.matrix(M.tolist()) ** -1).tolist(), object).reshape(M.shape)


def corrected(P, C, R):
    """After a sample."""
    K = P.dot(C.T).dot(inverse(C.dot(P).dot(C.T) + R))
    P = P - K.dot(C).dot(P)
    return (P + P.T) / 2


def after(A, Q, C, R, P, samples, dps=60):
    """(P, Π) after each of `samples` samples, the present one included; constant matrices, or lists over time."""
    with mp.workdps(dps):
        at = [[digits(M[k] if np.ndim(M) == 3 else M) for k in range(samples)] for M in (A, Q, C, R)]
        P = Π = digits(P)
        for k in range(samples):
            if k:
                F, W = at[0][k - 1], at[1][k - 1]
                P, Π = F.dot(P).dot(F.T) + W, F.dot(Π).dot(F.T) + W
            P = corrected(P, at[2][k], at[3][k])
            yield P, Π


def sigma(P):
    """Standard deviations as floats."""
    return np.array([float(mp.sqrt(x)) for x in np.diagonal(P)])


def canonical(P, Π, dps=90):
    """Squared canonical correlations, ascending, and 1 minus them, ascending."""
    with mp.workdps(dps):
        half = mp.cholesky(mp.matrix(Π.tolist())) ** -1
        X = half * mp.matrix(P.tolist()) * half.T
        left = sorted(mp.eigsy((X + X.T) / 2, eigvals_only=True))
        return np.array(sorted(float(1 - x) for x in left)), np.array([float(x) for x in left])


def over_time(A, Q, information, P0, seconds, dps=1000):
    """Sigma of the continuous filter: V U^-1 with (U, V) = e^{H t} (I, P0)."""
    n = len(A)
    with mp.workdps(dps):
        H = np.block([[-A.T, information], [Q, A]])
        E = mp.expm(mp.matrix(digits(H).tolist()) * seconds)
        start = mp.matrix(digits(P0).tolist())
        P = (E[n:, :n] + E[n:, n:] * start) * (E[:n, :n] + E[:n, n:] * start) ** -1
        return np.array([float(mp.sqrt(P[i, i])) for i in range(n)])
