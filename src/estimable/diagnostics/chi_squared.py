"""The χ² distribution, from `scipy.special`: importing `scipy.stats` takes most of a second."""

import numpy as np

from ..annotations import Numbers


def quantile(probability: Numbers, degrees: Numbers) -> np.ndarray:
    """The value that χ² with these degrees of freedom is below with a probability."""
    from scipy.special import gammaincinv

    return 2 * gammaincinv(np.asarray(degrees) / 2, probability)


def exceeded(value: Numbers, degrees: Numbers) -> np.ndarray:
    """The probability that χ² with these degrees of freedom is above a value."""
    from scipy.special import gammaincc

    return gammaincc(np.asarray(degrees) / 2, np.asarray(value) / 2)
