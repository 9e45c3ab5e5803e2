"""The cost of closed loops of the F-16 with a rate limit, turbulence and faults, over that of the same loops of workload W8."""

import argparse
import time

import numpy as np

import estimable as es
from benchmarks.loops import _summary
from estimable.plants import f16, f16_failure


def plants():
    """The plant of W8, and the worlds that misbehave."""
    model = f16.short_period()
    air = es.Turbulence(es.Dryden.at(6096.0, 275.0, severity="moderate"), {"alpha": "alpha"}, angle="deg")
    limited = {"actuator": es.Actuator(f16.ACTUATOR, limits=(-25.0, 25.0), rate=60.0)}
    failed = es.Failure(4.5, 0.4)
    return {
        "W8": f16.controlled(0.4),
        "rate limit": es.ControlledPlant(model, events=[failed], **limited),
        "rate limit, turbulence": es.ControlledPlant(model, events=[failed], turbulence=air, **limited),
        "rate limit, turbulence, sensor fault": es.ControlledPlant(
            model, events=[failed, es.SensorFault(9.0, "pitch_rate_deg_s", "frozen")], turbulence=air, **limited
        ),
    }


def main():
    """Print processor seconds, elapsed seconds and the ratio to W8, for an estimator of W8."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--runs", type=int, default=10_000)
    options.add_argument("--estimator", choices=("window", "detector"), default="window")
    given, model = options.parse_args(), f16.short_period()
    window = es.MovingWindow(es.UnknownGain(model, es.Prior([0.8], [[0.4]])), 30)
    smoothed = es.Smoothed(es.Bounded(window, 0.0, 1.0), 0.9)
    estimator = smoothed if given.estimator == "window" else f16_failure.detector(model)
    options = {"seed": 1, "summary": _summary, "chunk": 500, "progress": False, "on_failure": "keep"}
    first = None
    for name, plant in plants().items():
        case = es.LoopCase(
            plant, es.GainReconfiguration(f16.law(), caution=0.0), estimator, dt=1 / f16.RATE,
            reference=f16.pitch_command(np.arange(1650) / f16.RATE), prior=es.Prior([0.0, 0.0], np.zeros((2, 2))),
        )  # fmt: skip
        es.monte_carlo_loops(case, runs=min(500, given.runs), **options)  # compiles
        used, began = time.process_time(), time.perf_counter()
        es.monte_carlo_loops(case, runs=given.runs, **options)
        used, elapsed = time.process_time() - used, time.perf_counter() - began
        first = used if first is None else first
        print(f"{name:38} {used:7.1f} s of processor, {elapsed:7.1f} s, {used / first:5.2f} of W8", flush=True)


if __name__ == "__main__":
    main()
