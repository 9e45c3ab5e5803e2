"""JointOutputError without a prior, on outputs that are seen at every n-th row or at random: relative errors and z."""

import argparse

import numpy as np
from scipy.signal import lfilter

import estimable as es

PLANTS = {
    "poles -.26+-.53i": ([1, 0.523, 0.349], [0.44, 0.762]), "poles .6+-.37i": ([1, -1.2, 0.5], [1.0, 0.4]),
    "poles .9, .8": ([1, -1.7, 0.72], [1.0, 0.4]), "poles .9, -.9": ([1, 0.0, -0.81], [1.0, 0.4]),
}  # fmt: skip
PATTERNS = {"every 2nd": 2, "every 5th": 5, "random 10 %": 0}


def drawn(seed, plant, every, rows=4000):
    """Uniform input of variance 1; noise of 30 % of the output without it."""
    a, b = PLANTS[plant]
    g = np.random.default_rng(seed)
    u = g.uniform(-(3**0.5), 3**0.5, rows)
    x = lfilter(b, a, u)
    r = 0.09 * np.var(x)
    seen = g.random(rows) < 0.1 if every == 0 else np.arange(rows) % every == 0
    return es.Record(np.where(seen, x + r**0.5 * g.normal(size=rows), np.nan), u, dt=1), r


def found(seed, plant, every, rows=4000):
    """The relative error, the largest |z|, and whether the validation passed."""
    record, r = drawn(seed, plant, every, rows)
    fit = es.identify(es.JointOutputError(2, 1, noise_variance=r), record)
    true = np.r_[PLANTS[plant][0][1:], PLANTS[plant][1]]
    error = fit.parameters - true
    return np.linalg.norm(error) / np.linalg.norm(true), np.abs(error / fit.sigma).max(), fit.validation.passed


def main():
    """Print the figures."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--draws", type=int, default=6)
    options.add_argument("--rows", type=int, default=4000)
    given = options.parse_args()
    for plant in PLANTS:
        for name, every in PATTERNS.items():
            errors, z, passed = zip(
                *(found(seed, plant, every, given.rows) for seed in range(given.draws)), strict=True
            )
            print(
                f"{plant:18} {name:12} error: median {100 * np.median(errors):.1f} %, worst {100 * max(errors):.1f} %; "
                f"largest |z| {max(z):.1f}; passed {np.mean(passed):.2f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
