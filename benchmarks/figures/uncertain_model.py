"""The gain after a known loss, by a filter of a wrong A and B: with and without their uncertainty."""

import argparse

import numpy as np

import estimable as es
from benchmarks.figures.f16_loop import GAIN, START, covered, fly, gains, model, rms, standing
from estimable.plants import f16

ONSET = 450  # row


def figure(draws, relative, amp, algorithm, seed=3):
    """rms z, median width / 3.92, the share beyond 3, and the coverage of the 95 % interval."""
    rng = np.random.default_rng(seed)
    A = f16.A * (1 + relative * rng.normal(size=(draws, 2, 2)))
    B = f16.B * (1 + relative * rng.normal(size=(draws, 2, 1)))
    records, truth = fly(draws, seed, amp=amp, gain=lambda t: gains(t, (4.5, 0.5)), A=A, B=B)
    bank = es.estimate_bank(algorithm, es.stack(records), prior=START)
    z, sigma = standing(bank, truth[-1])
    inside = covered(bank, truth[-1]) if bank.info.gain_quantiles is not None else float(np.mean(np.abs(z) < 1.96))
    return rms(z), float(np.median(sigma)), float(np.mean(np.abs(z) > 3)), inside


def main():
    """Print the table of the methods page."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--draws", type=int, default=200)
    draws = options.parse_args().draws
    for relative in (0.1, 0.2):
        filters = {"as given": None, "considered": es.ModelUncertainty(relative=relative)}
        for amp in (1.0, 10.0):
            for name, uncertainty in filters.items():
                watched = es.ChangeDetection(es.UnknownGain(model(), GAIN, uncertainty=uncertainty))
                z, width, beyond, inside = figure(draws, relative, amp, watched)
                print(f"{relative:.0%} {amp:2.0f} deg/s {name:11s} rms z {z:.2f} width/3.92 {width:.4f} beyond 3 {beyond:.2f} "
                      f"coverage {inside:.3f}")  # fmt: skip
            sure = es.Prior([1.0], [[0.0]])
            estimated = es.ModelUncertainty(relative=relative, treat="estimated")
            watched = es.ChangeDetection(es.UnknownGain(model(), sure, uncertainty=estimated), jump=0.25)
            z, width, beyond, inside = figure(draws, relative, amp, watched)
            print(f"{relative:.0%} {amp:2.0f} deg/s estimated   rms z {z:.2f} width/3.92 {width:.4f} beyond 3 {beyond:.2f} "
                  f"coverage {inside:.3f}")  # fmt: skip


if __name__ == "__main__":
    main()
