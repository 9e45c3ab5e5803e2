"""How often `trust` warns of right models, and misses wrong ones, over a designed set of flights of the F-16 in closed loop.

A result counts as wrong where the gain is off by more than three of its standard deviations, by a detector of changes with the
model as given. Commands are log-uniform from .3 to 10 deg/s, the gain drops to one of 1, .9, .8, .6, .4 at 3 to 10 s.
"""

import argparse
import hashlib

import numpy as np

import estimable as es
from estimable.frozen import replace
from estimable.plants import f16

from .f16_loop import GAIN, START, fly, gains, model

LEVEL = 0.02


def scattered(M, share):
    """Entries off by a share, one standard deviation."""
    return lambda rng: (M * (1 + share * rng.normal(size=M.shape)))[None]


def late(rows):
    """A log whose input is late by some rows, or early where `rows` is negative."""

    def change(record, rng):
        u = record.u
        shifted = (
            np.concatenate([u[:1].repeat(rows, 0), u[:-rows]]) if rows > 0 else np.concatenate([u[-rows:], u[rows:]])
        )
        return replace(record, u=shifted[: len(u)])

    return change


def frozen(record, rng):
    """A sensor that stops in mid-record."""
    y, row, column = record.y.copy(), rng.integers(400, 1200), rng.integers(2)
    y[row:, column] = y[row, column]
    return replace(record, y=y)


def pushed(record, rng):
    """An offset of the measured input that begins in mid-record."""
    u = record.u.copy()
    u[rng.integers(400, 1200) :] += 0.3
    return replace(record, u=u)


def cases():
    """Name, the plant's own arguments for `fly`, the estimator's model, and what is done to the log."""
    plants = {
        "right": {},
        **{f"A off by {share:.0%}": {"A": scattered(f16.A, share)} for share in (0.02, 0.05, 0.1, 0.2)},
        **{f"Q x {factor}": {"white": factor} for factor in (0.07, 0.3, 3, 15)},
        **{f"lasting disturbance, {τ} s": {"markov": (τ, np.array([10.0, 10.0]))} for τ in (0.03, 0.1, 0.3, 1.0)},
        **{f"input off by {offset} deg": {"offset": offset} for offset in (0.05, 0.3, 1.0)},
        **{f"B off by {share:.0%} (cannot be tested)": {"B": scattered(f16.B, share)} for share in (0.05, 0.1, 0.2)},
        **{f"gain drifts by {by}": {"gain": lambda t, by=by: 1 - by * t / t[-1]} for by in (0.1, 0.3, 0.6)},
    }
    logs = {
        f"input {abs(rows) * 10} ms {'late' if rows > 0 else 'early'}": late(rows)
        for rows in (1, 2, 5, 10, -2, -5, -10)
    }
    logs |= {"frozen sensor": frozen, "offset in mid-record": pushed}
    return [
        *((name, settings, None, None) for name, settings in plants.items()),
        *((f"R x {factor}", {}, replace(model(), R=model().R / factor), None) for factor in (0.5, 1.5, 3)),
        *((name, {}, None, change) for name, change in logs.items()),
    ]


def drawn(name, i, settings, estimator, change):
    """(p-value of the verdict, z of the gain) of one flight."""
    seed = int.from_bytes(hashlib.sha256(f"{name}{i}".encode()).digest()[:4], "little")
    rng = np.random.default_rng(seed)
    amp, K, onset = (
        np.exp(rng.uniform(np.log(0.3), np.log(10))),
        rng.choice([1, 0.9, 0.8, 0.6, 0.4]),
        rng.uniform(3, 10),
    )
    given = {key: value(rng) if key in "AB" else value for key, value in settings.items()}
    given.setdefault("gain", lambda t: gains(t, (onset, float(K))))
    (record,), truth = fly(1, seed, amp=amp, **given)
    record = record if change is None else change(record, rng)
    detector = es.ChangeDetection(es.UnknownGain(model() if estimator is None else estimator, GAIN))
    try:
        result = es.estimate(detector, record, prior=START)
        verdict = es.trust(detector, record, prior=START, result=result)
    except es.EstimableError:
        return 0.0, np.inf
    return verdict.p, (result.gain[-1, 0] - truth[-1]) / np.sqrt(result.gain_covariance[-1, 0, 0])


def row(case, draws):
    """The line of one case."""
    p, z = np.array([drawn(case[0], i, *case[1:]) for i in range(draws)]).T
    wrong = np.abs(z) > 3
    silent = wrong & (p >= LEVEL)
    worst = f", z up to {np.abs(z[silent]).max():.1f}" if silent.any() else ""
    return (
        f"{case[0]:32s} warned {np.mean(p < LEVEL):5.3f}   wrong {wrong.sum():3d}, not warned {silent.sum():3d}{worst}"
    )


def main():
    """Print the table."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--draws", type=int, default=40)
    options.add_argument("--only", default="", help="cases whose name contains this")
    asked = options.parse_args()
    for case in cases():
        if asked.only in case[0]:
            print(row(case, asked.draws * (6 if case[0] == "right" else 1)), flush=True)


if __name__ == "__main__":
    main()
