"""Normalised squared errors and innovations, with the band where a right model keeps them."""

from typing import NamedTuple

import numpy as np

from .. import checks


class Consistency(NamedTuple):
    """The mean of a normalised square, what a right model gives, its band, and how many degrees of freedom it has."""

    mean: float
    expected: float
    lower: float
    upper: float
    degrees: int

    @property
    def consistent(self) -> bool:
        """Whether the mean lies in its band."""
        return self.lower <= self.mean <= self.upper

    @property
    def sentence(self) -> str:
        """What it says, in words."""
        band = f"{self.mean:.2f}, expected {self.expected:.2f} ({self.lower:.2f} to {self.upper:.2f})"
        if self.consistent:
            return f"{band}: the covariances are right"
        if self.mean > self.upper:
            return f"{band}: the covariances are too small (Q or R too small, or an effect that is not in the model)"
        return f"{band}: the covariances are too large (Q or R too large)"


def nis(innovation, innovation_covariance, *, probability: float = 0.999) -> Consistency:
    """Mean normalised innovation squared e' S^-1 e over the samples with an output, in units of its outputs.

    `innovation` (..., p), NaN where not seen; `innovation_covariance` (..., p, p). With a right model the sum over all
    samples is χ² with as many degrees of freedom as outputs were seen, so the mean over samples is near p. The band holds
    that mean with `probability`. Raises `InputError` where nothing was seen.

    >>> import numpy as np
    >>> e = np.random.default_rng(1).normal(size=(1000, 2))
    >>> nis(e, np.broadcast_to(np.eye(2), (1000, 2, 2))).consistent
    True
    """
    e = np.asarray(innovation, float)
    e, S = e.reshape(-1, e.shape[-1]), np.asarray(innovation_covariance, float).reshape(-1, e.shape[-1], e.shape[-1])
    seen = ~np.isnan(e)
    squares = np.zeros(len(e))
    for pattern in np.unique(seen, axis=0):
        rows = np.flatnonzero((seen == pattern).all(axis=1))
        if pattern.any():
            squares[rows] = _squares(e[rows][:, pattern], S[rows][:, pattern][:, :, pattern])
    samples = int(seen.any(axis=1).sum())
    if samples == 0:
        checks.refuse("nothing was seen: every innovation is NaN.")
    return _against_chi_square(float(squares.sum()), samples, int(seen.sum()), probability)


def nees(error, covariance, *, probability: float = 0.999) -> Consistency:
    """Mean normalised estimation error squared over independent runs: error (B, n), covariance (B, n, n).

    Errors of one run at different times are correlated: use one time of each run. Raises `InputError` where a covariance
    is singular.

    >>> import numpy as np
    >>> round(nees(np.ones((4, 1)), np.ones((4, 1, 1))).mean, 3)
    1.0
    """
    error = np.asarray(error, float)
    squares = _squares(error, np.asarray(covariance, float))
    if not np.all(np.isfinite(squares)):
        checks.refuse("a covariance is singular: leave out what is known exactly.")
    return _against_chi_square(float(squares.sum()), len(error), error.size, probability)


def _squares(e: np.ndarray, S: np.ndarray) -> np.ndarray:
    """e' S^-1 e of each row, after scaling S to a unit diagonal."""
    scale = np.sqrt(np.einsum("bii->bi", S))
    with np.errstate(divide="ignore", invalid="ignore"):
        scaled, correlation = e / scale, S / (scale[:, :, None] * scale[:, None, :])
    if not np.all(np.isfinite(correlation)):
        return np.full(len(e), np.nan)
    return np.einsum("bi,bi->b", scaled, np.linalg.solve(correlation, scaled[..., None])[..., 0])


def _against_chi_square(total: float, samples: int, degrees: int, probability: float) -> Consistency:
    from scipy.stats import chi2

    tail = (1 - probability) / 2
    lower, upper = chi2.ppf([tail, 1 - tail], degrees) / samples
    return Consistency(total / samples, degrees / samples, float(lower), float(upper), degrees)
