"""The effect of holding a sampled signal: Figs. 11 and 12."""

from collections.abc import Callable
from typing import Any

import numpy as np

from ...plants import f16
from ..entries import Reproduced, ReproducedRow

FINE = 100  # points per sample
COARSE = 0.1  # [s]: slow sampling, so that the effect is visible
REMARK = (
    "A signal held over each sample of T seconds lags by T/2; the first-order lag (2/T)/(s + 2/T) approximates that."
)


def step_response(_: int) -> Reproduced:
    """Fig. 11: a unit step through 3/(s + 3), continuous and held."""
    return _compare(lambda t: np.where(t > 0, -np.expm1(-3 * np.maximum(t, 0)), 0.0), COARSE, 2.0, "response")


def command(_: int) -> Reproduced:
    """Fig. 12: the pitch-rate command, continuous and held over the samples of 0.01 s."""
    return _compare(f16.pitch_command, 1 / f16.RATE, f16.SECONDS, "pitch-rate command [deg/s]")


def _compare(signal: Callable[[np.ndarray], np.ndarray], T: float, seconds: float, label: str) -> Reproduced:
    t = np.arange(round(seconds / T) * FINE) * (T / FINE)
    exact = signal(t)
    held = np.repeat(exact[::FINE], FINE)
    lagged = _lagged(exact, T)
    rows = (
        ReproducedRow("delay of the held signal", "s", T / 2, _delay(exact, held, T)),
        ReproducedRow("delay of the first-order lag", "s", T / 2, _delay(exact, lagged, T)),
    )

    def figure() -> Any:
        from .. import plots

        shown = slice(None, None, max(1, len(t) // 4000))
        lines = [plots.Line("continuous", t[shown], exact[shown], plots.INK, width=1.5),
                 plots.Line("held over a sample", t[::FINE], exact[::FINE], 1, shape="hv"),
                 plots.Line("lag (2/T)/(s + 2/T)", t[shown], lagged[shown], 0, "dash")]  # fmt: skip
        return plots.over_time([plots.Panel(label, lines)])

    return Reproduced(rows, figure, (f"T = {T:g} s. {REMARK}",))


def _lagged(signal: np.ndarray, T: float) -> np.ndarray:
    """The signal through (2/T)/(s + 2/T), exact for a signal that is linear between the points."""
    from scipy.signal import lsim

    t = np.arange(len(signal)) * (T / FINE)
    return lsim(([2 / T], [1.0, 2 / T]), signal, t)[1]


def _delay(signal: np.ndarray, late: np.ndarray, T: float) -> float:
    """The delay τ for which late(t) = signal(t) - τ signal'(t) fits best, in seconds."""
    slope = np.gradient(signal, T / FINE)
    return float(np.sum((signal - late) * slope) / np.sum(slope**2))
