"""The other libraries, where they are installed: each a function that filters a record."""

import numpy as np


def statsmodels(model, prior, y):
    """A function that gives (means, log-likelihood); None where statsmodels is not installed."""
    try:
        from statsmodels.tsa.statespace.kalman_filter import KalmanFilter
    except ImportError:
        return None

    def run():
        kf = KalmanFilter(k_endog=model.p, k_states=model.n)
        kf.bind(y.copy())
        kf["design"], kf["transition"], kf["selection"] = model.C, model.A, np.eye(model.n)
        kf["state_cov"], kf["obs_cov"] = model.Q, model.R
        kf.initialize_known(prior.mean, prior.covariance)
        result = kf.filter()
        return result.filtered_state.T, result.llf

    return run


def filterpy(model, prior, y):
    """A function that gives (means, None) of a record without missing outputs; None where filterpy is not installed."""
    try:
        from filterpy.kalman import KalmanFilter
    except ImportError:
        return None

    def run():
        kf = KalmanFilter(dim_x=model.n, dim_z=model.p)
        kf.F, kf.H, kf.Q, kf.R = model.A, model.C, model.Q, model.R
        kf.x, kf.P = prior.mean.copy(), prior.covariance.copy()
        means = np.empty((len(y), model.n))
        for k, sample in enumerate(y):
            kf.update(sample)
            means[k] = kf.x
            kf.predict()
        return means, None

    return run
