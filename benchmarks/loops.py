"""W8: many closed loops of the F-16 with the gain estimated in the loop, and a summary of each."""

import numpy as np

import estimable as es
from estimable.plants import f16, f16_failure

from .common import best, row


def loops(name, runs):
    """With the thesis's window of 30 samples, and with a change detector; each error: against a few runs on XLA."""
    model, prior = f16.short_period(), es.Prior([0.0, 0.0], np.zeros((2, 2)))
    window = es.MovingWindow(es.UnknownGain(model, es.Prior([0.8], [[0.4]])), 30)
    estimators = {"window of 30, bounded, smoothed": es.Smoothed(es.Bounded(window, 0.0, 1.0), 0.9),
                  "change detection": f16_failure.detector(model)}  # fmt: skip
    reference = f16.pitch_command(np.arange(1650) / f16.RATE)
    for label, estimator in estimators.items():
        law = es.GainReconfiguration(f16.law(), caution=0.0)
        case = es.LoopCase(f16.controlled(0.4), law, estimator, reference=reference, prior=prior, dt=1 / f16.RATE)

        def fly(case=case):
            return es.monte_carlo_loops(case, runs=runs, seed=1, summary=_summary, chunk=500, progress=False)[""]

        seconds, first, found = best(fly, repeats=1)
        few = case.fly(seed=1, runs=2, engine="xla").runs.info.gain[:, -1, 0]
        yield row(name, f"estimable, {label}", seconds, first, np.abs(found.values["gain"][:2] - few).max())


def _summary(closed):
    return {"gain": closed.gain[-1, 0], "rate": np.sqrt(np.mean(closed.state[450:, 1] ** 2))}
