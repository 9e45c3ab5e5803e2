"""The printed interval of the gain where it jumps, drifts or stays: coverage and width, and the delay of detection."""

import argparse

import numpy as np

import estimable as es
from benchmarks.figures.f16_loop import GAIN, START, covered, fly, gains, model, rms, standing
from estimable.filters.mixture import SHARES, WALKS

KEPT = 100  # flights in memory at a time
GRAIN = 500  # steps of a drift, per unit of gain


def drift(after):
    """From 1 to `after`, linearly over the flight, in small steps."""
    return lambda t: np.round((1 + (after - 1) * t / t[-1]) * GRAIN) / GRAIN


def jump(time, after):
    """From 1 to `after` at a time."""
    return lambda t: gains(t, (time, after))


CASES = {
    "no change": None, ".9 at 4.5 s": jump(4.5, 0.9), ".95 at 9 s": jump(9.0, 0.95), ".98 at 9 s": jump(9.0, 0.98),
    ".9 at 9 s": jump(9.0, 0.9), ".5 at 4.5 s": jump(4.5, 0.5), "drift 1 to .9": drift(0.9), "drift 1 to .5": drift(0.5),
}  # fmt: skip


def detector(walk=0.0, **settings):
    """The default detector, between whose jumps the gain walks."""
    return es.ChangeDetection(es.UnknownGain(model(), GAIN), walk=walk, **settings)


def mixture():
    """The detectors of three walks."""
    return es.Mixture([detector(walk) for walk in WALKS], probability=SHARES)


def figure(draws, cases=CASES, amp=3.0, seed=1):
    """Of each case: coverage of the 95 % interval at the end, its median width over 3.92, rms z, and the number of alarms."""
    found = {}
    for name, gain in cases.items():
        records, truth = fly(draws, seed, amp=amp, gain=gain)
        bank = es.estimate_bank(mixture(), es.stack(records), prior=START)
        z, sigma = standing(bank, truth[-1])
        found[name] = covered(bank, truth[-1]), float(np.median(sigma)), rms(z), int(bank.extra["alarm"].sum())
    return found


def delay(draws, after, seed=2):
    """The median delay of detection of a jump at 4.5 s under the standard command [s]."""
    records, _ = fly(draws, seed, amp=10.0, seconds=7.0, gain=jump(4.5, after))
    bank = es.estimate_bank(detector(), es.stack(records), prior=START)
    late = bank.extra["alarm"][:, 450:]
    return float(np.median(np.where(late.any(axis=1), np.argmax(late, axis=1) / 100, np.inf)))


def cut(flights, seed=4, algorithm=None):
    """Coverage of the 95 % interval at a uniform moment after 2 s of each flight.

    Commands are log-uniform from 1 to 10 deg/s. The gain drops to one of 1, .9, .8, .6, .4 at 4.5 s.
    `algorithm`: default the mixture of walks.
    """
    algorithm = mixture() if algorithm is None else algorithm
    rng, held = np.random.default_rng(seed), []
    for part in range(-(-flights // KEPT)):
        draws = min(KEPT, flights - part * KEPT)
        amp, K = np.exp(rng.uniform(0, np.log(10), size=draws)), rng.choice([1, 0.9, 0.8, 0.6, 0.4], size=draws)
        records, truth = fly(draws, [seed, part], amp=amp, gain=lambda t, K=K: np.where(t[:, None] >= 4.5, K, 1.0))
        bank = es.estimate_bank(algorithm, es.stack(records), prior=START)
        row = rng.integers(200, len(truth), size=draws), np.arange(draws)
        low, high = bank.gain_quantiles[row[1], row[0], 0][:, [0, 4]].T
        held.append((low <= truth[row]) & (truth[row] <= high))
    return float(np.concatenate(held).mean())


def main():
    """Print the figures."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--draws", type=int, default=400)
    draws = options.parse_args().draws
    for name, (coverage, width, z, alarms) in figure(draws).items():
        print(f"{name:14s} coverage {coverage:.3f}  width/3.92 {width:.4f}  rms z {z:.2f}  alarms {alarms}")
    print(f"cut at uniform moments: coverage {cut(3 * draws // 2):.3f}")
    for after in (0.5, 0.8):
        print(f"K -> {after}: median delay {delay(draws, after):.3f} s")


if __name__ == "__main__":
    main()
