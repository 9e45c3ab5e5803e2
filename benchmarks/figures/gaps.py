"""Gaps in a flight of the F-16: the gain by a bridge against the whole record, and the innovations after a break."""

import argparse

import numpy as np

import estimable as es
from estimable.plants import f16

LENGTHS = (0.05, 0.1, 0.4, 1.0)  # seconds
GAIN = es.Prior([1.0], [[0.25]])
START = es.Prior([0.0, 0.0], np.zeros((2, 2)))
FIRST = 6  # innovations after a break


def flights(draws):
    """Records of the healthy aircraft under its law, with process noise, the elevator measured."""
    model = f16.short_period(Q=np.diag([1e-3, 0.1]))
    plant = es.ControlledPlant(model, actuator=f16.ACTUATOR)
    t = np.arange(round(f16.SECONDS * f16.RATE) + 1) / f16.RATE
    given = {"reference": f16.pitch_command(t), "prior": START, "dt": 1 / f16.RATE}
    bank = es.close_loop_bank(plant, f16.law(), es.Kalman(model), seed=1, runs=draws, **given).runs
    names = {"outputs": model.outputs, "inputs": model.inputs, "hold": "first_order"}
    return model, [es.Record(y, u, t=t, **names) for y, u in zip(bank.output, bank.input, strict=True)]


def with_gaps(record, seconds, missing):
    """The record with five gaps spread over it: rows of NaN (`missing`), or no rows."""
    from estimable.frozen import replace

    T, rows = len(record), round(seconds * f16.RATE) - 1
    inside = np.zeros(T, bool)
    for middle in np.linspace(0.1, 0.9, 5):
        start = round(middle * T) - rows // 2
        inside[start : start + rows] = True
    if missing:
        y, u = np.where(inside[:, None], np.nan, record.y), np.where(inside[:, None], np.nan, record.u)
        return replace(record, y=y, u=u)
    keep = ~inside
    return es.Record(
        record.y[keep], record.u[keep], t=record.t[keep], hold=record.hold, outputs=record.outputs, inputs=record.inputs
    )


def table(draws):
    """(seconds, rms z at the end, sigma over that of the whole record) for each length of the gaps."""
    model, records = flights(draws)
    algorithm = es.UnknownGain(model, GAIN)

    def ends(some):
        bank = es.estimate_bank(algorithm, some, prior=START, gaps="bridge", keep="last")
        return bank.gain[:, -1, 0], np.sqrt(bank.info.gain_covariance[:, -1, 0, 0])

    _, whole = ends(records)
    rows = []
    for seconds in LENGTHS:
        gain, sigma = ends([with_gaps(one, seconds, missing=True) for one in records])
        rows.append((seconds, float(np.sqrt(np.mean(((gain - 1) / sigma) ** 2))), float(np.mean(sigma / whole))))
    return rows


def plants():
    """Models of 2, 3 and 7 states that are stable, marginal and unstable."""
    rng = np.random.default_rng(5)
    found = {}
    for n in (2, 3, 7):
        M = rng.normal(size=(n, n))
        A = M - M.T - np.diag(rng.uniform(0.3, 2.0, n))
        slowest, B, C = np.linalg.eigvals(A).real.max(), rng.normal(size=(n, 1)), rng.normal(size=(2, n))
        for kind, mode in (("stable", -0.4), ("marginal", 0.0), ("unstable", 0.3)):
            moved = A - (slowest - mode) * np.eye(n)
            found[n, kind] = es.StateSpace(moved, B, C, Q=0.05 * np.eye(n), R=0.01 * np.eye(2), dt=0)
    return found


def after_a_break(model, seed, rows=240, dt=0.05):
    """The largest of six innovations after a gap of 2 s, in standard deviations."""
    u = np.cumsum(np.random.default_rng(seed).normal(size=(rows, 1)) * 0.3, axis=0)
    prior = es.Prior(np.zeros(model.n), np.eye(model.n))
    drawn = es.simulate(model, u, seed=seed, dt=dt, prior=prior).record
    keep = np.ones(rows, bool)
    keep[120:160] = False
    record = es.Record(drawn.y[keep], drawn.u[keep], t=drawn.t[keep])
    found = es.estimate(es.Kalman(model), record, prior=prior, gaps="break")
    S = np.diagonal(found.innovation_covariance[120 : 120 + FIRST], axis1=1, axis2=2)
    with np.errstate(invalid="ignore"):
        return float(np.nanmax(np.abs(found.innovation[120 : 120 + FIRST]) / np.sqrt(S)))


def main():
    """Print the figures."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--draws", type=int, default=100)
    draws = options.parse_args().draws
    for seconds, z, ratio in table(draws):
        print(
            f"five gaps of {seconds:g} s, bridged: rms z of the gain {z:.2f}, sigma {ratio:.2f} times that of the whole record"
        )
    for (n, kind), model in plants().items():
        worst = [after_a_break(model, seed) for seed in range(draws // 5)]
        print(
            f"{n} states, {kind}: largest of {FIRST} innovations after a break {max(worst):.1f} sigma, "
            f"median {np.median(worst):.1f}"
        )


if __name__ == "__main__":
    main()
