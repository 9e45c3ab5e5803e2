"""W1 to W5: one record, a bank, outputs missing, online, and large models."""

import time

import numpy as np

from estimable import InputError, Kalman, Prior, Record, estimate, estimate_bank, online, stack

from . import handwritten, peers
from .common import best, problem, recorded, row, textbook


def compared(name, contender, run, exact, repeats):
    """The row of a contender that gives (means, log-likelihood), either of them None."""
    seconds, first, (means, total) = best(run, repeats)
    error = None if means is None else float(np.abs(means - exact[0]).max())
    likelihood_error = None if total is None else abs(total - exact[1]) / abs(exact[1])
    return row(name, contender, seconds, first, error, likelihood_error)


def ours(model, prior, record, engine, keep="all"):
    """A function that gives our (means, log-likelihood)."""

    def run():
        result = estimate(Kalman(model), record, prior=prior, engine=engine, keep=keep)
        return result.mean, result.log_likelihood

    return run


def one_record(name, T, missing):
    """W1 and W3: one record of n = 4, p = 2."""
    model, prior = problem(4, 2)
    record = recorded(model, prior, T, missing)
    exact = textbook(model, prior, record.y)
    for engine, keep in (("native", "all"), ("native", "means"), ("native", "likelihood"), ("xla", "all"),
                         ("xla", "likelihood")):  # fmt: skip
        run = ours(model, prior, record, engine, keep)
        yield compared(name, f"estimable {engine}, keep={keep}", run, exact, 5)
    others = {
        "hand-written C, conventional": handwritten.contender(model, prior, record.y),
        "hand-written C, square-root": handwritten.contender(model, prior, record.y, "kalman_ud"),
        "statsmodels": peers.statsmodels(model, prior, record.y),
        "NumPy loop": lambda: textbook(model, prior, record.y),
    }
    for contender, run in others.items():
        yield row(name, contender, absent="not installed") if run is None else compared(name, contender, run, exact, 1)


def bank(name, runs, T):
    """W2: many different models, one record each; accuracy on the first twenty."""
    rng, prior = np.random.default_rng(0), Prior(np.zeros(4), np.eye(4))
    models = [problem(4, 2, seed)[0] for seed in range(runs)]
    records = [Record(rng.normal(size=(T, 2)), dt=1) for _ in models]
    algorithms, stacked = stack([Kalman(model) for model in models]), stack(records)
    exact = np.array([textbook(models[i], prior, records[i].y)[1] for i in range(20)])
    for engine in ("native", "lanes", "xla"):
        seconds, first, result = best(
            lambda engine=engine: estimate_bank(algorithms, stacked, prior=prior, engine=engine, keep="likelihood")
        )
        error = float(np.max(np.abs(result.log_likelihood[:20] / exact - 1)))
        yield row(name, f"estimable {engine}, keep=likelihood", seconds, first, log_likelihood_error=error)


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
        means = np.array([info.mean for info in stepped(running, y)])
        first = time.perf_counter() - start
        seconds, *_ = best(lambda running=running: stepped(running, y), 3)  # the run goes on
        yield row(name, contender, seconds / steps, first, float(np.abs(means - exact[0]).max()))
    run = peers.filterpy(model, prior, y)
    told = row(name, "filterpy", absent="not installed") if run is None else compared(name, "filterpy", run, exact, 3)
    yield told | {"seconds": told["seconds"] and told["seconds"] / steps}


def stepped(running, y):
    """What each correction said; a mean is read when it is asked for."""
    infos = []
    for sample in y:
        infos.append(running.correct(sample))
        running.predict()
    return infos


def large(name, n, T):
    """W5: one record of a larger model with two outputs, everything kept."""
    model, prior = problem(n, 2)
    record = recorded(model, prior, T)
    exact = textbook(model, prior, record.y)
    for engine in ("native", "xla"):
        try:
            yield compared(name, f"estimable {engine}", ours(model, prior, record, engine), exact, 3)
        except InputError as refused:
            yield row(name, f"estimable {engine}", absent=str(refused))
    others = {
        "statsmodels": peers.statsmodels(model, prior, record.y),
        "filterpy": peers.filterpy(model, prior, record.y),
        "NumPy loop": lambda: textbook(model, prior, record.y),
    }
    for contender, run in others.items():
        yield row(name, contender, absent="not installed") if run is None else compared(name, contender, run, exact, 1)
