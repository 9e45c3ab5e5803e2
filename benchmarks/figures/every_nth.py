"""Outputs that are seen at every n-th row: models that fit as well, and whether the fit says so."""

import argparse

import numpy as np
from scipy.signal import lfilter

import estimable as es

CASES = {
    "pole .8, N 2": ([1, -0.8], [0, 0.5], 2), "pole .8, N 3": ([1, -0.8], [0, 0.5], 3),
    "poles .6+-.37i, N 2": ([1, -1.2, 0.5], [0, 1.0, 0.4], 2), "poles .8, .5, N 2": ([1, -1.3, 0.4], [0, 1.0, 0.4], 2),
}  # fmt: skip


def drawn(seed, case, held=None, between=0.0, rows=1200):
    """An input held N rows in phase with the seen ones (or `held` rows), noise .1, and a share of the other rows seen."""
    a, b, every = CASES[case]
    g = np.random.default_rng(seed)
    u = np.repeat(g.normal(size=rows), held or every)[:rows]
    y = lfilter(b, a, u) + 0.1 * g.normal(size=rows)
    seen = (np.arange(rows) % every == 0) | (g.random(rows) < between)
    return es.Record(np.where(seen, y, np.nan), u, dt=1)


def found(seed, case, **settings):
    """The number of rivals, and whether the fit is right within 4 sigma."""
    a, b, _ = CASES[case]
    fit = es.identify(es.OutputErrorML(len(a) - 1, len(b) - 2, delay=1), drawn(seed, case, **settings))
    right = np.all(np.abs(fit.parameters - np.r_[a[1:], b[1:]]) < 4 * fit.sigma)
    return 0 if fit.rivals is None else len(fit.rivals), bool(right)


def main():
    """Print the figures."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--draws", type=int, default=20)
    draws = options.parse_args().draws
    for case in CASES:
        for name, settings in (
            ("held", {}),
            ("fast input", {"held": 1}),
            ("2 % of the rows between", {"between": 0.02}),
        ):
            counts, right = zip(*(found(seed, case, **settings) for seed in range(draws)), strict=True)
            print(
                f"{case:20} {name:24} rivals in {np.mean(np.sign(counts)):.2f} (most {max(counts)}), right {np.mean(right):.2f}"
            )


if __name__ == "__main__":
    main()
