"""How `compare` judges: whole other records, series without inputs, slow plants that start away from rest, and loops of
orders 2 to 4.

- Whole: fitted to one record and judged on two others, plant (0, .3, .2)/(1, -1.2, .5), noise of half the spread. Equal models
  must be alike, a model of another input must explain nothing.
- Series: AR(1), ARMA(2, 1) and white noise of 400 rows.
- Heating: time constants of 25 and 150 rows, an input that moves every 40 rows, 800 rows, levels, started away from rest.
- Loops: plants of order 2 to 4 with poles of modulus .6 to .85 under u[k] = -.3 y[k] + r[k].
"""

import argparse
import time

import numpy as np
from scipy.signal import lfilter

import estimable as es

SECOND = ([0, 0.3, 0.2], [1, -1.2, 0.5])


def of_plant(seed, rows, held=1):
    """A record of the plant of order 2, with the seed's own level."""
    g = np.random.default_rng(seed)
    u = np.repeat(g.normal(size=-(-rows // held)), held)[:rows]
    x = lfilter(*SECOND, u)
    return es.Record(x + 0.5 * np.std(x) * g.normal(size=rows) + g.normal(), u, dt=1)


def whole(seed, rows, held):
    """Whether equal models are alike on two whole records, and whether a model of another input explains them."""
    one, *others = (of_plant(3 * seed + i, rows, held) for i in range(3))
    same = [es.OutputErrorML(2, 1, delay=1), es.PredictionError(2, 1, 2, delay=1)]
    found = es.compare(same, one, held_out=others)
    strange = [
        es.Record(r.y, of_plant(90_000 + 3 * seed + i, rows, held).u, dt=1) for i, r in enumerate((one, *others))
    ]
    wrong = es.compare([es.OutputErrorML(2, 1, delay=1)], strange[0], held_out=strange[1:])
    return found.best is not None, all(r.alike for r in found.ranked), wrong.best is not None


def series(seed, kind, rows=400):
    """Whether a series is explained one step ahead, and its fit less the best possible."""
    e = np.random.default_rng(seed).normal(size=rows)
    b, a = {"AR(1)": ([1.0], [1, -0.8]), "ARMA(2, 1)": ([1, 0.5], [1, -1.5, 0.7]), "white": ([1.0], [1.0])}[kind]
    y = lfilter(b, a, e)
    found = es.compare(None, es.Record(y, dt=1))
    half = slice(rows // 2, None)
    most = 100 * (1 - np.linalg.norm(e[half]) / np.linalg.norm(y[half] - y[half].mean()))
    return found.best is not None, found.ranked[0].fit_percent - most


def heating(seed, rows=800):
    """A slow plant with levels that starts away from rest, as a heated room or two tanks."""
    g = np.random.default_rng(seed)
    u = 20 + np.repeat(5 * g.normal(size=-(-rows // 40)), 40)[:rows]
    fast, slow, y = np.exp(-1 / 25), np.exp(-1 / 150), np.zeros(rows)
    x = np.array([30.0, 60.0]) + 10 * g.normal(size=2)
    for k in range(rows):
        y[k] = x[1] + 0.5 * g.normal()
        x = np.array([fast * x[0] + (1 - fast) * 2.5 * u[k], slow * x[1] + (1 - slow) * x[0]])
    return es.Record(y, u, dt=10.0)


def of_heating(seed):
    """The held-out fit of `compare`, and the largest pole of the best model."""
    found = es.compare(None, heating(seed))
    best = found.best
    return np.nan if best is None else best.fit_percent, np.nan if best is None else np.abs(
        np.linalg.eigvals(best.model.A)
    ).max()


def loop(seed, n, rows=2000, k=0.3):
    """A loop about a plant of order n, and its poles."""
    g = np.random.default_rng(seed)
    pairs = [0.85 * np.exp(0.5j), 0.75 * np.exp(1.2j)][: n // 2]
    poles = np.array([*pairs, *np.conj(pairs), *([0.6] if n % 2 else [])])
    A = np.zeros((n, n))
    A[0], A[1:, :-1] = -np.poly(poles)[1:].real, np.eye(n - 1)
    B, C = np.eye(n)[:, :1], np.array([[0.2, 0.1, 0.1, 0.05][:n]])
    x, y, u = np.zeros((n, 1)), np.zeros(rows), np.zeros(rows)
    for i in range(rows):
        y[i] = (C @ x).item() + 0.2 * g.normal()
        u[i] = -k * y[i] + g.normal()
        x = A @ x + B * u[i]
    return es.Record(y, u, dt=1), poles


def of_loop(seed, n, weighting):
    """The error of the poles (rms of their distances), and of the static gain in per cent."""
    record, poles = loop(seed, n)
    model = es.identify(es.PredictorSubspace(n, weighting=weighting, blocks=0), record).model
    found = np.linalg.eigvals(model.A)
    off = np.sqrt(np.mean([np.min(np.abs(found - z)) ** 2 for z in poles]))
    gain = (model.C @ np.linalg.solve(np.eye(n) - model.A, model.B)).item()
    right = sum([0.2, 0.1, 0.1, 0.05][:n]) / np.poly(poles).real.sum()
    return off, 100 * (gain / right - 1)


def main():
    """Print the tables."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--draws", type=int, default=40)
    draws, start = options.parse_args().draws, time.time()
    for rows, held in ((300, 1), (1000, 1), (300, 25), (1000, 25)):
        right, alike, wrong = np.mean([whole(seed, rows, held) for seed in range(draws)], axis=0)
        print(
            f"whole {rows:5d} held {held:2d}: explained {right:.2f}, alike {alike:.2f}, another input {wrong:.3f}",
            flush=True,
        )
    for kind in ("AR(1)", "ARMA(2, 1)", "white"):
        seen, off = np.mean([series(seed, kind) for seed in range(draws)], axis=0)
        print(f"series {kind:10s}: explained {seen:.2f}, fit less the best possible {off:+.2f} points", flush=True)
    for n in (2, 3, 4):
        for weighting in ("ssarx", "pbsid"):
            off, gain = np.transpose([of_loop(seed, n, weighting) for seed in range(draws)])
            print(
                f"loop of order {n}, {weighting}: poles rms {off.mean():.4f}, gain {gain.mean():+.2f} +- {gain.std():.2f} %",
                flush=True,
            )
    fits, poles = np.transpose([of_heating(seed) for seed in range(max(draws // 3, 4))])
    print(f"heating: fit median {np.nanmedian(fits):.1f}, least {np.nanmin(fits):.1f} %, largest pole {np.nanmax(poles):.5f}, "
          f"unexplained {np.isnan(fits).mean():.2f}")  # fmt: skip
    print(f"{time.time() - start:.0f} s")


if __name__ == "__main__":
    main()
