"""W6: the gain of the F-16 over a window of 30 samples, for many flights."""

import numpy as np

import estimable as es
from estimable.plants import f16

from .common import best, row

LENGTH, ROWS = 30, 1650


def windows(name, runs):
    """Every window of every flight, by engine; each error: the gain of a few against each window run as a separate filter."""
    model, prior, gain = f16.short_period(), es.Prior([0.0, 0.0], 0.01 * np.eye(2)), es.Prior([0.8], [[0.4]])
    t = np.arange(ROWS) / f16.RATE
    u = np.where(t % 4.5 < 2.25, 2.0, -2.0)[:, None]
    drawn = es.simulate_bank(
        model, np.where(t[:, None] < 4.5, u, 0.4 * u), seed=1, runs=runs, prior=prior, dt=1 / f16.RATE
    )
    names = {"outputs": model.outputs, "inputs": model.inputs}
    records = es.stack([es.Record(y, u, dt=1 / f16.RATE, **names) for y in drawn.items.record.y])
    algorithm = es.UnknownGain(model, gain)
    exact = _one_by_one(algorithm, records.items, prior)
    for engine, keep in (("native", "means"), ("native", "all"), ("xla", "means")):
        some = records if engine == "native" else es.stack([_record(records.items, i, names) for i in range(50)])
        window = es.MovingWindow(algorithm, LENGTH)

        def run(window=window, some=some, engine=engine, keep=keep):
            return es.estimate_bank(window, some, prior=prior, engine=engine, keep=keep)

        seconds, first, found = best(run, repeats=2)
        label = f"estimable {engine}, keep={keep}" + ("" if engine == "native" else ", 50 flights")
        yield row(name, label, seconds, first, float(np.abs(found.gain[0, exact[0], 0] - exact[1]).max()))


def _record(items, i, names):
    return es.Record(items.y[i], items.u[i], dt=1 / f16.RATE, **names)


def _one_by_one(algorithm, items, prior):
    """Some rows of the first flight, and their gain by a filter started at the window's first row with unknown state."""
    rows, names = np.arange(LENGTH, ROWS, 100), {"outputs": algorithm.names.outputs, "inputs": algorithm.names.inputs}
    unknown = es.Prior(np.zeros(2), np.zeros((2, 2)), diffuse=np.eye(2))
    found = []
    for k in rows:
        cut = slice(k - LENGTH + 1, k + 1)
        record = es.Record(items.y[0, cut], items.u[0, cut], dt=1 / f16.RATE, **names)
        found.append(es.estimate(algorithm, record, prior=unknown, engine="xla").gain[-1, 0])
    return rows, np.array(found)
