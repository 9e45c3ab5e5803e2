"""The test of feedback: false alarms in open loop and power in closed loops; and the pole and gain found in a loop.

Open loop: y = x + v of x+ = .9 x + u, or process noise on the plant (0, .3, .2)/(1, -1.2, .5), inputs of many kinds. Closed:
u[k] = -k y[k] + r[k] with x+ = a x + u.
"""

import argparse

import numpy as np
from scipy.signal import lfilter

import estimable as es

SLOW, SECOND = ([0, 1.0], [1, -0.9]), ([0, 0.3, 0.2], [1, -1.2, 0.5])


def held(g, T, length, *, binary):
    """Levels that change every `length` rows."""
    levels = g.choice([-1.0, 1.0], size=T // length + 1) if binary else g.normal(size=T // length + 1)
    return levels.repeat(length)[:T]


def lines(g, T):
    """Nineteen sinusoids."""
    k = np.arange(T)
    return sum(np.cos(2 * np.pi * (i + 1) * k / 200 + g.uniform(0, 2 * np.pi)) for i in range(19)) / 4


def sweep(g, T, low=0.02, high=1.2):
    """A logarithmic sweep, in radians per row."""
    rate = np.log(high / low)
    return np.sin(low * T / rate * (np.exp(np.arange(T) / (T - 1) * rate) - 1))


def manoeuvres(g, T):
    """Two 3-2-1-1 manoeuvres."""
    u = np.zeros(T)
    for start in (T // 4, 5 * T // 8):
        edges = start + np.cumsum([0, T // 30, T // 45, T // 90, T // 90])
        for i, sign in enumerate((1, -1, 1, -1)):
            u[edges[i] : edges[i + 1]] = sign
    return u


INPUTS = {
    "white": lambda g, T: g.normal(size=T),
    "AR(.95)": lambda g, T: lfilter([1], [1, -0.95], g.normal(size=T + 200))[200:],
    "binary held 10": lambda g, T: held(g, T, 10, binary=True),
    "19 lines": lines,
    "walk": lambda g, T: 0.1 * np.cumsum(g.normal(size=T)),
    "steps of 50": lambda g, T: held(g, T, 50, binary=False),
    "binary held 25": lambda g, T: held(g, T, 25, binary=True),
    "sweep": sweep,
    "3-2-1-1": manoeuvres,
}


def open_loop(kind, T, seed, *, plant=SLOW, noise="sensor"):
    """A record in which the input does not depend on the output."""
    g = np.random.default_rng(seed)
    u = INPUTS[kind](g, T)
    x, v = lfilter(*plant, u), g.normal(size=T)
    size = 0.3 * np.std(x)
    return es.Record(x + size * (v if noise == "sensor" else 0.5 * lfilter([1], plant[1], v)), u, dt=1)


def closed_loop(T, seed, *, k=0.4, a=0.9, sd=0.5, noise="sensor", held=1, late=0):
    """A record in which u[k] = -k y[k - late] + r[k]."""
    g = np.random.default_rng(seed)
    x, r, y, u = 0.0, 0.0, np.zeros(T), np.zeros(T)
    for i in range(T):
        if i % held == 0:
            r = 0.5 * g.normal()
        y[i] = x + (sd * g.normal() if noise == "sensor" else 0.0)
        u[i] = -k * y[max(i - late, 0)] + r
        x = a * x + u[i] + (0.0 if noise == "sensor" else sd * g.normal())
    return es.Record(y, u, dt=1)


def alarms(records, direct):
    """The share of records in which feedback is seen."""
    return np.mean([es.diagnostics.feedback(one, direct=direct).closed for one in records])


def found(method, k, a, noise, draws, T=2000):
    """Bias and spread of pole and gain (2,), and the rms z of the pole."""
    rows = []
    for seed in range(draws):
        fit = es.identify(method, closed_loop(T, seed, k=k, a=a, noise=noise))
        arx = isinstance(method, es.PredictionError)
        pole = -fit.parameters[0] if arx else fit.model.A[0, 0]
        gain = fit.parameters[1] if arx else (fit.model.C @ fit.model.B)[0, 0]
        sigma = fit.sigma[0] if arx else np.sqrt(es.diagnostics.poles(fit).covariance[0, 0, 0])
        rows.append((pole - a, gain - 1, (pole - a) / sigma))
    return np.mean(rows, axis=0)[:2], np.std(rows, axis=0)[:2], np.sqrt(np.mean(np.square(rows), axis=0))[2]


def main():
    """Print the tables."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--draws", type=int, default=200)
    draws = options.parse_args().draws
    for T in (200, 1000):
        for kind in INPUTS:
            sets = ((SLOW, "sensor", False), (SECOND, "process", False), ((SLOW[0][1:], SLOW[1]), "sensor", True))
            rates = [
                alarms((open_loop(kind, T, seed, plant=plant, noise=noise) for seed in range(draws)), direct)
                for plant, noise, direct in sets
            ]
            print(f"open   {T:5d} {kind:15s} {rates[0]:.3f} {rates[1]:.3f}, direct {rates[2]:.3f}", flush=True)
    loops = ({"k": 0.4}, {"k": 0.1}, {"k": 0.05}, {"sd": 0.05}, {"noise": "process", "held": 20, "late": 1})
    for settings in loops:
        for T in (200, 1000):
            rate = alarms((closed_loop(T, seed, **settings) for seed in range(draws)), False)
            print(f"closed {T:5d} {settings} {rate:.3f}", flush=True)
    for k, a in ((0.4, 0.9), (0.7, 1.1), (0.0, 0.9)):
        for noise in ("sensor", "process"):
            methods = (
                es.PredictionError(1, 0, 1, delay=1),
                es.PredictorSubspace(1),
                es.PredictorSubspace(1, weighting="pbsid"),
            )
            for method in methods:
                bias, sd, z = found(method, k, a, noise, draws // 5)
                print(
                    f"pole {a}, k {k}, {noise:8s} {method.label:24s} bias {bias.round(4)} sd {sd.round(4)} rms z {z:.2f}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
