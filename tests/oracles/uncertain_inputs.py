"""The likelihood of outputs whose inputs are uncertain, as one joint Gaussian."""

import numpy as np
from scipy.signal import lfilter
from scipy.stats import multivariate_normal


def joint_log_likelihood(a, b, delay, r, u, variance, y):
    """Of y (NaN: not seen) with independent inputs of mean u (T, m) and the given variances, from rest."""
    T, m = u.shape
    impulses = [lfilter(np.append(np.zeros(delay), b[j]), np.append(1.0, a), np.eye(1, T)[0]) for j in range(m)]
    H = [np.array([[h[i - k] if i >= k else 0.0 for k in range(T)] for i in range(T)]) for h in impulses]
    mean = sum(H[j] @ u[:, j] for j in range(m))
    covariance = r * np.eye(T) + sum(H[j] @ np.diag(variance[:, j]) @ H[j].T for j in range(m))
    seen = ~np.isnan(y)
    return multivariate_normal(mean[seen], covariance[np.ix_(seen, seen)]).logpdf(y[seen])
