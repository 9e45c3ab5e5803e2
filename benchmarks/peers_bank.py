"""The other libraries on a bank of different models: each a function of (A, C, Q, R, prior, y) that returns a runner.

Arrays have a leading axis of runs, like `y`; a runner returns the log-likelihood of each run. Otherwise as in `peers`.
"""

import numpy as np

from .peers import library, statsmodels_filter
from .peers_jax import cuthbert_filter, dynamax_filter


@library
def statsmodels(A, C, Q, R, prior, y):
    """One run after another."""
    statsmodels_filter(A[0], C[0], Q[0], R[0], prior, y[0])  # fails here, and not at the first run

    def run():
        return np.array(
            [statsmodels_filter(*one[:4], prior, one[4]).loglike() for one in zip(A, C, Q, R, y, strict=True)]
        )

    return run


@library
def simdkalman(A, C, Q, R, prior, y):
    """Its two steps, all runs at once: its `compute` takes one model only."""
    from simdkalman import KalmanFilter

    def run():
        kf, total = KalmanFilter(A, Q, C, R), np.full(len(y), -0.5 * y[0].size * np.log(2 * np.pi))
        m, P = np.broadcast_to(prior.mean[:, None], (*A.shape[:2], 1)), np.broadcast_to(prior.covariance, A.shape)
        for k in range(y.shape[1]):
            m, P, _, told = kf.update(m, P, y[:, k, :, None], log_likelihood=True)
            total += told
            m, P = kf.predict_next(m, P)
        return total

    return run


@library
def dynamax(A, C, Q, R, prior, y):
    """Its filter, mapped over the runs and jitted."""
    return _mapped(dynamax_filter, A, C, Q, R, prior, y)


@library
def cuthbert(A, C, Q, R, prior, y):
    """Its square-root filter, mapped over the runs and jitted."""
    return _mapped(cuthbert_filter, A, C, np.linalg.cholesky(Q), np.linalg.cholesky(R), prior, y)


def _mapped(make, A, C, Q, R, prior, y):
    import jax

    make(A[0], C[0], Q[0], R[0], prior)  # imports its library
    total = jax.jit(jax.vmap(lambda A, C, Q, R, y: make(A, C, Q, R, prior)(y)[0]))
    return lambda: np.asarray(total(A, C, Q, R, y))
