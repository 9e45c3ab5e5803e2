"""The lateral F-16 whose aileron and rudder fail together, one by one, or not: alarms, and the errors of both gains."""

import argparse

import numpy as np

import estimable as es
from benchmarks.figures.f16_loop import replace, rms

DT, SECONDS, ONSET = 0.02, 20.0, 8.0  # [s]
GAIN, START = es.Prior([1.0, 1.0], 0.25 * np.eye(2)), es.Prior(np.zeros(4), np.zeros((4, 4)))
Q = np.diag([1e-3, 0.0, 0.1, 0.1])  # density per second
CASES = {
    "both to .8": ((ONSET, 0.8), (ONSET, 0.8)), "both to .9": ((ONSET, 0.9), (ONSET, 0.9)),
    "to .9 and .5": ((ONSET, 0.9), (ONSET, 0.5)), "one after the other to .8": ((6.0, 0.8), (13.0, 0.8)), "healthy": (),
}  # fmt: skip


def flights(draws, changes, seed):
    """Records of flights under square waves of 2 and 3 deg. The i-th gain takes its value of `changes` at its time."""
    t = np.arange(round(SECONDS / DT)) * DT
    deflection = np.stack([2 * np.sign(np.sin(2 * np.pi * t / 3)), 3 * np.sign(np.sin(2 * np.pi * t / 4))], axis=1)
    gains = np.ones_like(deflection)
    for i, (time, value) in enumerate(changes):
        gains[t >= time, i] = value
    bank = es.simulate_bank(es.plants.f16_lateral(Q=Q), gains * deflection, t=t, seed=seed, runs=draws)
    record = bank.items.record
    return es.results.Stacked(replace(record, u=np.broadcast_to(deflection, record.u.shape)), draws), gains[-1]


def figure(draws, changes, seed=1):
    """rms z of each gain by the printed interval, alarms a flight, and the median delay after the first onset [s]."""
    records, truth = flights(draws, changes, seed)
    detector = es.ChangeDetection(es.UnknownGain(es.plants.f16_lateral(Q=Q), GAIN, directions="per_input"))
    bank = es.estimate_bank(detector, records, prior=START)
    low, _, median, _, high = np.moveaxis(bank.gain_quantiles[:, -1], -1, 0)
    z = (median - truth) / ((high - low) / 2 / 1.959964)
    alarm = bank.extra["alarm"]
    first = np.where(alarm.any(axis=1), np.argmax(alarm, axis=1) * DT, np.inf)
    onset = min((time for time, _ in changes), default=0.0)
    return [rms(one) for one in z.T], float(alarm.sum(axis=1).mean()), float(np.median(first)) - onset


def main():
    """Print the figures."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--draws", type=int, default=40)
    draws = options.parse_args().draws
    for name, changes in CASES.items():
        z, alarms, delay = figure(draws, changes)
        print(f"{name:26s} rms z {z[0]:.2f} {z[1]:.2f}  alarms a flight {alarms:.2f}  median delay {delay:.2f} s")


if __name__ == "__main__":
    main()
