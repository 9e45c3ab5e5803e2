"""Identification from stamps that scatter: OE(1, 0, delay 1) of time constant 5 steps, fitted on the grid and to the stamps."""

import argparse

import numpy as np
from scipy.linalg import expm

import estimable as es
from estimable.frozen import replace

STEP, TIME, GAIN, NOISE, ROWS = 0.1, 0.5, 3.0, 0.02, 800
POLE = np.exp(-STEP / TIME)
TRUTH = np.array([-POLE, GAIN * (1 - POLE)])


def drawn(seed, scatter, rows=ROWS):
    """A record of tau y' + y = K u, u held from stamp to stamp, whose stamps are uniform within `scatter` of a step."""
    rng = np.random.default_rng(seed)
    t = STEP * (np.arange(rows) + scatter * rng.uniform(-1, 1, rows))
    u = np.repeat(rng.normal(size=rows // 5 + 1), 5)[:rows]
    x, y = 0.0, []
    for k in range(rows):
        y.append(x)
        φ = np.exp(-(t[k + 1] - t[k]) / TIME) if k + 1 < rows else 1.0
        x = φ * x + (1 - φ) * GAIN * u[k]
    return es.Record(np.array(y) + NOISE * rng.normal(size=rows), u, t=t)


def second_order(seed, rows=400):
    """A record of a damped oscillation at stamps of a Poisson process, and the coefficients at its median step."""
    rng = np.random.default_rng(seed)
    A, B = np.array([[0.0, 1.0], [-4.0, -1.0]]), np.array([[0.0], [4.0]])
    t = np.cumsum(0.02 + rng.exponential(0.1, rows))
    u, x, y = np.sign(rng.normal(size=rows)), np.zeros(2), []
    for k in range(rows):
        y.append(x[0])
        if k + 1 < rows:
            x = _held(A, B, t[k + 1] - t[k]) @ np.append(x, u[k])
    record = es.Record(np.array(y) + NOISE * rng.normal(size=rows), u, t=t)
    step = float(f"{np.median(np.diff(t)):.9g}")
    F = _held(A, B, step)
    a = np.poly(F[:, :2])[1:]
    b = [F[0, 2], (F[:, :2] @ F[:, 2])[0] + a[0] * F[0, 2]]
    return record, np.concatenate([a, b])


def _held(A, B, h):
    """[F, G] of a step of h seconds with a constant input."""
    n, m = B.shape
    return expm(h * np.block([[A, B], [np.zeros((m, n + m))]]))[:n]


def errors(draws, scatter, grid, first=0):
    """z of the parameters of each draw (draws, 2); `grid`: the rows taken as a grid of equal steps."""
    found = []
    for seed in range(first, first + draws):
        record = drawn(seed, scatter)
        if grid:
            record = replace(record, t=STEP * np.arange(ROWS), dt=STEP)
        fit = es.identify(es.OutputErrorML(1, 0, delay=1), record)
        pole = np.exp(-fit.model.dt / TIME)  # of the median step
        found.append((fit.parameters - [-pole, GAIN * (1 - pole)]) / fit.sigma)
    return np.array(found)


def main():
    """Print the figures."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--draws", type=int, default=24)
    draws = options.parse_args().draws
    for scatter in (0.02, 0.05, 0.1, 0.2, 0.35, 0.5):
        z = [np.sqrt(np.mean(errors(draws, scatter, grid) ** 2, axis=0)) for grid in (True, False)]
        print(f"stamps within ±{scatter} of a step: rms z on a grid {z[0].round(2)}, at the stamps {z[1].round(2)}")
    pairs = [second_order(seed) for seed in range(draws)]
    fits = [es.identify(es.OutputErrorML(2, 1, delay=1), record) for record, _ in pairs]
    z = np.array([(fit.parameters - truth) / fit.sigma for fit, (_, truth) in zip(fits, pairs, strict=True)])
    print(f"second order, stamps of a Poisson process: rms z {np.sqrt(np.mean(z**2, axis=0)).round(2)}")


if __name__ == "__main__":
    main()
