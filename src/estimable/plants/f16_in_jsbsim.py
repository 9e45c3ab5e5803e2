"""What a loss of the elevator's effect does to the nonlinear F-16 of JSBSim, with and without a law that finds out.

Beside the short period the estimator has a third state: the elevator that would upset the trim as much as all does that the
linear model leaves out. It walks; the law feeds it back with gain one, so that a trim that is lost is found again.
"""

from typing import Any, NamedTuple

import numpy as np

from ..controllers.gain_reconfiguration import GainReconfiguration
from ..controllers.state_feedback import StateFeedback
from ..design.gains import lqr_gain
from ..filters.change_detection import ChangeDetection
from ..filters.unknown_gain import UnknownGain
from ..frozen import saved
from ..models.prior import Prior
from ..models.state_space import StateSpace
from ..results import ClosedLoop
from ..simulation.close_loop import close_loop
from . import f16
from .f16_failure import FAILURE, JUMP, SETTLED
from .jsbsim_f16 import JsbsimF16

COMMAND = 2.5  # [deg/s]: doublets that an elevator with .3 of its effect can follow within its limits
QUICK = 10.0  # [1/s]: through 10 / (s + 10), quick enough to tell a lost gain from an upset that walks
UPSET = 0.1  # [deg²/s]: how fast what upsets the trim walks, as Mach and alpha change
LENGTH = 100  # samples that an onset may lie back
FALSE_ALARMS = 300.0  # [s]


@saved
class Flown(NamedTuple):
    """A flight of each kind: unfailed, failed under the law as it is, failed and reconfigured."""

    healthy: ClosedLoop
    fixed: ClosedLoop
    adaptive: ClosedLoop

    def rms(self, closed: ClosedLoop, start: float, end: float = np.inf) -> float:
        """RMS of the pitch rate [deg/s] about the flight that does not fail, from `start` to `end` [s]."""
        rows = (closed.t >= start - 1e-9) & (closed.t < end - 1e-9)
        return float(np.sqrt(np.mean((closed.state[rows, 1] - self.healthy.state[rows, 1]) ** 2)))

    @property
    def numbers(self) -> dict[str, float]:
        """As `f16_failure.Failed.numbers`, of these flights."""
        seen = np.flatnonzero(np.asarray(self.adaptive.extra["alarm"]) & (self.adaptive.t >= FAILURE - 1e-9))
        told = {
            f"{name}_rms_{part}": self.rms(closed, *span)
            for name, closed in (("fixed", self.fixed), ("adaptive", self.adaptive))
            for part, span in (("after", (SETTLED,)), ("transient", (FAILURE, SETTLED)))
        }
        return {**told, "detection_delay_s": float(seen[0] / f16.RATE - FAILURE) if len(seen) else np.inf}


def fly(gain_after: float, *, seed: int, about: str = "trim", seconds: float = f16.SECONDS, **links: Any) -> Flown:
    """Fly the doublets three times: unfailed, and with the gain dropping at 4.5 s under either law.

    `about`: "trim" or "zero", see `JsbsimF16`. Links as in `close_loop`. Needs the extra `flight`.
    """
    aircraft, healthy = JsbsimF16(gain_after, failure_time=FAILURE, about=about), JsbsimF16()
    fixed, estimator = law(healthy.model), watched(healthy.model)
    t = np.arange(round(seconds * f16.RATE) + 1) / f16.RATE
    given: dict[str, Any] = {
        "reference": doublets(t), "seed": seed, "prior": Prior(np.zeros(3), np.zeros((3, 3))),
        "dt": 1 / f16.RATE, "lost": "hold", **links,
    }  # fmt: skip
    return Flown(
        close_loop(healthy, fixed, estimator, **given), close_loop(aircraft, fixed, estimator, **given),
        close_loop(aircraft, GainReconfiguration(fixed), estimator, **given),
    )  # fmt: skip


def doublets(t: np.ndarray) -> np.ndarray:
    """Three pitch-rate doublets [deg/s], period 4.5 s, then zero, each step through 10 / (s + 10): exact at the times t [s]."""
    edges = np.arange(0.0, 13.5 + 1e-9, 2.25)
    steps = COMMAND * np.array([1.0, -2.0, 2.0, -2.0, 2.0, -2.0, 1.0])
    since = np.maximum(np.asarray(t, float)[:, None] - edges, 0.0)
    return -np.expm1(-QUICK * since) @ steps


def with_upset(model: StateSpace) -> StateSpace:
    """The model with a third state, an elevator that upsets the trim; it walks."""
    A = np.block([[model.A, model.B], [np.zeros((1, 3))]])
    Q = np.block([[model.Q, np.zeros((2, 1))], [np.zeros((1, 2)), np.array([[UPSET]])]])
    names = {"states": (*f16.STATES, "upset_deg"), "inputs": f16.INPUTS, "outputs": f16.OUTPUTS}
    return StateSpace(A, np.vstack([model.B, [[0.0]]]), np.eye(2, 3), Q=Q, R=model.R, dt=0, **names)


def watched(model: StateSpace) -> ChangeDetection:
    """What believes in a gain of 1 until it fails; the upset stands for what lasts, so that the noise need not."""
    return ChangeDetection(
        UnknownGain(with_upset(model), Prior([1.0], [[0.0]])), jump=JUMP, length=LENGTH, persistence=1.0,
        seconds_between_false_alarms=FALSE_ALARMS,
    )  # fmt: skip


def law(model: StateSpace) -> StateFeedback:
    """The pitch rate follows its command, with the least squares of error and elevator; the upset is taken back."""
    plain = StateSpace(model.A, model.B, dt=0)
    F = lqr_gain(plain, np.diag([0.0, 1.0]), np.eye(1)).feedback
    still = np.linalg.solve(-(model.A - model.B @ F), model.B)  # (alpha, q) in the end, of an input of 1
    return StateFeedback(np.hstack([F, [[1.0]]]), reference_gain=[[1 / still[1, 0]]])
