"""The quantities of a result that are drawn, each with its standard deviation, which is infinite if it is unknown."""

from typing import Any, NamedTuple

import numpy as np

from ..tables import at_its_instant, diffuse_of, standard_deviation

MOST_FLAT = 3.0  # a band wider than this factor times the range of most rows is cropped


class Band(NamedTuple):
    """One quantity over time: `middle` (T,), its standard deviation `sigma` (T,) or None, its kind, its period if an angle."""

    name: str
    kind: str
    middle: np.ndarray
    sigma: np.ndarray | None
    period: float = 0.0


def broken(t: np.ndarray, panel: Band) -> tuple[np.ndarray, Band]:
    """The times and the quantity, with a row of NaN where an angle passes from one end of its range to the other."""
    if not panel.period:
        return t, panel
    after = np.flatnonzero(np.abs(np.diff(panel.middle)) > panel.period / 2) + 1
    sigma = None if panel.sigma is None else np.insert(panel.sigma, after, np.nan)
    return np.insert(t, after, t[after]), panel._replace(middle=np.insert(panel.middle, after, np.nan), sigma=sigma)


def value_range(middle: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> tuple[float, float]:
    """The range of values to draw: without the widest tenth of the band, which a vague prior causes.

    >>> low, high = value_range(np.zeros(40), np.array([-100.0] + 39 * [-1.0]), np.ones(40))
    >>> bool(-1.2 < low < -1 and 1 < high < 1.2)
    True
    """
    known = np.isfinite(lower) & np.isfinite(upper)
    if not known.any():
        return -1.0, 1.0
    low = min(np.quantile(lower[known], 0.1), np.quantile(middle[known], 0.02))
    high = max(np.quantile(upper[known], 0.9), np.quantile(middle[known], 0.98))
    room = 0.05 * (high - low) or 0.1 * max(abs(high), 1e-12)
    return float(low - room), float(high + room)


def cropped(panel: Band) -> tuple[float, float] | None:
    """The range of an axis on which a vague prior would flatten the curve; None if the full range is suitable."""
    if panel.sigma is None:
        return None
    seen = np.isfinite(panel.sigma) & ~np.isnan(panel.middle)
    if not seen.any():
        return None
    middle, spread = panel.middle[seen], 2 * panel.sigma[seen]
    centre = 0.0 * middle if panel.kind == "innovation" else middle
    lower, upper = centre - spread, centre + spread
    low, high = value_range(middle, lower, upper)
    low, high = min(low, middle.min()), max(high, middle.max())
    return (float(low), float(high)) if upper.max() - lower.min() > MOST_FLAT * (high - low) else None


def bands(result: Any) -> list[Band]:
    """The states, gains and unknown inputs of a result, then its innovations."""
    diffuse, names, delay = diffuse_of(result), result.names, result.names.input_delay
    periods = {name: period for name, _, period in names.angles}
    inputs = [
        at_its_instant("unknown_input", values, delay)
        for values in (result.unknown_input, result.unknown_input_covariance, diffuse["unknown_input"])
    ]
    return [
        *(
            band._replace(period=periods.get(band.name, 0.0))
            for band in _of("state", names.states, result.mean, result.covariance, diffuse["mean"])
        ),
        *_gains(result, diffuse["gain"]),
        *_of("unknown_input", tuple(map(names.labelled, names.unknown_inputs)), *inputs),
        *_of(
            "innovation",
            tuple(map(result.names.labelled, result.names.outputs)),
            result.innovation,
            result.innovation_covariance,
        ),
    ]


def _gains(result: Any, diffuse: np.ndarray | None) -> list[Band]:
    """The gains; where their distribution is not Gaussian, the median and the width of the 95 % interval over 3.92."""
    if result.gain_quantiles is None:
        return _of("gain", result.names.gains, result.gain, result.gain_covariance, diffuse)
    median, sigma = result.gain_standing
    sigma = np.where(np.isnan(median), np.inf, sigma)
    return [Band(name, "gain", median[:, i], sigma[:, i]) for i, name in enumerate(result.names.gains)]


def _of(
    kind: str, names: tuple[str, ...], values: np.ndarray, covariance: np.ndarray, diffuse: np.ndarray | None = None
) -> list[Band]:
    if values is None:
        return []
    sigma = None if covariance is None else standard_deviation(covariance, diffuse)
    columns = np.asarray(values).T
    return [Band(name, kind, columns[i], None if sigma is None else sigma[:, i]) for i, name in enumerate(names)]
