"""The flights of chapter 5: a gain that drops at 4.5 s, flown many times, and the criteria for its estimate."""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from ...filters.unknown_gain import UnknownGain
from ...models.prior import Prior
from ...plants import f16
from ...protocols import Algorithm
from ...results import MonteCarlo
from ...simulation.monte_carlo import monte_carlo

GAINS = (0.8, 0.6, 0.4, 0.2, 0.1)  # K1
FAILURE = 4.5  # [s]
BAND = 0.2  # |K - K1| <= .2 K1
SEED = 1999
NOMINAL = MappingProxyType({"sigma_alpha": f16.SIGMA_ALPHA, "sigma_q": f16.SIGMA_Q})  # 37.227 dB
STATE = Prior([-1.4414, -2.4314], [[0.1, 0.0], [0.0, 1.0]])  # deliberately poor, as in the thesis
GAIN = Prior([0.8], [[0.4]])
HELD, CONTINUOUS = f16.SIMULATIONS[1], f16.SIMULATIONS[0]
HELD_REMARK = (
    "Published numbers are compared with those of the simulation of the thesis, in which the elevator is held over each sample. "
    '"continuous actuator" is the same flight with an elevator that moves between the samples, which the filter models.'
)


def filter_of(**noise: float) -> UnknownGain:
    """The joint filter of state and gain, with the prior of the gain in the thesis."""
    return UnknownGain(f16.short_period(**noise), GAIN)


def fly(
    algorithm: Algorithm[Any], gain: float, draws: int, summary: Callable[[Any, Any], dict[str, Any]], *, simulation: str = HELD,
    noise: Mapping[str, float] = NOMINAL,
) -> MonteCarlo:  # fmt: skip
    """Estimate over `draws` flights in which the gain drops to `gain`; `noise`: sigmas of the sensors."""
    draw = f16.drawn_flight(gain, failure_time=FAILURE, simulation=simulation, **noise)
    return monte_carlo(algorithm, draw, prior=STATE, runs=draws, seed=SEED, summary=summary)


def within(estimated: np.ndarray, gain: float) -> np.ndarray:
    """Whether the estimates after the failure are within 20 % of the gain."""
    return np.abs(estimated[round(FAILURE * f16.RATE) :] - gain) <= BAND * gain


def settled(estimated: np.ndarray, gain: float) -> float:
    """Seconds after the failure until the estimate stays within 20 %; NaN if it never does.

    >>> settled(np.append(np.ones(450), [1.0, 0.5, 1.0, 0.5, 0.5]), 0.5)
    0.03
    """
    out = np.flatnonzero(~within(estimated, gain))
    after = len(estimated) - round(FAILURE * f16.RATE)
    first = 0 if len(out) == 0 else int(out[-1]) + 1
    return first / f16.RATE if first < after else float("nan")


def reached(estimated: np.ndarray, gain: float) -> float:
    """Seconds after the failure until the estimate is within 20 % for the first time; NaN if it never is.

    >>> reached(np.append(np.ones(450), [1.0, 0.5, 1.0, 0.5, 0.5]), 0.5)
    0.01
    """
    inside = within(estimated, gain)
    return int(np.argmax(inside)) / f16.RATE if inside.any() else float("nan")


def stayed(estimated: np.ndarray, gain: float, *, seconds: float) -> float:
    """Seconds after the failure until the estimate is within 20 % for `seconds` without interruption; NaN if it never is.

    >>> stayed(np.append(np.ones(450), [1.0, 0.5, 1.0, 0.5, 0.5]), 0.5, seconds=0.02)
    0.03
    """
    inside = within(estimated, gain)
    length = round(seconds * f16.RATE)
    counts = np.cumsum(np.append(0, inside))
    runs = counts[length:] - counts[:-length] == length
    return int(np.argmax(runs)) / f16.RATE if runs.any() else float("nan")
