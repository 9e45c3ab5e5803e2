"""The other libraries that filter one record: each a function of (model, prior, y, keep) that returns a runner.

A runner returns (means, log-likelihood or None). A message replaces it where the library is not installed (from `library`), or
would not compute the same (from the functions). `keep`: "all", means and covariances, or "means".
"""

import functools

import numpy as np

NO_MISSING = "takes no missing outputs"
WHOLE_SAMPLE = "a missing output takes its whole sample with it"
KEEPS_ALL = "keeps the covariances"


def library(make):
    """`make`, which imports a library; a message replaces its function where that fails."""

    @functools.wraps(make)
    def made(*arguments):
        try:
            return make(*arguments)
        except ModuleNotFoundError:
            return "not installed"
        except (ImportError, AttributeError) as why:  # made for another JAX or NumPy
            return f"cannot be imported: {why}"

    return made


@library
def statsmodels(model, prior, y, keep):
    """With its defaults: it stores much more than requested."""
    if keep == "means":
        return KEEPS_ALL
    return _statsmodels(model, prior, y, 0)


@library
def statsmodels_conserving(model, prior, y, keep):
    """Set to store what ours stores: the filtered means, the forecasts and, if requested, the covariances of both."""
    from statsmodels.tsa.statespace import kalman_filter as sm

    forgotten = sm.MEMORY_NO_PREDICTED | sm.MEMORY_NO_GAIN | sm.MEMORY_NO_SMOOTHING | sm.MEMORY_NO_STD_FORECAST
    if keep == "means":
        forgotten |= sm.MEMORY_NO_FILTERED_COV | sm.MEMORY_NO_FORECAST_COV
    return _statsmodels(model, prior, y, forgotten)


def _statsmodels(model, prior, y, forgotten):
    statsmodels_filter(model.A, model.C, model.Q, model.R, prior, y[:1])  # fails here, and not at the first run

    def run():
        result = statsmodels_filter(model.A, model.C, model.Q, model.R, prior, y, conserve_memory=forgotten).filter()
        return result.filtered_state.T, result.llf

    return run


def statsmodels_filter(A, C, Q, R, prior, y, **options):
    """The filter of one record, ready to run."""
    from statsmodels.tsa.statespace.kalman_filter import KalmanFilter

    kf = KalmanFilter(k_endog=len(C), k_states=len(A), **options)
    kf.bind(y.copy())
    kf["design"], kf["transition"], kf["selection"], kf["state_cov"], kf["obs_cov"] = C, A, np.eye(len(A)), Q, R
    kf.initialize_known(prior.mean, prior.covariance)
    return kf


@library
def filterpy(model, prior, y, keep):
    """A Python loop over its two steps; it has no log-likelihood of a record."""
    from filterpy.kalman import KalmanFilter

    if np.isnan(y).any():
        return NO_MISSING

    def run():
        kf = KalmanFilter(dim_x=model.n, dim_z=model.p)
        kf.F, kf.H, kf.Q, kf.R = model.A, model.C, model.Q, model.R
        kf.x, kf.P = prior.mean.copy(), prior.covariance.copy()
        return stepped(kf, y, keep), None

    return run


def stepped(kf, y, keep):
    """The means of a filter that steps by `update` and `predict`, as filterpy's and kalman-py's."""
    means, covariances = np.empty((len(y), len(kf.x))), []
    for k, sample in enumerate(y):
        kf.update(sample)
        means[k] = kf.x
        if keep == "all":
            covariances.append(kf.P)
        kf.predict()
    return means


@library
def pykalman(model, prior, y, keep):
    """Its log-likelihood would be a second filter: left out."""
    from pykalman import KalmanFilter

    if keep == "means":
        return KEEPS_ALL
    if np.isnan(y).any():
        return WHOLE_SAMPLE

    def run():
        kf = KalmanFilter(model.A, model.C, model.Q, model.R, None, None, prior.mean, prior.covariance)
        return kf.filter(y)[0], None

    return run


@library
def simdkalman(model, prior, y, keep):
    """Its log-likelihood leaves out the constant, which is added."""
    from simdkalman import KalmanFilter

    if keep == "means":
        return KEEPS_ALL
    if np.isnan(y).any():
        return WHOLE_SAMPLE

    def run():
        kf = KalmanFilter(model.A, model.Q, model.C, model.R)
        result = kf.compute(y[None], 0, prior.mean, prior.covariance, smoothed=False, filtered=True, observations=False,
                            log_likelihood=True)  # fmt: skip
        return result.filtered.states.mean[0], result.log_likelihood[0] - 0.5 * y.size * np.log(2 * np.pi)

    return run


@library
def kalman_py_online(model, prior, y, keep):
    """kalman-py from step to step."""
    from kalman_py import KalmanFilter

    def run():
        return stepped(KalmanFilter(model.A, model.C, model.Q, model.R, prior.mean, prior.covariance), y, keep), None

    return run
