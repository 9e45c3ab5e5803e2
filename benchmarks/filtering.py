"""W1 to W5 and W13: one record, a bank, outputs missing, online, and large models."""

import os
import time

import numpy as np

from estimable import InputError, Kalman, Prior, Record, estimate, estimate_bank, online, stack

from . import handwritten, peers, peers_bank, peers_jax, plain_jax
from .common import best, problem, recorded, row, textbook

LIBRARIES = {
    "statsmodels": peers.statsmodels,
    "statsmodels, conserve_memory": peers.statsmodels_conserving,
    "filterpy": peers.filterpy,
    "pykalman": peers.pykalman,
    "simdkalman": peers.simdkalman,
    "dynamax": peers_jax.dynamax,
    "cuthbert": peers_jax.cuthbert,
    "kalman-py": peers_jax.kalman_py("numpy"),
    "kalman-py, JAX": peers_jax.kalman_py("jax"),
}
LARGEST = {"cuthbert": 16}  # states
BANKS = {
    "statsmodels, one by one": peers_bank.statsmodels,
    "simdkalman": peers_bank.simdkalman,
    "dynamax": peers_bank.dynamax,
    "cuthbert": peers_bank.cuthbert,
}


def compared(name, contender, run, exact, repeats, whose="ours"):
    """The row of a contender that returns (means, log-likelihood), either of them None; `run` may be why it is absent.

    `exact`: the right ones, or None."""
    if isinstance(run, str):
        return row(name, contender, absent=run, whose=whose)
    seconds, first, (means, total) = best(run, repeats)
    exact = (None, None) if exact is None else exact
    error = None if means is None or exact[0] is None else float(np.abs(means - exact[0]).max())
    likelihood_error = None if total is None or exact[1] is None else abs(total - exact[1]) / abs(exact[1])
    return row(name, contender, seconds, first, error, likelihood_error, whose=whose)


def ours(model, prior, record, engine, keep="all", ran=None):
    """A function that returns our (means, log-likelihood); the set `ran` then holds the engine that ran."""
    ran = set() if ran is None else ran

    def run():
        result = estimate(Kalman(model), record, prior=prior, engine=engine, keep=keep)
        ran.add(result.engine)
        return result.mean, result.log_likelihood

    return run


def one_record(name, T, missing):
    """W1 and W3: one record of n = 4, p = 2; the other contenders store everything."""
    model, prior = problem(4, 2)
    record = recorded(model, prior, T, missing)
    exact = textbook(model, prior, record.y)
    for engine, keep in (("native", "all"), ("native", "means"), ("native", "likelihood"), ("xla", "all"),
                         ("xla", "likelihood")):  # fmt: skip
        run = ours(model, prior, record, engine, keep)
        yield compared(name, f"estimable {engine}, keep={keep}", run, exact, 5)
    for label, form in (("conventional", "kalman"), ("square-root", "kalman_ud")):
        run = handwritten.contender(model, prior, record.y, form)
        yield compared(name, f"hand-written C, {label}", run, exact, 5, "by hand")
    yield from others(name, model, prior, record.y, exact, "all")


def others(name, model, prior, y, exact, keep):
    """The rows of the libraries, and of the loops in JAX and NumPy."""
    for contender, make in LIBRARIES.items():
        largest = LARGEST.get(contender, model.n)
        run = (
            make(model, prior, y, keep)
            if model.n <= largest
            else f"left out beyond n = {largest}, where it takes minutes at T=2,000"
        )
        yield compared(name, contender, run, exact, 2, "library")
    plain = plain_jax.contender(model, prior, y, keep)
    yield compared(name, "plain lax.scan, masked Joseph", plain, exact, 3, "by hand")
    yield compared(name, "NumPy loop", lambda: textbook(model, prior, y), exact, 1, "by hand")


def bank(name, runs, T):
    """W2: many different models, one record each; accuracy on the first twenty."""
    rng, prior = np.random.default_rng(0), Prior(np.zeros(4), np.eye(4))
    models = [problem(4, 2, seed)[0] for seed in range(runs)]
    y = rng.normal(size=(runs, T, 2))
    algorithms, stacked = stack([Kalman(model) for model in models]), stack([Record(each, dt=1) for each in y])
    exact = np.array([textbook(models[i], prior, y[i])[1] for i in range(20)])

    def row_of(contender, run, repeats, whose="ours"):
        if isinstance(run, str):
            return row(name, contender, absent=run, whose=whose)
        seconds, first, totals = best(run, repeats)
        error = float(np.max(np.abs(totals[:20] / exact - 1)))
        return row(name, contender, seconds, first, log_likelihood_error=error, whose=whose)

    for engine in ("native", "xla"):

        def run(engine=engine):
            return estimate_bank(algorithms, stacked, prior=prior, engine=engine, keep="likelihood").log_likelihood

        yield row_of(f"estimable {engine}, keep=likelihood", run, 5)
    matrices = [np.stack([getattr(model, letter) for model in models]) for letter in "ACQR"]
    for threads in (1, os.cpu_count()):
        run = handwritten.bank(threads, *matrices, prior, y)
        yield row_of(f"hand-written C, 8 lanes, threads={threads}", run, 5, "by hand")
    for contender, make in BANKS.items():
        yield row_of(contender, make(*matrices, prior, y), 2, "library")


def one_step(name, n, p, steps):
    """W4: seconds of one correction and prediction called from Python; accuracy over a first run of all of them."""
    model, prior = problem(n, p)
    y = recorded(model, prior, steps).y
    exact = textbook(model, prior, y)
    for engine in ("native", "xla"):
        contender, start = f"estimable online {engine}", time.perf_counter()
        try:
            running = online(Kalman(model), prior=prior, engine=engine)
        except InputError as refused:
            yield row(name, contender, absent=str(refused))
            continue
        means = stepped(running, y)
        first = time.perf_counter() - start
        seconds, *_ = best(lambda running=running: stepped(running, y), 3)  # the run continues
        yield row(name, contender, seconds / steps, first, float(np.abs(means - exact[0]).max()))
    for contender, make in (("filterpy", peers.filterpy), ("kalman-py", peers.kalman_py_online)):
        measured = compared(name, contender, make(model, prior, y, "means"), exact, 3, "library")
        yield measured | {"seconds": measured["seconds"] and measured["seconds"] / steps}


def stepped(running, y):
    """The mean after each correction, read at once, as for the others."""
    means = np.empty((len(y), running.algorithm.model.n))
    for k, sample in enumerate(y):
        means[k] = running.correct(sample).mean
        running.predict()
    return means


def large(name, n, p, T, keep, missing):
    """W5 and W13: one record of a larger model, by the chosen engine and by XLA."""
    model, prior = problem(n, p)
    record = recorded(model, prior, T, missing)
    exact = textbook(model, prior, record.y)
    ran = set()
    taken = compared(name, "estimable", ours(model, prior, record, "auto", keep, ran), exact, 3)
    yield taken | {"contender": f"estimable {min(ran)}"}
    if ran != {"xla"}:
        yield compared(name, "estimable xla", ours(model, prior, record, "xla", keep), exact, 3)
    yield from others(name, model, prior, record.y, exact, keep)
