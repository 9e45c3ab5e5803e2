"""The command divided by the gain of the window: Figs. 40 to 47, K1 = 0.2."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from ...controllers.gain_reconfiguration import GainReconfiguration
from ...filters.bounded import Bounded
from ...filters.kalman_filter import Kalman
from ...filters.smoothed import Smoothed
from ...models.prior import Prior
from ...plants import f16
from ...results import ClosedLoopBank
from ...simulation.close_loop import close_loop, close_loop_bank
from ..entries import Reproduced, drawn
from .flights import FAILURE, HELD, SEED, STATE
from .window import NOISES, WEIGHT, window

GAIN_AFTER = 0.2
SETTLED = 6.0  # [s]
EXACT = 1e-9
AT_A_TIME = 50  # runs whose windows are in memory together
REMARK = (
    "The figures show one draw and print no number; ours are over all draws. RMS is of the true pitch rate relative to the "
    "flight without a failure, without noise. The elevator is held over each sample; the estimate of the window is fed back."
)
GUARD = "Whether or not the estimate is bounded to 0..1, the demand is multiplied by at most 20: K is limited to at least 0.05."


class AdaptedFlights(NamedTuple):
    """Pitch rate [deg/s] and smoothed gain of each draw, (draws, T)."""

    pitch_rate: np.ndarray
    gain: np.ndarray


def adapted(snr: float, *, bounded: bool) -> Callable[[int], Reproduced]:
    """The pitch rate with adaptation, at a signal-to-noise ratio in dB."""

    def compute(draws: int) -> Reproduced:
        return _reproduced({"adapted": _fly(NOISES[snr], draws, bounded=bounded, adapts=True)}, bounded)

    return compute


def compared(draws: int) -> Reproduced:
    """Figs. 42 to 44: pitch rate and gain with and without adaptation, at 37.227 dB."""
    ways = {"adapted": True, "fixed law": False}
    return _reproduced(
        {name: _fly(NOISES[37.227], draws, bounded=True, adapts=adapts) for name, adapts in ways.items()}, True
    )


def _time() -> np.ndarray:
    return np.arange(round(f16.SECONDS * f16.RATE) + 1) / f16.RATE


def _fly(noise: Mapping[str, float], draws: int, *, bounded: bool, adapts: bool) -> AdaptedFlights:
    """Fly the signal chain of the thesis, `AT_A_TIME` runs at a time."""
    inner = Bounded(window(**noise), 0.0, 1.0) if bounded else window(**noise)
    law = GainReconfiguration(f16.law(), caution=0.0) if adapts else f16.law()
    given: dict[str, Any] = {"reference": f16.pitch_command(_time()), "prior": STATE, "dt": 1 / f16.RATE}
    plant = f16.controlled(GAIN_AFTER, failure_time=FAILURE, simulation=HELD, **noise)
    banks: list[ClosedLoopBank] = []
    for first in range(0, draws, AT_A_TIME):
        size = min(AT_A_TIME, draws - first)
        banks.append(close_loop_bank(plant, law, Smoothed(inner, WEIGHT), runs=size, seed=SEED + first, **given))
    return AdaptedFlights(
        np.concatenate([bank.runs.state[..., 1] for bank in banks]),
        np.concatenate([np.asarray(bank.runs.info.gain)[..., 0] for bank in banks]),
    )


def _healthy() -> np.ndarray:
    """The pitch rate of the flight without a failure."""
    exact = {"sigma_alpha": EXACT, "sigma_q": EXACT}
    closed = close_loop(
        f16.controlled(simulation=HELD, **exact), f16.law(), Kalman(f16.short_period()), seed=0, dt=1 / f16.RATE,
        reference=f16.pitch_command(_time()), prior=Prior([0.0, 0.0], np.zeros((2, 2))),
    )  # fmt: skip
    return closed.state[:, 1]


def _reproduced(flown: dict[str, AdaptedFlights], bounded: bool) -> Reproduced:
    t, healthy = _time(), _healthy()
    parts = {"4.5 to 6 s": (t >= FAILURE - 1e-9) & (t < SETTLED - 1e-9), "after 6 s": t >= SETTLED - 1e-9}
    rows = [
        drawn(f"RMS of the pitch rate, {part}, {name}", "deg/s", None, _rms(run.pitch_rate[:, at] - healthy[at]))
        for name, run in flown.items()
        for part, at in parts.items()
    ]
    rows += [
        drawn(f"smoothed gain, last 2 s, {name}", "", None, run.gain[:, -200:].mean(axis=1))
        for name, run in flown.items()
    ]

    def figure() -> Any:
        from .. import plots

        rates = [plots.Line("flight without a failure", t, healthy, plots.INK, "dash", 1.2)]
        rates += [plots.Line(name, t, run.pitch_rate[0], i) for i, (name, run) in enumerate(flown.items())]
        gains = [plots.Line(name, t, run.gain.mean(axis=0), i, sigma=run.gain.std(axis=0)) for i, (name, run) in
                 enumerate(flown.items())]  # fmt: skip
        return plots.over_time(
            [plots.Panel("pitch rate [deg/s], one draw", rates), plots.Panel("smoothed gain", gains)]
        )

    return Reproduced(tuple(rows), figure, (REMARK, GUARD))


def _rms(error: np.ndarray) -> np.ndarray:
    return np.sqrt(np.mean(error**2, axis=1))
