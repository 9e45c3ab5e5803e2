"""A quadrotor's log at 250 Hz: nonlinear flight, vibration, a model whose B is wrong by 10 %, and .4 s missing.

The whole chain (`assess_gain`) must find no change, and its intervals must hold the true effectiveness of each motor.
"""

import argparse

import numpy as np

import estimable as es
from benchmarks.figures.f16_loop import replace
from estimable.plants import multirotors, worlds

DT, ROWS = 0.004, 5000
SHARE, MISSING = 0.1, slice(2200, 2300)  # of the entries of B; rows
SENSORS = 4  # gyros and accelerometer


def flown(seed, changes=(), rows=ROWS):
    """The record of a flight: rates, specific force, and the thrusts [N]."""
    world, frame, model = worlds.multirotor_world(), multirotors.frame(4), multirotors.flight(4)
    R = np.array(model.R)
    R[SENSORS - 1] /= 2  # the other half of the accelerometer's variance is vibration
    plant = es.plants.NonlinearPlant(
        replace(model, R=R), np.zeros(12), frame.hover, actuator=1 / multirotors.TIME_CONSTANT, changes=changes, noisy=True,
        limits=[0.0, multirotors.MAX_THRUST],
    )  # fmt: skip
    law = replace(world.controller, operating_point=None)
    known = replace(world.estimator, model=replace(world.estimator.model, operating_point=None))
    loop = es.close_loop(plant, law, known, reference=world.reference[:rows], seed=seed, prior=world.prior, dt=DT)
    thrust, y = loop.known_input + frame.hover, loop.output[:, :SENSORS].copy()
    y[:, -1] += multirotors.GRAVITY + vibration(thrust, seed)
    y[MISSING], thrust[MISSING] = np.nan, np.nan
    return es.Record(y, thrust, dt=DT, hold="first_order", outputs=multirotors.OUTPUTS, inputs=frame.names)


def vibration(thrust, seed):
    """A line of the accelerometer at the speed of each rotor [m/s²]."""
    phase = np.random.default_rng(seed).uniform(0, 2 * np.pi, size=thrust.shape[1])
    phase = phase + DT * np.cumsum(np.sqrt(np.maximum(thrust, 0) / multirotors.THRUST_COEFFICIENT), axis=0)
    return multirotors.ACCELEROMETER_SIGMA / np.sqrt(thrust.shape[1]) * np.cos(phase).sum(axis=1)


def assessed(seed, changes=(), rows=ROWS):
    """The whole chain on one flight, by a model whose B is wrong."""
    model, rng = es.plants.multirotor(4), np.random.default_rng(1000 + seed)
    wrong = replace(model, B=model.B * (1 + SHARE * rng.normal(size=model.B.shape)))
    gain = es.UnknownGain(wrong, es.Prior(np.ones(4), 0.25 * np.eye(4)), directions="per_input", feedthrough="scaled")
    prior = es.Prior(np.zeros(model.n), np.diag([1e-4] * 3 + [2.0, 2.0, 0.2, 0.2]))
    return es.assess_gain(gain, flown(seed, changes, rows), prior=prior)


def main():
    """Print each flight, and the counts."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--draws", type=int, default=10)
    draws = options.parse_args().draws
    for motor, after in ((None, 1.0), ("motor3", 0.7)):
        false = outside = 0
        for seed in range(draws):
            found = assessed(seed, () if motor is None else ((8.0, {motor: after}),))
            truth = np.array([after if name == motor else 1.0 for name in found.result.names.gains])
            low, _, median, _, high = found.result.gain_quantiles[-1].T
            changed = [one.sentence for one in es.diagnostics.changes(found.result)]
            false += any(one.gain != motor for one in es.diagnostics.changes(found.result))
            outside += int(((truth < low) | (truth > high)).sum())
            print(seed, found.trust.word, median.round(3), ((high - low) / 3.92).round(3), changed, flush=True)
        print(
            f"{motor or 'healthy'}: {false} of {draws} with a false change; {outside} of {4 * draws} intervals miss the truth"
        )


if __name__ == "__main__":
    main()
