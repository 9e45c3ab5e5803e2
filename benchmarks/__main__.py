"""Print each workload: seconds of each contender, the ratio to ours, and how far its numbers are from an exact loop."""

import argparse
import json
import subprocess
import sys
import time

import numpy as np

from estimable import Kalman, Prior, Record, StateSpace, estimate, estimate_bank, simulate, stack

from . import handwritten

REPEATS = 5


def best(run):
    """Shortest of a few runs after a warm-up, in seconds, with the first one and the result."""
    start = time.perf_counter()
    result = run()
    first = time.perf_counter() - start
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        result = run()
        times.append(time.perf_counter() - start)
    return min(times), first, result


def one_long_record(T, missing):
    """n = 4, p = 2: the model, its prior, and a record with channels missing at random."""
    rng = np.random.default_rng(0)
    A = rng.normal(size=(4, 4))
    A *= 0.95 / np.abs(np.linalg.eigvals(A)).max()
    model = StateSpace(A, C=rng.normal(size=(2, 4)), Q=0.1 * np.eye(4), R=0.3 * np.eye(2), dt=1)
    prior = Prior(np.zeros(4), np.eye(4))
    y = simulate(model, seed=1, steps=T, prior=prior).record.y.copy()
    y[rng.random(y.shape) < missing] = np.nan
    return model, prior, Record(y, dt=1)


def textbook(model, prior, y):
    """The conventional filter in a NumPy loop that deletes rows: what a person writes first, and the accuracy's yardstick."""
    A, C, Q, R = model.A, model.C, model.Q, model.R
    x, P, total, means = prior.mean, prior.covariance, 0.0, np.empty((len(y), 4))
    for k, row in enumerate(y):
        seen = ~np.isnan(row)
        Ck, e = C[seen], row[seen] - C[seen] @ x
        S = Ck @ P @ Ck.T + R[np.ix_(seen, seen)]
        K = np.linalg.solve(S, Ck @ P).T
        total -= 0.5 * (len(e) * np.log(2 * np.pi) + np.log(np.linalg.det(S)) + e @ np.linalg.solve(S, e))
        x, P = x + K @ e, P - K @ Ck @ P
        means[k] = x
        x, P = A @ x, A @ P @ A.T + Q
    return means, total


def peers(model, prior, record):
    """The peers that are installed, by name: each returns (means, log-likelihood or None)."""
    yield "NumPy loop", lambda: textbook(model, prior, record.y)
    try:
        from statsmodels.tsa.statespace.kalman_filter import KalmanFilter
    except ImportError:
        return

    def statsmodels():
        kf = KalmanFilter(k_endog=2, k_states=4)
        kf.bind(record.y.copy())
        kf["design"], kf["transition"], kf["selection"] = model.C, model.A, np.eye(4)
        kf["state_cov"], kf["obs_cov"] = model.Q, model.R
        kf.initialize_known(prior.mean, prior.covariance)
        result = kf.filter()
        return result.filtered_state.T, result.llf

    yield "statsmodels", statsmodels


def record_workload(name, T, missing):
    """W1 and W3: one record of n = 4, p = 2."""
    model, prior, record = one_long_record(T, missing)
    reference, reference_total = textbook(model, prior, record.y)
    rows = []

    def note(contender, seconds, first, means, total):
        error = None if means is None else float(np.abs(means - reference).max())
        likelihood_error = None if total is None else abs(total - reference_total) / abs(reference_total)
        rows.append({"workload": name, "contender": contender, "seconds": seconds, "first_call": first,
                     "mean_error": error, "log_likelihood_error": likelihood_error})  # fmt: skip

    for engine, keep in (
        ("native", "all"),
        ("native", "means"),
        ("native", "likelihood"),
        ("xla", "all"),
        ("xla", "likelihood"),
    ):
        seconds, first, result = best(
            lambda engine=engine, keep=keep: estimate(Kalman(model), record, prior=prior, engine=engine, keep=keep)
        )
        note(f"estimable {engine}, keep={keep}", seconds, first, result.mean, result.log_likelihood)
    c_loop = handwritten.contender(model, prior, record.y)
    if c_loop is not None:
        seconds, first, (means, total) = best(c_loop)
        note("hand-written C, means and covariances", seconds, first, means, total)
    for contender, run in peers(model, prior, record):
        start = time.perf_counter()
        means, total = run()
        seconds = time.perf_counter() - start
        note(contender, seconds, seconds, means, total)
    return rows


def bank_workload(name, runs, T):
    """W2: many different models, one record each; accuracy on the first twenty."""
    rng, models, records = np.random.default_rng(0), [], []
    prior = Prior(np.zeros(4), np.eye(4))
    for _ in range(runs):
        A = rng.normal(size=(4, 4))
        A *= 0.95 / np.abs(np.linalg.eigvals(A)).max()
        models.append(StateSpace(A, C=rng.normal(size=(2, 4)), Q=0.1 * np.eye(4), R=0.3 * np.eye(2), dt=1))
        records.append(Record(rng.normal(size=(T, 2)), dt=1))
    algorithms, stacked = stack([Kalman(model) for model in models]), stack(records)
    exact = np.array([textbook(models[i], prior, records[i].y)[1] for i in range(20)])
    rows = []
    for engine in ("native", "xla"):
        seconds, first, bank = best(
            lambda engine=engine: estimate_bank(algorithms, stacked, prior=prior, engine=engine, keep="likelihood")
        )
        error = float(np.max(np.abs(bank.log_likelihood[:20] / exact - 1)))
        rows.append({"workload": name, "contender": f"estimable {engine}, keep=likelihood", "seconds": seconds,
                     "first_call": first, "mean_error": None, "log_likelihood_error": error})  # fmt: skip
    return rows


def starts():
    """W9: seconds from a cold start, of whole processes."""

    def process(code):
        start = time.perf_counter()
        subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)
        return time.perf_counter() - start

    jax_only, ours = (min(process(f"import {name}") for _ in range(3)) for name in ("jax", "estimable"))
    demo = process("import sys; sys.argv=['estimable','demo','--json']; from estimable.commands import main; main()")
    blank = {"workload": "W9 start", "first_call": None, "mean_error": None, "log_likelihood_error": None}
    return [
        blank | {"contender": "import estimable", "seconds": ours},
        blank | {"contender": "import jax", "seconds": jax_only},
        blank | {"contender": "estimable demo, a new process", "seconds": demo},
    ]


def table(rows):
    """The rows as a Markdown table; ratios are to ours with everything kept, of the same workload."""
    lines = ["| workload | contender | seconds | ratio to ours | first call [s] | mean error | log-likelihood error |",
             "|---|---|---|---|---|---|---|"]  # fmt: skip
    for row in rows:
        ours = next(r["seconds"] for r in rows if r["workload"] == row["workload"])
        cells = [row["workload"], row["contender"], f"{row['seconds']:.3g}", f"{row['seconds'] / ours:.2f}"]
        for key in ("first_call", "mean_error", "log_likelihood_error"):
            cells.append("" if row[key] is None else f"{row[key]:.2g}")
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main():
    """Run the workloads whose algorithms exist so far."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a tenth of the rows and runs")
    parser.add_argument("--json", action="store_true", help="rows as JSON in place of a table")
    options = parser.parse_args()
    T, runs = (10_000, 1_000) if options.quick else (100_000, 10_000)
    rows = [
        *record_workload(f"W1 one record, n=4 p=2, T={T:,}", T, 0.0),
        *record_workload(f"W3 the same, 30 % of channels missing, T={T:,}", T, 0.3),
        *bank_workload(f"W2 {runs:,} models of n=4 p=2, 200 samples each", runs, 200),
        *starts(),
    ]
    print(json.dumps(rows) if options.json else table(rows))


if __name__ == "__main__":
    main()
