"""The effect of an elevator failure on the flight of the F-16, with a fixed and with a reconfigured control law."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..controllers.gain_reconfiguration import GainReconfiguration
from ..filters.change_detection import ChangeDetection
from ..filters.kalman_filter import Kalman
from ..filters.unknown_gain import UnknownGain
from ..frozen import saved
from ..models.controlled import ControlledPlant
from ..models.prior import Prior
from ..models.state_space import StateSpace
from ..protocols import Algorithm, Controller, Link
from ..results import ClosedLoop, ClosedLoopBank
from ..simulation.close_loop import close_loop
from ..simulation.monte_carlo_loops import LoopCase, monte_carlo_loops
from . import f16

FAILURE, SETTLED = 4.5, 6.0  # [s]: time of the failure; start of the interval "after"
JUMP = 0.25  # variance of the jump to detect: one standard deviation is half of the gain
EXACT = 1e-9  # sigmas [deg], [deg/s] of a nearly noise-free flight


@saved
class Failed(NamedTuple):
    """The result of `fly`: many flights in which the elevator fails, under the fixed law and under the reconfigured law.

    - `t` (T,): the times in seconds.
    - `healthy` (T,): the pitch rate [deg/s] of a flight without a failure and without noise.
    - `fixed` and `adaptive`: the flights under the fixed and under the reconfigured law.
    """

    t: np.ndarray
    healthy: np.ndarray
    fixed: ClosedLoopBank
    adaptive: ClosedLoopBank

    def rms(self, bank: ClosedLoopBank, start: float, end: float = np.inf) -> np.ndarray:
        """For each run of `bank`, the RMS difference of the pitch rate from `healthy` between `start` and `end` [s], in
        deg/s.
        """
        rows = (self.t >= start - 1e-9) & (self.t < end - 1e-9)
        return np.sqrt(np.mean((bank.runs.state[:, rows, 1] - self.healthy[rows]) ** 2, axis=1))

    @property
    def detection_delay(self) -> np.ndarray:
        """The time from the failure to its detection in each run under the reconfigured law [s]; infinite where it is not
        detected.
        """
        seen = np.asarray(self.adaptive.runs.extra["alarm"])[:, self.t >= FAILURE - 1e-9]
        return np.where(seen.any(axis=1), np.argmax(seen, axis=1) / f16.RATE, np.inf)

    @property
    def numbers(self) -> dict[str, float]:
        """Medians over the runs: the RMS [deg/s] from the failure to 6 s (`transient`) and later (`after`), and the detection
        delay [s].
        """
        return {
            "fixed_rms_after": float(np.median(self.rms(self.fixed, SETTLED))),
            "fixed_rms_transient": float(np.median(self.rms(self.fixed, FAILURE, SETTLED))),
            "adaptive_rms_after": float(np.median(self.rms(self.adaptive, SETTLED))),
            "adaptive_rms_transient": float(np.median(self.rms(self.adaptive, FAILURE, SETTLED))),
            "detection_delay_s": float(np.median(self.detection_delay)),
        }


def fly(
    gain_after: float, *, runs: int, seed: int, input_link: Link | None = None, output_link: Link | None = None
) -> Failed:
    """Simulate many flights in which the loop gain drops to `gain_after` at 4.5 s, under a fixed and under a reconfigured
    law.

    The command is that of `f16.pitch_command`, and the actuator moves between samples. Both loops use the same estimator, a
    change detector that assumes a gain of 1 until it detects a change. The fixed law is `f16.law()`; the reconfigured law is
    the same in `GainReconfiguration`. `input_link` leads to the actuator, which holds the last command that arrived;
    `output_link` leads from the sensors. Both are as in `close_loop`.

    Reference: A. G. Sillence (1999), §5.6.

    >>> numbers = fly(0.5, runs=8, seed=1).numbers
    >>> numbers["adaptive_rms_after"] < 0.05 < 1 < numbers["fixed_rms_after"]
    True
    """
    both = cases(gain_after, input_link=input_link, output_link=output_link)
    fixed, adaptive = (both[name].fly(seed=seed, runs=runs) for name in ("fixed", "adaptive"))
    return Failed(_time(), healthy(), fixed, adaptive)


def cases(gain_after: float, *, input_link: Link | None = None, output_link: Link | None = None) -> dict[str, LoopCase]:
    """The two loops of `fly`, {"fixed": LoopCase, "adaptive": LoopCase}, for `monte_carlo_loops`."""
    watched = detector(f16.short_period())
    plant = f16.controlled(gain_after, failure_time=FAILURE)
    return {
        name: case(plant, law, watched, input_link=input_link, output_link=output_link)
        for name, law in (("fixed", f16.law()), ("adaptive", reconfigured()))
    }


def detector(model: StateSpace) -> ChangeDetection:
    """The change detector, which assumes a gain of 1 until it detects a change."""
    return ChangeDetection(UnknownGain(model, Prior([1.0], [[0.0]])), jump=JUMP)


def reconfigured() -> GainReconfiguration:
    """The law that adapts to the estimated effect of the elevator."""
    return GainReconfiguration(f16.law())


def case(
    plant: ControlledPlant,
    law: Controller[Any],
    estimator: Algorithm[Any],
    *,
    input_link: Link | None = None,
    output_link: Link | None = None,
) -> LoopCase:
    """A loop that starts at rest and follows `f16.pitch_command`. When a command is lost, the actuator holds the last one."""
    return LoopCase(plant, law, estimator, input_link=input_link, output_link=output_link, lost="hold", **_given())


def study(
    gain_after: float,
    *,
    runs: int,
    seed: int,
    input_link: Link | None = None,
    output_link: Link | None = None,
    folder: str | Path | None = None,
    scheduler: str | None = None,
    progress: bool = True,
) -> dict[str, float]:
    """The numbers of `Failed.numbers` for any number of flights. Only a summary of each flight is stored.

    `folder` and `scheduler` are as in `monte_carlo_loops`; the other arguments are as in `fly`.

    >>> study(0.5, runs=8, seed=1)["detection_delay_s"] == fly(0.5, runs=8, seed=1).numbers["detection_delay_s"]
    True
    """
    both = cases(gain_after, input_link=input_link, output_link=output_link)
    found = monte_carlo_loops(
        both, runs=runs, seed=seed, summary=_Judge(healthy()), folder=folder, scheduler=scheduler, progress=progress
    )
    numbers = {f"{name}_{key}": float(np.median(found[name].values[key]))
               for name in both for key in ("rms_after", "rms_transient")}  # fmt: skip
    return {**numbers, "detection_delay_s": float(np.median(found["adaptive"].values["delay"]))}


class _Judge(NamedTuple):
    """The summary of a flight, compared with the pitch rate of the flight without a failure."""

    healthy: np.ndarray

    def __call__(self, closed: ClosedLoop) -> dict[str, Any]:
        apart = (closed.state[:, 1] - self.healthy) ** 2
        failed, settled = (closed.t >= start - 1e-9 for start in (FAILURE, SETTLED))
        seen = np.flatnonzero(np.asarray(closed.extra["alarm"])[failed])
        return {
            "rms_after": np.sqrt(np.mean(apart[settled])), "rms_transient": np.sqrt(np.mean(apart[failed & ~settled])),
            "delay": seen[0] / f16.RATE if len(seen) else np.inf,
        }  # fmt: skip


def healthy() -> np.ndarray:
    """The pitch rate [deg/s] of the flight without a failure and without noise, (T,)."""
    quiet = f16.controlled(sigma_alpha=EXACT, sigma_q=EXACT)
    return close_loop(quiet, f16.law(), Kalman(f16.short_period()), seed=0, **_given()).state[:, 1]


def _time() -> np.ndarray:
    return np.arange(round(f16.SECONDS * f16.RATE) + 1) / f16.RATE


def _given() -> dict[str, Any]:
    start = Prior([0.0, 0.0], np.zeros((2, 2)))
    return {"reference": f16.pitch_command(_time()), "prior": start, "dt": 1 / f16.RATE}
