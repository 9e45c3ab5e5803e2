"""The libraries that filter one record with JAX, and kalman-py, which can use it: as in `peers`."""

import numpy as np
from scipy.stats import multivariate_normal

from .peers import KEEPS_ALL, NO_MISSING, library


def compiled(filtered, keep):
    """The runner of a function that returns JAX arrays (log-likelihood, means, covariances), without the unselected ones."""
    import jax

    of_record = jax.jit(lambda y: filtered(y)[: 3 if keep == "all" else 2])

    def make(y):
        def run():
            total, means, *_ = jax.block_until_ready(of_record(y))
            return np.asarray(means), float(total)

        return run

    return make


@library
def dynamax(model, prior, y, keep):
    """Its filter, jitted."""
    if np.isnan(y).any():
        return NO_MISSING
    return compiled(dynamax_filter(model.A, model.C, model.Q, model.R, prior), keep)(y)


def dynamax_filter(A, C, Q, R, prior):
    """(log-likelihood, means, covariances) of a record."""
    from dynamax.linear_gaussian_ssm.inference import lgssm_filter, make_lgssm_params

    def filtered(y):
        found = lgssm_filter(make_lgssm_params(prior.mean, prior.covariance, A, Q, C, R), y)
        return found.marginal_loglik, found.filtered_means, found.filtered_covariances

    return filtered


@library
def cuthbert(model, prior, y, keep):
    """Its sequential square-root filter, jitted."""
    Q, R = np.linalg.cholesky(model.Q), np.linalg.cholesky(model.R)
    return compiled(cuthbert_filter(model.A, model.C, Q, R, prior), keep)(y)


def cuthbert_filter(A, C, root_Q, root_R, prior):
    """As `dynamax_filter`; it predicts before each datum, before the first one without a change."""
    import cuthbert as library
    import jax.numpy as jnp
    from cuthbert.gaussian.kalman import build_filter

    n, root_P = len(prior.mean), np.linalg.cholesky(prior.covariance)
    C, root_R = jnp.asarray(C), jnp.asarray(root_R)

    def moves(row):
        first = row[0] == 0
        return jnp.where(first, jnp.eye(n), A), jnp.zeros(n), jnp.where(first, 0.0, root_Q)

    def tells(row):
        return C, jnp.zeros(len(C)), root_R, row[1]

    def filtered(y):
        kalman = build_filter(prior.mean, root_P, moves, tells)
        found = library.filter(kalman, (jnp.arange(len(y)), y), kalman.init_prepare())
        return found.log_normalizing_constant[-1], found.mean[1:], found.chol_cov[1:] @ found.chol_cov[1:].mT

    return filtered


def kalman_py(backend):
    """kalman-py on "numpy" or "jax"; it predicts before each datum, so that the first one is handled separately."""

    @library
    def make(model, prior, y, keep):
        from kalman_py import KalmanFilter

        if keep == "means":
            return KEEPS_ALL
        if np.isnan(y).any():
            return NO_MISSING
        A, C, Q, R = model.A, model.C, model.Q, model.R
        of_first = multivariate_normal(C @ prior.mean, C @ prior.covariance @ C.T + R)

        def run():
            first = KalmanFilter(A, C, Q, R, prior.mean, prior.covariance)
            first.update(y[0])
            found = KalmanFilter(A, C, Q, R, first.x, first.P).filter(y[1:], backend=backend)
            total = float(found.log_likelihood) + of_first.logpdf(y[0])
            return np.concatenate([first.x[None], np.asarray(found.means)]), total

        return run

    return make
