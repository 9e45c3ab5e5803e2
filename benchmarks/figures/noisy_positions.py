"""The bias of a gain whose input is a measured position with noise, and without it where the filter uses the commands."""

import argparse

import numpy as np

import estimable as es

MODEL = es.StateSpace([[-0.2]], [[1.0]], Q=[[0.01]], R=[[0.04]], dt=0, inputs=["valve"])
ACTUATOR = {"valve": es.Actuator(5.0)}
DT, SECONDS = 0.1, 150.0


def figure(runs, sigmas=(0.05, 0.2, 0.5)):
    """{(estimator, sigma of the position)}: (rms of the position, mean gain at the end, its standard error, reported sigma)."""
    reference = np.sin(0.2 * np.arange(round(SECONDS / DT)))
    law, found = es.StateFeedback([[0.5]], reference_gain=[[1.0]]), {}
    gain = es.UnknownGain(MODEL, es.Prior([1.0], [[4.0]]))
    for sigma in sigmas:
        plant = es.ControlledPlant(MODEL, actuator=ACTUATOR, position_sigma=sigma)
        for name, estimator in (("positions", gain), ("commands", es.Actuated(gain, ACTUATOR))):
            bank = es.close_loop_bank(
                plant, law, estimator, runs=runs, reference=reference, seed=1, dt=DT, prior=es.Prior([0.0], [[0.0]])
            ).runs
            last, reported = bank.info.gain[:, -1, 0], np.sqrt(bank.info.gain_covariance[:, -1, 0, 0])
            found[name, sigma] = tuple(
                float(x) for x in (bank.input.std(), last.mean(), last.std(ddof=1) / np.sqrt(runs), reported.mean())
            )
    return found


def main():
    """Print the figure."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--runs", type=int, default=400)
    for (name, sigma), (rms, gain, error, reported) in figure(options.parse_args().runs).items():
        print(
            f"{name}, noise {sigma:g} ({100 * sigma / rms:.0f} % of the rms): gain {gain:.4f} ± {error:.4f} (true: 1), "
            f"reported sigma {reported:.4f}"
        )


if __name__ == "__main__":
    main()
