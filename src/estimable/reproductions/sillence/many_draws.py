"""Fixed laws over many draws (Figs. 3 to 10), and the bands over draws that §6.3 asks for."""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from ...controllers.proportional_integral import ProportionalIntegral
from ...controllers.state_feedback import StateFeedback
from ...filters.kalman_filter import Kalman
from ...frozen import replace
from ...plants import f16, f16_failure
from ...simulation.monte_carlo_loops import LoopCase, monte_carlo_loops
from ..entries import Reproduced, drawn
from .flights import FAILURE, NOMINAL, SEED

FAILED = 3.0  # [s]: when K drops in Figs. 7 to 10
RISE = 2.25  # [s]: the first step of the command ends here
EXACT = MappingProxyType({"sigma_alpha": 1e-9, "sigma_q": 1e-9})
SIGMA_Q = 0.951  # [deg/s]: "18.61 dB", from the 23.29 dB of .555
REMARK = (
    "The figures show one draw and print no number. Ours are over all draws, relative to the same flight without noise. The "
    "actuator moves between the samples, and the measured state is fed back."
)
BANDS_REMARK = (
    "Section 6.3 asks for means and bands of one standard deviation over 10 to 25 draws, for other failures, and with process "
    "noise. Mean and sigma are over the draws. The estimator is a change detector, which finds the failure by itself."
)


def fixed_law(
    *, integral: bool, alpha: bool = True, gain: float = 1.0, noise: Mapping[str, float] = NOMINAL
) -> Callable[[int], Reproduced]:
    """Pitch rate and alpha under a fixed law; K drops from 1 to `gain` at 3 s. `alpha`: whether alpha is fed back."""

    def compute(draws: int) -> Reproduced:
        cases = {name: _case(integral, alpha, gain, given) for name, given in (("noisy", noise), ("quiet", EXACT))}
        quiet = cases["quiet"].fly(seed=0, runs=1)[0].state
        runs = monte_carlo_loops(
            cases["noisy"], runs=draws, seed=SEED, summary=lambda closed: {"state": closed.state}, progress=False
        )[""].values["state"]  # fmt: skip
        rows = [
            drawn(
                f"RMS of {what} about the flight without noise",
                unit,
                None,
                np.sqrt(np.mean((runs - quiet)[..., i] ** 2, axis=1)),
            )
            for i, what, unit in ((1, "the pitch rate", "deg/s"), (0, "alpha", "deg"))
        ]
        rows += [drawn("pitch rate at the end of the first step over its command", "", None, _reached(runs))]
        return Reproduced(tuple(rows), lambda: _figure(runs, quiet), (REMARK,))

    return compute


def _case(integral: bool, alpha: bool, gain: float, noise: Mapping[str, Any]) -> LoopCase:
    """The loop that feeds back the measured state without a filter."""
    plant = f16.controlled(gain, failure_time=FAILED, **noise)
    measured = Kalman(f16.short_period(Q=1e6 * np.eye(2), **noise))
    law = f16.law(integral=integral)
    return f16_failure.case(plant, law if alpha else _without_alpha(law), measured)


def _without_alpha(law: StateFeedback | ProportionalIntegral) -> StateFeedback | ProportionalIntegral:
    return replace(law, feedback=law.feedback * np.array([[0.0, 1.0]]))


def _reached(runs: np.ndarray) -> np.ndarray:
    """The pitch rate at the end of the first step of the command, divided by the command."""
    k = round(RISE * f16.RATE) - 1
    return runs[:, k, 1] / f16.pitch_command(np.array([k / f16.RATE]))[0]


def _figure(runs: np.ndarray, quiet: np.ndarray) -> Any:
    from .. import plots

    t = np.arange(len(quiet)) / f16.RATE
    command = plots.Line("command", t, f16.pitch_command(t), plots.INK, "dash", 1.2)
    lines = [[plots.Line("without noise", t, quiet[:, i], plots.INK, width=1.2), plots.Line("one draw", t, runs[0, :, i], 0)]
             for i in (1, 0)]  # fmt: skip
    return plots.over_time(
        [plots.Panel("pitch rate [deg/s]", [command, *lines[0]]), plots.Panel("alpha [deg]", lines[1])]
    )


def bands(draws: int) -> Reproduced:
    """§6.3: pitch rate and gain over draws, mean ± 1 sigma, for failures of several sizes, with and without gusts."""
    healthy = f16_failure.healthy()
    cases = {f"K1 = {gain}{gusty}": _failing(gain, Q) for gain in (0.8, 0.6, 0.4, 0.2) for gusty, Q in
             (("", None), (", gusts", GUSTS))}  # fmt: skip
    found = monte_carlo_loops(cases, runs=draws, seed=SEED, progress=False, summary=lambda closed: {
        "rate": closed.state[:, 1], "gain": closed.gain[:, 0]})  # fmt: skip
    t = np.arange(len(healthy)) / f16.RATE
    parts = {"4.5 to 6 s": (t >= FAILURE - 1e-9) & (t < 6 - 1e-9), "after 6 s": t >= 6 - 1e-9}
    rows = [
        drawn(f"RMS of the pitch rate, {part}, {name}", "deg/s", None,
              np.sqrt(np.mean((one.values["rate"][:, at] - healthy[at]) ** 2, axis=1)))
        for name, one in found.items() for part, at in parts.items()
    ]  # fmt: skip
    rows += [
        drawn(f"gain, last 2 s, {name}", "", None, one.values["gain"][:, -200:].mean(axis=1))
        for name, one in found.items()
    ]
    return Reproduced(tuple(rows), lambda: _bands_figure(t, healthy, found), (BANDS_REMARK,))


GUSTS = np.diag([0.05, 1.0])  # density per second: (.7 deg/s, 10 deg/s²) over a hundredth of a second


def _failing(gain: float, Q: np.ndarray | None) -> LoopCase:
    model = f16.short_period() if Q is None else f16.short_period(Q=Q)
    plant = f16.controlled(gain, failure_time=FAILURE)
    plant = plant if Q is None else replace(plant, model=model)
    return f16_failure.case(plant, f16_failure.reconfigured(), f16_failure.detector(model))


def _bands_figure(t: np.ndarray, healthy: np.ndarray, found: dict[str, Any]) -> Any:
    from .. import plots

    without_gusts = {name: one.values for name, one in found.items() if "gusts" not in name}

    def lines(key: str) -> list:
        return [plots.Line(f"{name}, mean ± 1 sigma", t, one[key].mean(axis=0), i, sigma=one[key].std(axis=0))
                for i, (name, one) in enumerate(without_gusts.items())]  # fmt: skip

    whole = plots.Line("flight without a failure", t, healthy, plots.INK, "dash", 1.2)
    return plots.over_time(
        [plots.Panel("pitch rate [deg/s]", [whole, *lines("rate")]), plots.Panel("gain K", lines("gain"))]
    )
