"""How often `trust` warns of right models, and misses wrong ones, over a designed set of flights of the F-16 in closed loop.

Commands are log-uniform from .3 to 10 deg/s; the gain drops to one of 1, .9, .8, .6, .4 at 3 to 10 s. A result is wrong where
the printed gain is off by more than three times its half-width / 1.96. "plain": by a detector of changes with the model as given.
"interval": by the mixture of walks with errors of 10 % in A and B.
"""

import argparse
import hashlib
from typing import NamedTuple

import numpy as np

import estimable as es
from estimable.estimation.assess_gain import RELATIVE
from estimable.filters.mixture import SHARES, WALKS
from estimable.frozen import replace
from estimable.plants import f16

from .f16_loop import GAIN, START, fly, markov, model, standing, turbulence

LEVEL, WRONG = 0.02, 3.0
KEPT = 100  # flights in memory at a time
UNTESTABLE = "(cannot be tested)"


def scattered(M, share):
    """Entries off by a share, one standard deviation."""
    return lambda rng, draws: M * (1 + share * rng.normal(size=(draws, *M.shape)))


def moved(rows):
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
    """Name, arguments for `fly`, the estimator's model, and what is done to the log."""
    lasting = {τ: markov(τ, np.array([10.0, 10.0])) for τ in (0.03, 0.1, 0.3, 1.0)}
    plants = {
        "right": {},
        **{f"A off by {share:.0%}": {"A": scattered(f16.A, share)} for share in (0.02, 0.05, 0.1, 0.2)},
        **{f"Q x {factor}": {"white": factor} for factor in (0.07, 0.3, 3, 15)},
        **{f"lasting disturbance, {τ} s": {"disturbance": one} for τ, one in lasting.items()},
        **{f"{severity} turbulence": {"disturbance": turbulence(severity)} for severity in ("light", "moderate")},
        **{f"input off by {offset} deg": {"offset": offset} for offset in (0.05, 0.3, 1.0)},
        **{f"unmodelled limit of {limit} deg": {"limit": limit} for limit in (0.3, 1.0)},
        **{f"dynamic pressure to {end:.0%}": {"along": faster(end)} for end in (0.7, 1.4)},
        **{f"B off by {share:.0%} {UNTESTABLE}": {"B": scattered(f16.B, share)} for share in (0.05, 0.1, 0.2)},
        **{f"gain drifts by {by} {UNTESTABLE}": {"gain": drift(by)} for by in (0.1, 0.3, 0.6)},
    }
    logs = {
        f"input {abs(rows) * 10} ms {'late' if rows > 0 else 'early'}": moved(rows)
        for rows in (1, 2, 5, 10, -1, -2, -5, -10)
    }
    logs |= {"frozen sensor": frozen, "offset in mid-record": pushed}
    return [
        *((name, settings, None, None) for name, settings in plants.items()),
        *((f"R x {factor}", {}, replace(model(), R=model().R / factor), None) for factor in (0.5, 1.5, 3)),
        *((name, {}, None, change) for name, change in logs.items()),
    ]


def faster(end, steps=100):
    """A factor from 1 to `end` over the flight, in small steps."""
    return lambda t: 1 + (end - 1) * np.round(steps * t / t[-1]) / steps


def drift(by, steps=300):
    """A gain that falls by `by` over the flight, in small steps."""
    return lambda t: 1 - by * np.round(steps * t / t[-1]) / steps


def flights(case, draws, part):
    """Records, the true gain at the end, and the estimator's model."""
    name, settings, estimator, change = case
    seed = int.from_bytes(hashlib.sha256(f"{name}{part}".encode()).digest()[:4], "little")
    rng = np.random.default_rng(seed)
    amp = np.exp(rng.uniform(np.log(0.3), np.log(10), size=draws))
    K, onset = rng.choice([1, 0.9, 0.8, 0.6, 0.4], size=draws), rng.uniform(3, 10, size=draws)
    given = {key: value(rng, draws) if key in "AB" else value for key, value in settings.items()}
    given.setdefault("gain", lambda t: np.where(t[:, None] >= onset, K, 1.0))
    records, truth = fly(draws, seed, amp=amp, **given)
    records = records if change is None else [change(record, rng) for record in records]
    return records, truth[-1], model() if estimator is None else estimator


class Row(NamedTuple):
    """Of each flight: the p-value of the verdict, and z of the plain detector and of the mixture."""

    p: np.ndarray
    plain: np.ndarray
    interval: np.ndarray

    def sentence(self, name):
        """The line of one case."""
        warned, wrong, off = self.p < LEVEL, np.abs(self.plain) > WRONG, np.abs(self.interval) > WRONG
        silent = wrong & ~warned
        worst = f", z up to {np.abs(self.plain[silent]).max():.1f}" if silent.any() else ""
        return (
            f"{name:40s} {len(warned):4d} flights  warned {warned.mean():5.3f}  plain: wrong {wrong.sum():3d}, not warned "
            f"{silent.sum():3d}{worst}  interval: wrong {off.sum():3d}, not warned {(off & ~warned).sum():3d}"
        )


def judged(case, draws, intervals=True):
    """The row of one case."""
    found = []
    for part in range(-(-draws // KEPT)):
        records, truth, estimator = flights(case, min(KEPT, draws - part * KEPT), part)
        stacked, plain = es.stack(records), es.UnknownGain(estimator, GAIN)
        detector = es.ChangeDetection(plain)
        bank = es.estimate_bank(detector, stacked, prior=START, on_failure="keep")
        p = [es.trust(detector, one, prior=START, result=bank[i]).p for i, one in enumerate(records)]
        z, _ = standing(bank, truth)
        found.append((np.array(p), z, printed(plain, stacked, truth) if intervals else np.zeros(len(z))))
    return Row(*map(np.concatenate, zip(*found, strict=True)))


def printed(plain, stacked, truth):
    """z of the median by the 95 % interval of `assess_gain` without its fit of the noise."""
    uncertain = replace(plain, uncertainty=es.ModelUncertainty(relative=RELATIVE))
    mixture = es.Mixture([es.ChangeDetection(uncertain, walk=walk) for walk in WALKS], probability=SHARES)
    return standing(es.estimate_bank(mixture, stacked, prior=START, keep="last", on_failure="keep"), truth)[0]


def totals(rows):
    """The shares of the specification, from the rows by name."""
    right = rows.get("right")
    if right is not None:
        yield f"right models: {np.mean(right.p < LEVEL):.3f} of {len(right.p)} warned"
    testable = [row for name, row in rows.items() if name != "right" and UNTESTABLE not in name]
    if testable:
        p, z = (np.concatenate([getattr(row, name) for row in testable]) for name in ("p", "plain"))
        wrong = np.abs(z) > WRONG
        silent = wrong & (p >= LEVEL)
        yield (
            f"testable causes, plain: {silent.sum()} of {wrong.sum()} wrong results not warned "
            f"({silent.sum() / max(wrong.sum(), 1):.3f}), z up to {np.abs(z[silent]).max(initial=0):.1f}"
        )
    p, z = (np.concatenate([getattr(row, name) for row in rows.values()]) for name in ("p", "interval"))
    silent = (np.abs(z) > WRONG) & (p >= LEVEL)
    yield f"all causes, interval: {silent.sum()} of {len(z)} results wrong and not warned ({silent.mean():.4f})"


def main():
    """Print the table."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--draws", type=int, default=40)
    options.add_argument("--only", default="", help="cases whose name contains this")
    options.add_argument("--plain", action="store_true", help="without the intervals, which take most of the time")
    asked = options.parse_args()
    rows = {}
    for case in cases():
        if asked.only in case[0]:
            rows[case[0]] = judged(case, asked.draws * (20 if case[0] == "right" else 1), not asked.plain)
            print(rows[case[0]].sentence(case[0]), flush=True)
    print(*totals(rows), sep="\n")


if __name__ == "__main__":
    main()
