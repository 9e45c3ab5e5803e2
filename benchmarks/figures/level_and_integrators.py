"""Fits of plants in absolute units that begin away from rest, of drifting ones, and of integrators."""

import argparse

import numpy as np
from scipy.signal import lfilter

import estimable as es

A, B, GAIN = [1.0, -1.7, 0.72], [0.0, 0.03, 0.02], 2.5


def about_a_level(seed, rows, slope=0.0):
    """An input about 20 that is held 20 rows, the plant far from rest, an output level of 5."""
    g = np.random.default_rng(seed)
    u = 20 + np.repeat(g.normal(size=rows // 20 + 1), 20)[:rows]
    y = 5 + slope * np.arange(rows) + lfilter(B, A, u) + 0.2 * g.normal(size=rows)
    return es.Record(y, u, dt=1)


def gain_of(fit):
    """The static gain and its standard deviation."""
    at_one, b = 1 + fit.model.a[0].sum(), fit.model.b[0, 0]
    gain = b.sum() / at_one
    slope = np.r_[np.full(fit.model.na, -gain), np.ones(len(b))] / at_one
    return gain, np.sqrt(slope @ fit.covariance @ slope)


def gains(draws, rows, slope=0.0, **settings):
    """Relative errors of the static gain, and errors over standard deviations."""
    method = es.OutputErrorML(2, 1, delay=1, **settings)
    found = np.array([gain_of(method.fit([about_a_level(seed, rows, slope)])) for seed in range(draws)])
    return np.abs(found[:, 0] / GAIN - 1), (found[:, 0] - GAIN) / found[:, 1]


def integrator(seed, rows, pole=1.0):
    """y[k] = pole y[k-1] + .1 u[k-1], u +-1 held 2, sensor noise .05, a level of 3."""
    g = np.random.default_rng(seed)
    u = g.choice([-1.0, 1.0], size=(rows + 1) // 2).repeat(2)[:rows]
    return es.Record(3 + lfilter([0, 0.1], [1, -pole], u) + 0.05 * g.normal(size=rows), u, dt=1)


def integrated(draws, rows, pole=1.0):
    """Poles and errors of b (draws, 2) of OE(1, 0, delay 1)."""
    fits = [es.OutputErrorML(1, 0, delay=1).fit([integrator(seed, rows, pole)]) for seed in range(draws)]
    return np.array([[-fit.parameters[0], fit.parameters[1] - 0.1] for fit in fits])


def main():
    """Print the figures."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--draws", type=int, default=24)
    draws = options.parse_args().draws
    for rows in (400, 1500):
        for name, slope, settings in (
            ("level and start estimated", 0.0, {}), ("trend estimated, drift .02", 0.02, {"level": "trend"}),
            ("from rest, no level", 0.0, {"level": "none", "initial": "rest"}),
        ):  # fmt: skip
            errors, z = gains(draws, rows, slope, **settings)
            print(
                f"T {rows:5} {name:28} static gain: error {100 * np.median(errors):.2f} % (worst {100 * errors.max():.2f} %), "
                f"rms z {np.sqrt(np.mean(z**2)):.2f}"
            )
    for rows in (300, 1000, 4000):
        found = integrated(draws, rows)
        ones, error = np.mean(found[:, 0] == 1), np.sqrt(np.mean(found[:, 1] ** 2))
        print(f"T {rows:5} integrator: poles fixed at 1 in {ones:.2f}, rms error of b {error:.2g}")
    found = integrated(draws, 1000, 0.995)
    print(f"T  1000 pole .995: fixed at 1 in {np.mean(found[:, 0] == 1):.2f}, mean pole {found[:, 0].mean():.5f}")


if __name__ == "__main__":
    main()
