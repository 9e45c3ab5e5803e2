"""W15: the smoothers of one record, linear and nonlinear, and their filters on the same record."""

import numpy as np

from estimable import ExtendedKalman, Kalman, SecondOrderKalman, UnscentedKalman, estimate, smooth

from . import handwritten
from .common import problem, recorded, textbook_rows
from .filtering import compared
from .nonlinear import curved
from .peers import WHOLE_SAMPLE, library


def smoothers(name, T, missing):
    """n = 4, p = 2; accuracy against a Rauch-Tung-Striebel loop in NumPy."""
    model, prior = problem(4, 2)
    record = recorded(model, prior, T, missing)
    exact = rauch(model, prior, record.y)
    runs = {
        "estimable native": lambda: ours(smooth, Kalman(model), record, prior, "native"),
        "estimable xla": lambda: ours(smooth, Kalman(model), record, prior, "xla"),
        "estimable native, the filter alone": lambda: ours(estimate, Kalman(model), record, prior, "native"),
    }
    for contender, run in runs.items():
        yield compared(name, contender, run, exact if "filter" not in contender else None, 15)
    for contender, make in (("statsmodels", statsmodels), ("simdkalman", simdkalman)):
        yield compared(name, contender, make(model, prior, record.y), exact, 3, "library")
    by_hand = handwritten.contender(model, prior, record.y, smooths=True)
    yield compared(name, "hand-written C, Rauch-Tung-Striebel", by_hand, exact, 15, "by hand")
    yield compared(name, "NumPy loop, Rauch-Tung-Striebel", lambda: rauch(model, prior, record.y), exact, 1, "by hand")


def nonlinear_smoothers(name, T, missing):
    """The model of W10: each filter alone, then its smoother."""
    model, linear, prior = curved()
    record = recorded(linear, prior, T, missing)
    for make in (ExtendedKalman, SecondOrderKalman, UnscentedKalman):
        for run, what in ((estimate, "filter"), (smooth, "smoother")):
            contender = f"{make.__name__}, {what}"
            yield compared(name, contender, lambda r=run, m=make: ours(r, m(model), record, prior, "native"), None, 9)
    algorithm = ExtendedKalman(model)
    run = lambda: smooth(algorithm, record, prior=prior, iterations=20) and (None, None)  # noqa: E731
    yield compared(name, "ExtendedKalman, iterated smoother", run, None, 3)


def ours(run, algorithm, record, prior, engine):
    """(means, log-likelihood) of `smooth` or of `estimate`."""
    result = run(algorithm, record, prior=prior, engine=engine)
    return result.mean, result.log_likelihood


def rauch(model, prior, y):
    """The conventional smoother in a NumPy loop: filtered and predicted beliefs forwards, then corrected backwards."""
    beliefs = list(textbook_rows(model, prior, y))
    means = np.empty((len(y), model.n))
    means[-1], covariance = beliefs[-1][:2]
    for k in range(len(y) - 2, -1, -1):
        filtered, P, predicted, P_next, _ = beliefs[k]
        gain = np.linalg.solve(P_next, model.A @ P).T
        means[k] = filtered + gain @ (means[k + 1] - predicted)
        covariance = P + gain @ (covariance - P_next) @ gain.T
    return means, sum(belief[4] for belief in beliefs)


@library
def statsmodels(model, prior, y):
    """Set to give states and their covariances only."""
    from statsmodels.tsa.statespace import kalman_smoother as sm

    def run():
        kf = sm.KalmanSmoother(
            k_endog=model.p, k_states=model.n, smoother_output=sm.SMOOTHER_STATE | sm.SMOOTHER_STATE_COV
        )
        kf.bind(y.copy())
        kf["design"], kf["transition"], kf["selection"] = model.C, model.A, np.eye(model.n)
        kf["state_cov"], kf["obs_cov"] = model.Q, model.R
        kf.initialize_known(prior.mean, prior.covariance)
        result = kf.smooth()
        return result.smoothed_state.T, result.llf

    return run


@library
def simdkalman(model, prior, y):
    """Without the log-likelihood."""
    from simdkalman import KalmanFilter

    if np.isnan(y).any():
        return WHOLE_SAMPLE

    def run():
        kf = KalmanFilter(model.A, model.Q, model.C, model.R)
        result = kf.compute(y[None], 0, prior.mean, prior.covariance, smoothed=True, observations=False)
        return result.smoothed.states.mean[0], None

    return run
