"""The errors of `fit_noise` on short records: the variance of its estimates over what it reports, and the coverage of 95 %."""

import argparse

import numpy as np

import estimable as es
from estimable.frozen import replace

TRUE = es.StateSpace([[0.9]], Q=[[0.2]], R=[[0.5]], dt=1)
PRIOR = es.Prior([0.0], [[1.0]])


def figure(draws, rows=150):
    """(variance of the estimates over the mean reported one, coverage of ±1.96 sigma), each of (Q, R)."""
    start = es.Kalman(replace(TRUE, Q=np.array([[1.0]]), R=np.array([[1.0]])))
    fits = []
    for seed in range(draws):
        fit = es.fit_noise(start, es.simulate(TRUE, seed=seed, steps=rows).record, prior=PRIOR)
        if not fit.at_zero:
            fits.append((fit.parameters, fit.sigma))
    found, sigma = map(np.array, zip(*fits, strict=True))
    covered = np.abs(found - [TRUE.Q[0, 0], TRUE.R[0, 0]]) < 1.96 * sigma
    return len(fits), np.var(found, axis=0) / np.mean(sigma**2, axis=0), covered.mean(axis=0)


def main():
    """Print the figure."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--draws", type=int, default=4000)
    count, ratio, coverage = figure(options.parse_args().draws)
    print(f"{count} fits with both variances above zero")
    for name, r, c in zip("QR", ratio, coverage, strict=True):
        print(f"{name}: variance of the estimates {r:.2f} of the reported one; 95 % intervals cover {100 * c:.1f} %")


if __name__ == "__main__":
    main()
