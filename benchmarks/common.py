"""Shared by the workloads: timing, a row of the table, problems, and the exact loop as the reference of accuracy."""

import time

import numpy as np

from estimable import Prior, Record, StateSpace, simulate

REPEATS = 5
LONG = 2.0  # seconds above which a run is not repeated


def best(run, repeats=REPEATS):
    """Shortest of a few runs after a warm-up, in seconds, with the first one and the result; a single run if it is long."""
    start = time.perf_counter()
    result = run()
    first = time.perf_counter() - start
    times = []
    while not times or (len(times) < repeats and sum(times) < LONG):
        del result  # frees the memory of a large one before the next
        start = time.perf_counter()
        result = run()
        times.append(time.perf_counter() - start)
    return min(times), first, result


def row(
    workload, contender, seconds=None, first_call=None, error=None, log_likelihood_error=None, absent=None, whose="ours"
):
    """The row of a contender; `whose`: "ours", "library" or "by hand".

    `error`: the largest error of a mean against the exact loop, or the relative residual of an equation.
    """
    return {"workload": workload, "contender": contender, "seconds": seconds, "first_call": first_call, "error": error,
            "log_likelihood_error": log_likelihood_error, "absent": absent, "whose": whose}  # fmt: skip


def problem(n, p, seed=0):
    """A stable model drawn at random, and its prior."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(n, n))
    A *= 0.95 / np.abs(np.linalg.eigvals(A)).max()
    model = StateSpace(A, C=rng.normal(size=(p, n)), Q=0.1 * np.eye(n), R=0.3 * np.eye(p), dt=1)
    return model, Prior(np.zeros(n), np.eye(n))


def recorded(model, prior, T, missing=0.0):
    """A record of the model with channels missing at random."""
    y = simulate(model, seed=1, steps=T, prior=prior).record.y.copy()
    y[np.random.default_rng(1).random(y.shape) < missing] = np.nan
    return Record(y, dt=1)


def textbook(model, prior, y):
    """The conventional filter in a NumPy loop that deletes rows: the obvious first version, and the reference of accuracy."""
    rows = list(textbook_rows(model, prior, y))
    return np.stack([row[0] for row in rows]), sum(row[4] for row in rows)


def textbook_rows(model, prior, y):
    """Row by row: mean and covariance after the sample, those predicted for the next, and the log-likelihood."""
    A, C, Q, R = model.A, model.C, model.Q, model.R
    x, P = prior.mean, prior.covariance
    for sample in y:
        seen = ~np.isnan(sample)
        Ck, e = C[seen], sample[seen] - C[seen] @ x
        S = Ck @ P @ Ck.T + R[np.ix_(seen, seen)]
        K = np.linalg.solve(S, Ck @ P).T
        likelihood = -0.5 * (len(e) * np.log(2 * np.pi) + np.linalg.slogdet(S)[1] + e @ np.linalg.solve(S, e))
        filtered, covariance = x + K @ e, P - K @ Ck @ P
        x, P = A @ filtered, A @ covariance @ A.T + Q
        yield filtered, covariance, x, P, likelihood
