"""What is drawn of a result: each quantity with its standard deviation, which is infinite where nothing is known."""

from typing import Any, NamedTuple

import numpy as np

NEGLIGIBLE = 1e-12  # of the largest diffuse variance of a row: rounding, in a direction that has been determined


class Band(NamedTuple):
    """One quantity over time: `middle` (T,), its standard deviation `sigma` (T,) or None, and its kind."""

    name: str
    kind: str
    middle: np.ndarray
    sigma: np.ndarray | None


def standard_deviation(covariance: Any, diffuse: Any = None) -> np.ndarray:
    """Standard deviations (T, n) of covariances (T, n, n); infinite where `diffuse` says that nothing is known.

    >>> standard_deviation([[[4.0]]]).tolist(), standard_deviation([[[4.0]]], [[[1.0]]]).tolist()
    ([[2.0]], [[inf]])
    """
    sigma = np.sqrt(np.maximum(_diagonal(covariance), 0.0))
    if diffuse is None:
        return sigma
    unknown = _diagonal(diffuse)
    largest = unknown.max(axis=-1, keepdims=True, initial=0.0)
    return np.where(unknown > NEGLIGIBLE * largest, np.inf, sigma)


def bands(result: Any) -> list[Band]:
    """The states and gains of a result, then its innovations."""
    gain_diffuse = result.extra.get("gain_diffuse_covariance")
    return [
        *_of("state", result.names.states, result.mean, result.covariance, result.diffuse_covariance),
        *_of("gain", result.names.gains, result.gain, result.gain_covariance, gain_diffuse),
        *_of("innovation", result.names.outputs, result.innovation, result.innovation_covariance),
    ]


def _of(kind: str, names: tuple[str, ...], values: Any, covariance: Any, diffuse: Any = None) -> list[Band]:
    if values is None:
        return []
    sigma = None if covariance is None else standard_deviation(covariance, diffuse)
    return [
        Band(name, kind, np.asarray(values)[:, i], None if sigma is None else sigma[:, i]) for i, name in enumerate(names)
    ]


def _diagonal(matrices: Any) -> np.ndarray:
    return np.diagonal(np.asarray(matrices, float), axis1=-2, axis2=-1)
