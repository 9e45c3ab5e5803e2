"""The score tests of an output-error fit: false alarms, and the power against faults of the link and the plant."""

import argparse

import numpy as np
from scipy.signal import lfilter

import estimable as es
from estimable.identifiers.one_output import Orders, fit_output
from estimable.identifiers.output_error_ml import by_output
from estimable.identifiers.score_tests import rate_of

A, B = [1.0, 0.523, 0.349], [0.44, 0.762]
FAULTS = {
    "hold": "held", "loss exp(-|y|)": "loss with |x|", "y > .5 lost": "loss with x", "drift +50 %": "drift",
    "10 % of acknowledgements lost": "applied", "u + .1 u²": "square of u", "offset .15": "offset",
    "output saturates at 1.5": "cube of x",
    "20 % stale": "stale",
}  # fmt: skip


def drawn(seed, fault="none", rows=1000, noise=0.0):
    """80 % of the inputs and 70 % of the outputs arrive; noise variance .1, an autoregression with this pole."""
    g = np.random.default_rng(seed)
    u, came = g.uniform(-(3**0.5), 3**0.5, rows), (g.random(rows) < 0.8) * 1.0
    acted = u + 0.1 * u**2 if fault == "u + .1 u²" else u
    applied = acted * came
    if fault == "hold":
        for k in range(1, rows):
            applied[k] = acted[k] if came[k] else applied[k - 1]
    x = lfilter(B, A, applied)
    if fault == "drift +50 %":
        x = x * (1 + 0.5 * np.arange(rows) / rows)
    if fault == "output saturates at 1.5":
        x = np.clip(x, -1.5, 1.5)
    if fault == "20 % stale":
        x = np.where(np.r_[False, g.random(rows - 1) < 0.2], np.r_[0, x[:-1]], x)
    v = lfilter([np.sqrt(0.1 * (1 - noise**2))], [1, -noise], g.normal(size=rows + 100))[100:]
    y = x + v + 0.15 * (fault == "offset .15")
    seen = g.random(rows) < (np.exp(-np.abs(y)) if fault == "loss exp(-|y|)" else 0.7)
    seen &= ~(y > 0.5) if fault == "y > .5 lost" else True
    said = came * (g.random(rows) >= 0.1) if fault == "10 % of acknowledgements lost" else came
    return es.Record(np.where(seen, y, np.nan), u, dt=1, arrived=said[:, None])


def fitted(seed, fault="none", **settings):
    """The scores of one fit; without a level where an offset is the fault."""
    level = {"level": "none"} if fault.startswith("offset") else {}
    return es.OutputErrorML(2, 1, **level).fit([drawn(seed, fault, **settings)]).validation.scores


def rates(draws, arrival, rows=1500):
    """Estimated rates and their standard deviations, where the fates of inputs are unknown."""
    found = []
    for seed in range(draws):
        g = np.random.default_rng(seed)
        u = g.uniform(-(3**0.5), 3**0.5, rows)
        y = lfilter(B, A, u * (g.random(rows) < arrival)) + 0.1**0.5 * g.normal(size=rows)
        data = by_output([es.Record(y, u, dt=1)])[0]
        found.append(rate_of(fit_output(Orders(2, 1, 0, 2, 1), data, [], None)))
    return np.array(found)


def main():
    """Print the figures."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--draws", type=int, default=40)
    options.add_argument("--clean", type=int, default=250)
    given = options.parse_args()
    for noise in (0.0, 0.5, 0.9):
        alarms = [not all(row.passed for row in fitted(seed, noise=noise)) for seed in range(given.clean)]
        print(f"clean, noise pole {noise}: any of {len(fitted(0))} tests fails in {np.mean(alarms):.3f}")
    for fault, row in FAULTS.items():
        found = [{one.name: abs(one.value) for one in fitted(seed, fault)} for seed in range(given.draws)]
        values, largest = [one[row] for one in found], [max(one, key=one.get) == row for one in found]
        print(
            f"{fault:30} {row:14} median |t| {np.median(values):5.1f}, power {np.mean(np.array(values) > 3.5):.2f}, "
            f"any {np.mean([max(one.values()) > 3.5 for one in found]):.2f}, largest in {np.mean(largest):.2f}"
        )
    for arrival in (1.0, 0.95, 0.8, 0.6, 0.5):
        found = rates(given.draws, arrival)
        z = (found[:, 0] - arrival) / found[:, 1]
        print(
            f"arrival {arrival}: mean {found[:, 0].mean():.3f}, sd {found[:, 0].std():.3f}, rms z {np.sqrt(np.mean(z**2)):.2f}"
        )


if __name__ == "__main__":
    main()
