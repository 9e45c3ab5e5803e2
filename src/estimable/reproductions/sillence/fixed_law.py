"""The fixed law when the elevator fails: Figs. 14 to 18 (PI) and 21, 22 (proportional)."""

from collections.abc import Callable
from typing import Any

import numpy as np

from ...filters.kalman_filter import Kalman
from ...models.prior import Prior
from ...plants import f16
from ...results import ClosedLoop
from ...simulation.close_loop import close_loop
from ..entries import Reproduced, ReproducedRow
from .flights import CONTINUOUS, FAILURE

EXACT = {"sigma_alpha": 1e-9, "sigma_q": 1e-9}
SETTLED = 6.0  # [s]
REMARK = (
    "The figure prints no number; ours are computed from its two curves. The true states are fed back, without noise; the "
    "actuator moves between the samples."
)


def flight(gain_after: float, *, integral: bool) -> Callable[[int], Reproduced]:
    """Pitch rate and alpha under the fixed law, the gain dropping to `gain_after` at 4.5 s."""

    def compute(_: int) -> Reproduced:
        healthy, failed = (_fly(gain, integral) for gain in (1.0, gain_after))
        parts = {"4.5 to 6 s": (failed.t >= FAILURE - 1e-9) & (failed.t < SETTLED - 1e-9),
                 "after 6 s": failed.t >= SETTLED - 1e-9}  # fmt: skip
        apart = failed.state - healthy.state
        rows = tuple(
            ReproducedRow(f"RMS of {what} about the flight without a failure, {part}", unit, None,
                float(np.sqrt(np.mean(apart[at, column] ** 2))))
            for column, what, unit in ((1, "the pitch rate", "deg/s"), (0, "alpha", "deg"))
            for part, at in parts.items()
        )  # fmt: skip
        return Reproduced(rows, lambda: _figure(healthy, failed), (REMARK,))

    return compute


def _fly(gain: float, integral: bool) -> ClosedLoop:
    """The loop that feeds back the measurement, which is the state."""
    t = np.arange(round(f16.SECONDS * f16.RATE) + 1) / f16.RATE
    measured = Kalman(f16.short_period(Q=1e6 * np.eye(2), **EXACT))
    return close_loop(
        f16.controlled(gain, failure_time=FAILURE, simulation=CONTINUOUS, **EXACT), f16.law(integral=integral), measured,
        reference=f16.pitch_command(t), seed=0, prior=Prior([0.0, 0.0], np.zeros((2, 2))), dt=1 / f16.RATE,
    )  # fmt: skip


def _figure(healthy: ClosedLoop, failed: ClosedLoop) -> Any:
    from .. import plots

    panels = [
        plots.Panel(label, [plots.Line("does not fail", healthy.t, healthy.state[:, column], plots.INK, "dash", 1.2),
                            plots.Line("fails at 4.5 s", failed.t, failed.state[:, column], 0)])
        for label, column in (("pitch rate [deg/s]", 1), ("alpha [deg]", 0))
    ]  # fmt: skip
    return plots.over_time(panels)
