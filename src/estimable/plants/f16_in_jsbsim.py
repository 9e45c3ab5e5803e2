"""The effect of an elevator failure on the nonlinear F-16 of JSBSim, with a fixed and with a reconfigured control law.

In addition to the short period, the estimator has a third state, the upset: the elevator deflection with the same effect on
the trim as everything that the linear model omits. It is a random walk. The law feeds it back with gain one, which restores
the trim.
"""

from typing import Any, NamedTuple

import numpy as np

from .. import checks
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

COMMAND = 2.5  # [deg/s]: an elevator with .3 of its effect follows these doublets within its limits
QUICK = 10.0  # [1/s]: 10 / (s + 10), fast enough to distinguish a lost gain from a random-walk upset
UPSET = 0.1  # [deg²/s]: diffusion of the upset, as Mach and alpha change
FALSE_ALARMS = 300.0  # [s]


@saved
class Flown(NamedTuple):
    """The result of `fly`: three flights of the aircraft of JSBSim, without a failure (`healthy`), and with it under two
    laws.

    `fixed` is the flight under the fixed law, and `adaptive` the flight under the reconfigured law.
    """

    healthy: ClosedLoop
    fixed: ClosedLoop
    adaptive: ClosedLoop

    def rms(self, closed: ClosedLoop, start: float, end: float = np.inf) -> float:
        """The RMS difference of the pitch rate of `closed` from that of `healthy` between `start` and `end` [s], in deg/s."""
        rows = (closed.t >= start - 1e-9) & (closed.t < end - 1e-9)
        return float(np.sqrt(np.mean((closed.state[rows, 1] - self.healthy.state[rows, 1]) ** 2)))

    @property
    def numbers(self) -> dict[str, float]:
        """The RMS [deg/s] from the failure to 6 s (`transient`) and later (`after`) of both failed flights, and the detection
        delay [s].
        """
        seen = np.flatnonzero(np.asarray(self.adaptive.extra["alarm"]) & (self.adaptive.t >= FAILURE - 1e-9))
        rms = {
            f"{name}_rms_{part}": self.rms(closed, *span)
            for name, closed in (("fixed", self.fixed), ("adaptive", self.adaptive))
            for part, span in (("after", (SETTLED,)), ("transient", (FAILURE, SETTLED)))
        }
        return {**rms, "detection_delay_s": float(seen[0] / f16.RATE - FAILURE) if len(seen) else np.inf}


def fly(gain_after: float, *, seed: int, about: str = "trim", seconds: float = f16.SECONDS, **links: Any) -> Flown:
    """Simulate three flights in JSBSim: without a failure, and with a loop gain that drops to `gain_after` at 4.5 s, under
    two laws.

    The laws are a fixed one and a reconfigured one. The command is that of `doublets`. `about`: "trim" or "zero", as in
    `JsbsimF16`. `links`: `input_link` and `output_link` as in `close_loop`. Needs the extra `flight`.
    """
    faults = checks.Faults()
    seconds = faults.number("seconds", seconds, lower=0.0, unit="seconds")
    faults.finish()
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
    """The pitch-rate command [deg/s] at the times t [s]: three doublets, then zero.

    A doublet is +2.5 and then -2.5 deg/s, and lasts 4.5 s. The command is filtered by 10 / (s + 10), exactly at the times t.
    """
    edges = np.arange(0.0, 13.5 + 1e-9, 2.25)
    steps = COMMAND * np.array([1.0, -2.0, 2.0, -2.0, 2.0, -2.0, 1.0])
    faults = checks.Faults()
    times = np.asarray(faults.array("t", t, "T"))
    faults.finish()
    since = np.maximum(times[:, None] - edges, 0.0)
    return -np.expm1(-QUICK * since) @ steps


def with_upset(model: StateSpace) -> StateSpace:
    """The model with a third state, the upset: a random walk that acts like an additional deflection of the elevator."""
    A = np.block([[model.A, model.B], [np.zeros((1, 3))]])
    Q = np.block([[model.Q, np.zeros((2, 1))], [np.zeros((1, 2)), np.array([[UPSET]])]])
    names = {"states": (*f16.STATES, "upset_deg"), "inputs": f16.INPUTS, "outputs": f16.OUTPUTS}
    return StateSpace(A, np.vstack([model.B, [[0.0]]]), np.eye(2, 3), Q=Q, R=model.R, dt=0, **names)


def watched(model: StateSpace) -> ChangeDetection:
    """A change detector for `with_upset(model)`, which assumes a gain of 1 until it detects a change.

    The additional state of that model, the upset, represents lasting disturbances.
    """
    return ChangeDetection(
        UnknownGain(with_upset(model), Prior([1.0], [[0.0]])), jump=JUMP, seconds_between_false_alarms=FALSE_ALARMS,
    )  # fmt: skip


def law(model: StateSpace) -> StateFeedback:
    """An LQR law for the pitch rate, which follows its command. The law also cancels the estimated upset."""
    plain = StateSpace(model.A, model.B, dt=0)
    F = lqr_gain(plain, np.diag([0.0, 1.0]), np.eye(1)).feedback
    still = np.linalg.solve(-(model.A - model.B @ F), model.B)  # steady state (alpha, q) for an input of 1
    return StateFeedback(np.hstack([F, [[1.0]]]), reference_gain=[[1 / still[1, 0]]])
