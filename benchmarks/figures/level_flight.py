"""The gain of a healthy aircraft in closed loop, by filters with right and wrong noise models."""

import argparse

import numpy as np

import estimable as es
from benchmarks.figures.f16_loop import GAIN, NONE, START, Q, fly, markov, model, rms, standing
from estimable import markov_disturbance

LASTING = 0.075, np.array([15.0, 15.0])  # time constant [s], and densities relative to Q
TRUTHS = {"white": NONE, "lasting for .075 s": markov(*LASTING)}
FILTERS = {
    "Q": model(), "15 Q": model(15.0),
    "lasting for .075 s": markov_disturbance(model(), time_constant=LASTING[0], density=LASTING[1] * np.diag(Q)),
}  # fmt: skip


def bank_of_noises(time_constants=(0.03, 0.1, 0.3, 1.0), densities=(1.0, 10.0, 40.0)):
    """Detectors with white noises, and with disturbances of each time constant, whose densities vary by themselves."""
    white = [model(scale) for scale in (0.3, 1.0, 3.0, 10.0)]
    lasting = [
        markov_disturbance(model(), time_constant=τ, density=np.array([a, b]) * np.diag(Q))
        for τ in time_constants for a in densities for b in densities
    ]  # fmt: skip
    return es.Mixture([es.UnknownGain(one, GAIN) for one in (*white, *lasting)])


def figure(draws, amp, truth, algorithm, *, seconds=30.0, seed=1):
    """Median estimate, median sigma, rms z, and the largest |z|."""
    records, gain = fly(draws, seed, amp=amp, seconds=seconds, disturbance=truth)
    bank = es.estimate_bank(algorithm, es.stack(records), prior=START)
    z, sigma = standing(bank, gain[-1])
    estimate = bank.gain[:, -1, 0] if bank.info.gain_quantiles is None else bank.info.gain_quantiles[:, -1, 0, 2]
    return float(np.median(estimate)), float(np.median(sigma)), rms(z), float(np.abs(z).max())


def main():
    """Print the table of the methods page, and the errors of a bank of noises."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--draws", type=int, default=200)
    draws = options.parse_args().draws
    for name, truth in TRUTHS.items():
        for amp in (0.0, 1.0):
            for filter, one in FILTERS.items():
                row = figure(draws, amp, truth, es.UnknownGain(one, GAIN))
                print(
                    f"{name:20s} {amp:3.0f} deg/s  filter: {filter:20s} {row[0]:.3f} ± {row[1]:.3f}  rms z {row[2]:.2f}"
                )
    bank = bank_of_noises()
    nodes = {"white": NONE} | {f"{τ} s": markov(τ, np.array([10.0, 10.0])) for τ in (0.03, 0.1, 0.3, 1.0)}
    between = {
        "between, .17 s on q alone": markov(0.17, np.array([0.0, 6.0])),
        "between, .55 s, 20 Q": markov(0.55, np.array([20.0, 20.0])),
    }
    for name, truth in (nodes | between).items():
        for amp in (0.0, 1.0):
            row = figure(min(draws, 50), amp, truth, bank, seconds=20.0, seed=2)
            print(
                f"bank; {name:26s} {amp:3.0f} deg/s  {row[0]:.3f} ± {row[1]:.3f}  rms z {row[2]:.2f}  largest {row[3]:.1f}"
            )


if __name__ == "__main__":
    main()
