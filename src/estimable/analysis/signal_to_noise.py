"""The signal-to-noise ratio of the outputs of a plant, and the noise for a given ratio."""

import numpy as np

from .. import checks
from ..annotations import Numbers


def signal_to_noise(largest: Numbers, sigma: Numbers, *, weight: Numbers = 1.0) -> float:
    """The signal-to-noise ratio of several outputs, in dB: 10 log10 (Σ w_i² a_i² / (2 Σ w_i² σ_i²)).

    - `largest` a (p,): the largest value of each output in the manoeuvre. A sinusoid of this size has half its square as power.
    - `sigma` (p,): the standard deviations of the sensors.
    - `weight` w (p,): the scale of each output relative to the first, which makes their units alike (default 1). For an angle and
      its rate the source has (1, w) with w = 1 / sqrt|p1 p2|, p1 and p2 the poles of the plant.

    Returns the ratio in dB. Raises `InputError` for numbers that do not fit.

    Reference: A. G. Sillence (1999), (82).

    >>> signal_to_noise([1.0], [0.1]).__round__(3)  # 10 log10 (1 / .02)
    16.99
    """
    a, s, w = _read(largest, sigma, weight)
    return float(10 * np.log10(np.sum((w * a) ** 2) / (2 * np.sum((w * s) ** 2))))


def noise_at(ratio: float, largest: Numbers, sigma: Numbers, *, weight: Numbers = 1.0) -> np.ndarray:
    """The standard deviations k `sigma` of the sensors at which `signal_to_noise` is `ratio`, in dB.

    The other arguments are as in `signal_to_noise`. (The source's (84) multiplies by k², where noises k σ divide by it.)

    Returns (p,). Raises `InputError` for numbers that do not fit.

    Reference: A. G. Sillence (1999), (83)-(84).

    >>> noise_at(16.9897, [1.0], [5.0]).round(4).tolist()
    [0.1]
    """
    faults = checks.Faults()
    faults.number("ratio", ratio)
    faults.finish()
    k = 10 ** ((signal_to_noise(largest, sigma, weight=weight) - ratio) / 20)
    return k * np.asarray(sigma, float)


def _read(largest: Numbers, sigma: Numbers, weight: Numbers) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    faults = checks.Faults()
    a, s = faults.array("largest", largest, "p"), faults.array("sigma", sigma, "p")
    size = 1 if a is None else len(a)
    w = faults.array("weight", [weight] * size if checks.depth(weight) == 0 else weight, "p")
    for name, values in (("largest", a), ("sigma", s), ("weight", w)):
        if values is not None and (np.any(values < 0) or not np.any(values)):
            faults.add(
                f"`{name}` must be at least 0, and above 0 for at least one output. Got {checks.short(values.tolist())}."
            )
    faults.finish()
    return a, s, w  # type: ignore[return-value]
