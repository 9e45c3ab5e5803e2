"""Normalised squared errors and innovations, with the band in which a correct model keeps them."""

from typing import NamedTuple

import numpy as np

from .. import checks
from ..annotations import Numbers
from ..frozen import saved
from . import chi_squared

GROSS = 30.0  # times the expected value: no tuning of Q and R explains that
KNOWN = 1e-10  # largest eigenvalue of a correlation matrix of a combination that counts as known exactly


@saved
class Consistency(NamedTuple):
    """The result of `nis` and `nees`: the mean of normalised squares, with a band that contains it under a correct model
    with the `probability` of the call.

    - `mean`: the mean over the samples or runs.
    - `expected`, `lower`, `upper`: the expected value and the limits of the band.
    - `degrees`: the degrees of freedom of the sum of all squares.
    """

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
        """The verdict, as a sentence."""
        band = f"{self.mean:.3f}, expected {self.expected:.3f} ({self.lower:.3f} to {self.upper:.3f})"
        if self.consistent:
            return f"{band}: consistent with the model"
        if self.mean > GROSS * self.expected:
            return f"{band}: the model is grossly wrong (units, time, order or sign of the channels?)"
        if self.mean > self.upper:
            return f"{band}: the covariances are too small (Q or R too small, or an effect that is not in the model)"
        return f"{band}: the covariances are too large (Q, R, the prior or a walk too large)"


def nis(innovation: Numbers, innovation_covariance: Numbers, *, probability: float = 0.999) -> Consistency:
    """The normalised innovation squared (NIS), e' S^-1 e, averaged over all samples with an output.

    e is the innovation and S its covariance. `innovation` (..., p) is NaN for missing outputs. `innovation_covariance`
    (..., p, p) is NaN where it is infinite (a diffuse prior).

    Under a correct model, the sum over all samples has a χ² distribution. Its degrees of freedom are the number of seen
    outputs, so the mean is near p. The band contains the mean with `probability`. Three kinds of innovation do not count:
    those of missing outputs, those predicted from a diffuse state, and combinations that the model determines exactly.

    Returns a `Consistency`. Raises `InputError` if no innovation counts.

    >>> import numpy as np
    >>> e = np.random.default_rng(1).normal(size=(1000, 2))
    >>> nis(e, np.broadcast_to(np.eye(2), (1000, 2, 2))).consistent
    True
    """
    e, S, probability = _read("innovation", innovation, innovation_covariance, probability)
    p = e.shape[-1]
    e, S = e.reshape(-1, p), S.reshape(-1, p, p)
    judged = ~np.isnan(e) & (np.einsum("bii->bi", S) > 0)
    total, samples, degrees = 0.0, 0, 0
    for pattern in np.unique(judged, axis=0):
        rows = np.flatnonzero((judged == pattern).all(axis=1))
        if pattern.any():
            squares, ranks = _squares(e[rows][:, pattern], S[rows][:, pattern][:, :, pattern])
            total, samples, degrees = total + squares.sum(), samples + np.sum(ranks > 0), degrees + ranks.sum()
    if degrees == 0:
        checks.refuse("there is no innovation to judge: no output with a finite, nonzero innovation variance was seen.")
    return _against_chi_square(float(total), int(samples), int(degrees), probability)


def nees(error: Numbers, covariance: Numbers, *, probability: float = 0.999) -> Consistency:
    """The normalised estimation error squared (NEES), e' P^-1 e, averaged over B independent runs.

    `error` (B, n): the error e of each run. `covariance` (B, n, n): its covariance P as reported by the filter. Errors of one
    run at different times are correlated: use one time of each run. Combinations with zero variance do not count.

    Returns a `Consistency`. Raises `InputError` if no error counts.

    >>> import numpy as np
    >>> round(nees(np.ones((4, 1)), np.ones((4, 1, 1))).mean, 3)
    1.0
    """
    error, covariance, probability = _read("error", error, covariance, probability)
    if error.ndim != 2 or np.isnan(error).any() or np.isnan(covariance).any():
        checks.refuse("`error` must be (B, n), one row for each run. It and its covariance must not hold NaN.")
    squares, ranks = _squares(error, covariance)
    if ranks.sum() == 0:
        checks.refuse("there is no error to judge: every covariance is zero.")
    return _against_chi_square(float(squares.sum()), len(squares), int(ranks.sum()), probability)


def _read(name: str, values: Numbers, covariances: Numbers, probability: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Vectors (..., p), their covariances (..., p, p), and a probability between 0 and 1."""
    faults = checks.Faults()
    probability = faults.number("probability", probability, above=0.0, upper=1.0)
    read = []
    for argument, value in (
        (name, values),
        (f"{name}_covariance" if name == "innovation" else "covariance", covariances),
    ):
        read.append(faults.numbers(argument, value, nan=True))
    if not faults.sentences and (read[0].ndim == 0 or read[1].shape != (*read[0].shape, read[0].shape[-1])):
        faults.add(
            f"`{name}` must be (..., p) and its covariance (..., p, p). Got {read[0].shape} and {read[1].shape}."
        )
    faults.finish()
    return read[0], read[1], probability


def _squares(e: np.ndarray, S: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """e' S^+ e of each row and the rank of S, after scaling S to a unit diagonal. Raises `InputError` on overflow."""
    variance = np.einsum("bii->bi", S)
    scale = np.sqrt(np.where(variance > 0, variance, 1.0))
    values, vectors = np.linalg.eigh(S / (scale[:, :, None] * scale[:, None, :]))
    along = np.einsum("bij,bi->bj", vectors, e / scale)
    counted = values > KNOWN
    with np.errstate(over="ignore"):
        squares = np.sum(np.where(counted, along**2 / np.where(counted, values, 1.0), 0.0), axis=1)
    if not np.isfinite(squares).all():
        checks.refuse(
            "the squared errors, relative to their covariances, overflow: no covariance explains such errors."
        )
    return squares, counted.sum(axis=1)


def _against_chi_square(total: float, samples: int, degrees: int, probability: float) -> Consistency:
    tail = (1 - probability) / 2
    lower, upper = chi_squared.quantile([tail, 1 - tail], degrees) / samples
    return Consistency(total / samples, degrees / samples, float(lower), float(upper), degrees)
