"""Stated over actual variance of the Markov parameters of subspace fits and of OKID."""

import argparse

import numpy as np
from scipy.signal import lfilter

import estimable as es

A, B = [1.0, -1.2, 0.5], [0.0, 1.0, 0.4]
METHODS = {
    "moesp": es.Subspace(2, feedthrough=False), "n4sid": es.Subspace(2, weighting="n4sid", feedthrough=False),
    "cva": es.Subspace(2, weighting="cva", feedthrough=False), "OKID": es.MarkovParameters(5, weighting="observer", observer=8),
    "Ho-Kalman, OKID": es.HoKalman(2, weighting="observer"),
}  # fmt: skip


def drawn(seed, rows=1000, pole=0.0):
    """White input, and noise of standard deviation .5 on the output, an autoregression with this pole."""
    g = np.random.default_rng(seed)
    u = g.normal(size=rows)
    v = lfilter([0.5 * np.sqrt(1 - pole**2)], [1, -pole], g.normal(size=rows + 100))[100:]
    return es.Record(lfilter(B, A, u) + v, u, dt=1)


def ratios(method, draws, pole=0.0):
    """Mean stated variance over the mean square error about the mean, of M_1 to M_4."""
    fits = [method.fit([drawn(seed, pole=pole)]) for seed in range(draws)]
    θ = np.array([fit.parameters[1:5] for fit in fits])
    stated = np.mean([np.diag(fit.covariance)[1:5] for fit in fits], axis=0)
    return stated / np.var(θ, axis=0, ddof=1)


def main():
    """Print the figures."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--draws", type=int, default=400)
    draws = options.parse_args().draws
    for pole in (0.0, 0.8):
        for name, method in METHODS.items():
            print(
                f"noise pole {pole}: {name:16} stated over actual variance {ratios(method, draws, pole).round(2)}",
                flush=True,
            )


if __name__ == "__main__":
    main()
