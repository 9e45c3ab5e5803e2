"""The gain of an elevator while the dynamic pressure doubles: with the matrices scheduled by it, and with constant ones."""

import argparse

import numpy as np

import estimable as es
from estimable.frozen import replace

DT, SECONDS, SLOW, FAST = 0.02, 20.0, 9_000.0, 18_000.0  # [s], [s], dynamic pressure [Pa]
START = es.Prior([0.0, 0.0], np.zeros((2, 2)))
GAIN = es.Prior([1.0], [[0.25]])
CHANNELS = {"states": ["alpha", "pitch_rate"], "inputs": ["elevator_deg"], "outputs": ["alpha_deg", "pitch_rate_deg_s"]}


def matrices(pressure):
    """A and B of a short period whose aerodynamic derivatives are proportional to the dynamic pressure."""
    part = pressure / SLOW
    return {"A": [[-1.0 * part, 1.0], [-5.0 * part, -1.1 * part]], "B": [[-0.1 * part], [-12.0 * part]]}


def scheduled():
    """The model, whose nominal matrices are those of the slow flight."""
    return es.StateSpace(
        **matrices(SLOW), Q=np.diag([1e-3, 0.1]), R=np.diag([0.03, 0.1108]) ** 2, dt=0,
        schedule={"pressure_pa": matrices}, **CHANNELS,
    )  # fmt: skip


def flights(runs, seconds=SECONDS, seed=1):
    """Flights whose dynamic pressure doubles, with an elevator that works: a bank of simulations."""
    t = np.arange(round(seconds / DT)) * DT
    pressure = SLOW + (FAST - SLOW) * np.clip((t / seconds - 0.25) / 0.5, 0, 1)
    elevator = np.sign(np.sin(2 * np.pi * t / 1.5))[:, None]
    return es.simulate_bank(scheduled(), elevator, seed=seed, runs=runs, dt=DT, schedule={"pressure_pa": pressure})


def figure(runs, seconds=SECONDS):
    """{model: (rms of z over all flights at 20 instants, mean gain at the end, its sigma, standard error of the rms)}, with
    z = (gain - 1) / sigma. The standard error takes each flight as one draw."""
    record, found = flights(runs, seconds).items.record, {}
    noise = 0.02 * np.random.default_rng(1).normal(size=record.y.shape) * [0.0, 0.0, 1.0]
    noisy = replace(record, y=record.y * (1 + noise))
    cases = {
        "scheduled": (scheduled(), record),
        "scheduled, 2 % noise on the pressure": (scheduled(), noisy),
        "constant": (scheduled().nominal, record),
    }
    for name, (model, measured) in cases.items():
        records = es.results.Stacked(measured, runs)
        bank = es.estimate_bank(es.UnknownGain(model, GAIN), records, prior=START, keep="all")
        sigma = np.sqrt(bank.gain_covariance[..., 0, 0])
        z = (bank.gain[..., 0] - 1) / sigma
        rows = np.linspace(0, z.shape[1] - 1, 21).astype(int)[1:]
        each = np.mean(z[:, rows] ** 2, axis=1)
        rms = float(np.sqrt(np.mean(each)))
        error = float(np.std(each, ddof=1) / np.sqrt(runs) / (2 * rms))
        found[name] = rms, float(np.mean(bank.gain[:, -1])), float(sigma[0, -1]), error
    return found


def main():
    """Print the figure."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--runs", type=int, default=50)
    for name, (z, gain, sigma, error) in figure(options.parse_args().runs).items():
        print(
            f"{name}: rms z {z:.3f} ± {error:.3f}; gain at the end {gain:.3f}, reported sigma {sigma:.4f}; true gain 1"
        )


if __name__ == "__main__":
    main()
