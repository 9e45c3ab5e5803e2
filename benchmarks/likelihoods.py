"""W12 and W14: derivatives of a likelihood, and noises fitted by them."""

import ctypes

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import minimize

from estimable import Kalman, estimate, fit_noise, log_likelihood
from estimable import score as our_score
from estimable.frozen import replace

from . import handwritten
from .common import best, problem, recorded, row

NUMBERS = ("A[x1, x1]", "A[x2, x1]", "A[x3, x2]", "A[x4, x4]", "Q[x1]", "Q[x4]", "R[y1]", "R[y2]")


def score(name, T, missing):
    """W12: the log-likelihood, its 8 derivatives and their information, n = 4, p = 2."""
    model, prior = problem(4, 2)
    record = recorded(model, prior, T, missing)
    exact = our_score(Kalman(model), record, prior=prior, with_respect_to=NUMBERS, engine="xla")
    by_hand = "it takes complete records only" if missing else _by_hand(model, prior, record)
    for label, run, repeats, whose in (
        ("estimable native, score and information", _ours(model, prior, record), 15, "ours"),
        ("hand-written C, sensitivity recursion", by_hand, 15, "by hand"),
        ("XLA, value_and_grad of our scan (no information)", _reverse(model, prior, record), 3, "ours"),
        ("estimable native, likelihood alone", _likelihood(model, prior, record), 15, "ours"),
    ):
        if isinstance(run, str):
            yield row(name, label, absent=run, whose=whose)
            continue
        seconds, first, (total, slope) = best(run, repeats)
        error = (
            None if slope is None else float(np.abs((slope - exact.score) / np.sqrt(np.diag(exact.information))).max())
        )
        yield row(name, label, seconds, first, error, abs(total / exact.log_likelihood - 1), whose=whose)


def _ours(model, prior, record):
    def run():
        found = our_score(Kalman(model), record, prior=prior, with_respect_to=NUMBERS)
        return found.log_likelihood, found.score

    return run


def _likelihood(model, prior, record):
    return lambda: (estimate(Kalman(model), record, prior=prior, keep="likelihood").log_likelihood, None)


def _directions():
    """The units of A (8, 4, 4), Q (8, 4, 4) and R (8, 2, 2) that NUMBERS name."""
    dA, dQ, dR = np.zeros((8, 4, 4)), np.zeros((8, 4, 4)), np.zeros((8, 2, 2))
    for a, (i, j) in enumerate(((0, 0), (1, 0), (2, 1), (3, 3))):
        dA[a, i, j] = 1
    dQ[4, 0, 0] = dQ[5, 3, 3] = dR[6, 0, 0] = dR[7, 1, 1] = 1
    return dA, dQ, dR


def _by_hand(model, prior, record):
    library = handwritten.library("handwritten_score.c")
    if library is None:
        return handwritten.NO_COMPILER
    recursion = library.score
    recursion.restype, recursion.argtypes = ctypes.c_double, [ctypes.c_long, ctypes.c_int, *[ctypes.c_void_p] * 12]
    given = [np.ascontiguousarray(M) for M in (model.A, model.C, model.Q, model.R, *_directions())]
    y = np.ascontiguousarray(record.y)

    def run():
        x, P, g, H = prior.mean.copy(), prior.covariance.copy(), np.empty(8), np.empty((8, 8))
        total = recursion(len(y), 8, *(a.ctypes.data for a in (*given, x, P, y, g, H)))
        return total, g

    return run


def _reverse(model, prior, record):
    dA, dQ, dR = _directions()

    def value(θ):
        A, Q, R = (M + jnp.tensordot(θ, dM, 1) for M, dM in ((model.A, dA), (model.Q, dQ), (model.R, dR)))
        return log_likelihood(Kalman(replace(model, A=A, Q=Q, R=R)), record, prior=prior)

    compiled = jax.jit(jax.value_and_grad(value))
    return lambda: tuple(np.asarray(part) for part in compiled(np.zeros(8)))


def fitted(name, T):
    """W14: six variances by maximum likelihood; the error is that of the log-likelihood."""
    model, prior = problem(4, 2)
    record = recorded(model, prior, T)
    start = Kalman(replace(model, Q=np.eye(4), R=np.eye(2)))
    seconds, first, (θ, total) = best(lambda: _fit(start, record, prior), 9)
    yield row(name, "estimable fit_noise", seconds, first, 0.0, 0.0)
    for label, run in (("SciPy L-BFGS-B on differences of our likelihood", _differences(model, prior, record)),
                       ("statsmodels MLE", _statsmodels(model, prior, record))):  # fmt: skip
        if isinstance(run, str):
            yield row(name, label, absent=run, whose="library")
            continue
        seconds, first, (other, reached) = best(run, 2)
        yield row(
            name,
            label,
            seconds,
            first,
            float(np.abs(other / θ - 1).max()),
            max(0.0, (total - reached) / abs(total)),
            whose="library",
        )


def _fit(start, record, prior):
    fit = fit_noise(start, record, prior=prior)
    return fit.parameters, fit.log_likelihood


def _differences(model, prior, record):
    def minus(θ):
        tried = replace(model, Q=np.diag(np.exp(θ[:4])), R=np.diag(np.exp(θ[4:])))
        return -estimate(Kalman(tried), record, prior=prior, keep="likelihood").log_likelihood

    def run():
        found = minimize(minus, np.zeros(6), method="L-BFGS-B")
        return np.exp(found.x), -float(found.fun)

    return run


def _statsmodels(model, prior, record):
    try:
        from statsmodels.tsa.statespace.mlemodel import MLEModel
    except ImportError:
        return "statsmodels is not installed"

    class Noises(MLEModel):
        param_names = tuple(f"log variance {i}" for i in range(6))
        start_params = np.zeros(6)

        def __init__(self, y):
            super().__init__(y, k_states=4, k_posdef=4)
            self["transition"], self["design"], self["selection"] = model.A, model.C, np.eye(4)
            self.ssm.initialize_known(prior.mean, prior.covariance)

        def update(self, params, **kwargs):
            """Put the variances into the model."""
            params = super().update(params, **kwargs)
            self["state_cov"], self["obs_cov"] = np.diag(np.exp(params[:4])), np.diag(np.exp(params[4:]))

    def run():
        found = Noises(record.y).fit(disp=0, maxiter=200)
        return np.exp(np.asarray(found.params)), float(found.llf)

    return run
