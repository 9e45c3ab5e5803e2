"""Identification with 30 % of the rows dropped: bias and rms z of OE(1, 0, delay 1) with inputs held 20, 5 and 1 rows.

And the speed of a grid: a million rows of eight channels.
"""

import argparse
import time

import numpy as np

import estimable as es

PLANT = es.OutputError([-0.8], [0.2], delay=1, noise_variance=0.01, dt=0.1)


def drawn(seed, held, rows=1000, dropped=0.3):
    """The record of the rows that were not dropped."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.normal(size=rows // held + 1), held)[:rows]
    y = PLANT.response(u[:, None])[:, 0] + 0.1 * rng.normal(size=rows)
    left = rng.random(rows) >= dropped
    left[0] = True
    return es.Record(y[left], u[left], t=0.1 * np.flatnonzero(left))


def figure(draws, held):
    """Bias of (a1, b0), its standard error, and rms z."""
    fits = [es.identify(es.OutputErrorML(1, 0, delay=1), drawn(seed, held)) for seed in range(draws)]
    error = np.array([fit.parameters - PLANT.parameters for fit in fits])
    z = error / np.array([fit.sigma for fit in fits])
    return error.mean(axis=0), error.std(axis=0) / np.sqrt(draws), np.sqrt(np.mean(z**2, axis=0))


def seconds(rows=1_000_000):
    """Wall and processor seconds for eight channels of two topics on one grid."""
    rng = np.random.default_rng(0)

    def topic(name):
        ticks = np.cumsum(rng.integers(3500, 4500, rows))
        return es.Topic(name, ticks, 1e-6, {f"{name}{i}": rng.normal(size=rows) for i in range(4)})

    log = es.Log([topic("y"), topic("u")])
    begun = time.perf_counter(), time.process_time()
    log.record(outputs=[f"y{i}" for i in range(4)], inputs=[f"u{i}" for i in range(4)], grid=0.004)
    return time.perf_counter() - begun[0], time.process_time() - begun[1]


def main():
    """Print the figures."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--draws", type=int, default=100)
    draws = options.parse_args().draws
    for held in (20, 5, 1):
        bias, error, z = figure(draws, held)
        print(f"u held {held}: bias {bias.round(5)} ± {error.round(5)}, rms z {z.round(2)}")
    wall, processor = seconds()
    print(f"1e6 rows x 8 channels onto a grid: {wall:.2f} s, {processor:.2f} s of processor time")


if __name__ == "__main__":
    main()
