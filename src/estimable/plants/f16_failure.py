"""What a loss of the elevator's effect does to the F-16's flight, with and without a law that finds out."""

from typing import Any, NamedTuple

import numpy as np

from ..controllers.gain_reconfiguration import GainReconfiguration
from ..filters.change_detection import ChangeDetection
from ..filters.kalman import Kalman
from ..filters.unknown_gain import UnknownGain
from ..models.prior import Prior
from ..run.close_loop import ClosedLoopBank, close_loop, close_loop_bank
from . import f16

FAILURE, SETTLED = 4.5, 6.0  # [s]: the elevator fails; from here on the flight counts as "after"
JUMP = 0.25  # variance of the jump that is looked for: half of the gain is one standard deviation
EXACT = 1e-9  # sigmas [deg], [deg/s] of a flight without noise


class Failed(NamedTuple):
    """Many flights in which the elevator fails: under the law as it is, and reconfigured.

    `healthy` (T,): the pitch rate [deg/s] of the flight that does not fail, without noise. RMS are of the pitch rate about it,
    medians over the runs; a run whose failure is never seen has an infinite delay.
    """

    t: np.ndarray
    healthy: np.ndarray
    fixed: ClosedLoopBank
    adaptive: ClosedLoopBank

    def rms(self, bank: ClosedLoopBank, start: float, end: float = np.inf) -> np.ndarray:
        """The RMS of each run from `start` to `end` [s], in deg/s."""
        rows = (self.t >= start - 1e-9) & (self.t < end - 1e-9)
        return np.sqrt(np.mean((bank.runs.state[:, rows, 1] - self.healthy[rows]) ** 2, axis=1))

    @property
    def detection_delay(self) -> np.ndarray:
        """How long after the failure each reconfigured run saw it [s]."""
        seen = np.asarray(self.adaptive.runs.extra["alarm"])[:, self.t >= FAILURE - 1e-9]
        return np.where(seen.any(axis=1), np.argmax(seen, axis=1) / f16.RATE, np.inf)

    @property
    def numbers(self) -> dict[str, float]:
        """Medians over the runs: RMS [deg/s] after 6 s and in the transient before, and the delay [s]."""
        return {
            "fixed_rms_after": float(np.median(self.rms(self.fixed, SETTLED))),
            "fixed_rms_transient": float(np.median(self.rms(self.fixed, FAILURE, SETTLED))),
            "adaptive_rms_after": float(np.median(self.rms(self.adaptive, SETTLED))),
            "adaptive_rms_transient": float(np.median(self.rms(self.adaptive, FAILURE, SETTLED))),
            "detection_delay_s": float(np.median(self.detection_delay)),
        }


def fly(gain_after: float, *, runs: int, seed: int, input_link: Any = None, output_link: Any = None) -> Failed:
    """Fly the doublets with a gain that drops to `gain_after` at 4.5 s, on the continuous actuator.

    The law is that of `f16.law()`, fed by the same estimator in both: a change detector that believes in a gain of 1 until it
    fails. Reconfigured, it is in `GainReconfiguration`. Links as in `close_loop`: to the actuator (which holds what came
    last), and from the sensors. Reference: A. G. Sillence (1999), §5.6.

    >>> numbers = fly(0.5, runs=8, seed=1).numbers
    >>> numbers["adaptive_rms_after"] < 0.05 < 1 < numbers["fixed_rms_after"]
    True
    """
    model, t = f16.short_period(), np.arange(round(f16.SECONDS * f16.RATE) + 1) / f16.RATE
    given: dict[str, Any] = {
        "reference": f16.pitch_command(t), "seed": seed, "prior": Prior([0.0, 0.0], np.zeros((2, 2))), "dt": 1 / f16.RATE
    }  # fmt: skip
    healthy = close_loop(f16.controlled(sigma_alpha=EXACT, sigma_q=EXACT), f16.law(), Kalman(model), **given)
    watched = ChangeDetection(UnknownGain(model, Prior([1.0], [[0.0]])), jump=JUMP)
    given |= {"runs": runs, "input_link": input_link, "output_link": output_link, "lost": "hold"}
    plant = f16.controlled(gain_after, failure_time=FAILURE)
    fixed, adaptive = (
        close_loop_bank(plant, law, watched, **given) for law in (f16.law(), GainReconfiguration(f16.law()))
    )
    return Failed(t, healthy.state[:, 1], fixed, adaptive)
