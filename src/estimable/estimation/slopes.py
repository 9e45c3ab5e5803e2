"""The likelihood of a record, its derivatives along directions, and Fisher's information about them, in one pass."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..engines import choice
from ..engines.derivatives import Along, Sloped
from ..filters.belief import Belief
from ..kernels.innovation_information import features
from ..models.complex_step import along_each, slope_of, value_of
from ..models.sampled import Clock
from ..results import Interval, Sample
from .binding import Bound, prepared

Build = Callable[[np.ndarray], tuple[Any, Any]]  # the algorithm and the prior at θ (d,), which may be complex


class Rows(NamedTuple):
    """A record bound to an algorithm: its rows, and the times that its model is sampled at (None: it needs no sampling)."""

    samples: Sample
    intervals: Interval
    clock: Clock | None = None
    complete: bool = False
    fresh: Belief | None = None

    @staticmethod
    def of(bound: Bound) -> "Rows":
        """The rows of a bound record."""
        return Rows(bound.samples, bound.intervals, bound.clock, bound.complete, bound.fresh)


class Ascent(NamedTuple):
    """At θ (d,): the log-likelihood, its `score` (d,), the `information` (d, d), and the first failure."""

    log_likelihood: float
    score: np.ndarray
    information: np.ndarray
    code: int = 0
    failed_at: int = 0


def ascent(build: Build, θ: np.ndarray, rows: Rows, engine: str = "auto") -> tuple[str, Ascent]:
    """The engine that ran, and the derivatives of the likelihood with respect to θ. Cost: ceil(d / 8) passes of 8 lanes."""
    moved, prior = along_each(build, np.asarray(θ, float))
    ready: Any = moved if rows.clock is None else prepared(moved, rows.clock, rows.complete, rows.fresh, len(θ))
    along = Along(value_of(ready), slope_of(ready))
    prior = (value_of(prior), slope_of(prior))
    sums = Sums(len(θ))
    ran, run = choice.scan_in_blocks(
        engine, along, prior, rows.samples, rows.intervals, axes=(0, None, 0), keep="all", select=row, use=sums.add
    )
    code, at = int(np.asarray(run.code)[0]), int(np.asarray(run.failed_at)[0])
    return ran, Ascent(float(np.asarray(run.log_likelihood)[0]), sums.score, sums.information, code, at)


def ascent_over(builds: Sequence[Build], θ: np.ndarray, rows: Sequence[Rows]) -> Ascent:
    """The derivatives of the likelihood of several records, each with its own algorithm, and the first failure."""
    ends = [ascent(build, θ, one)[1] for build, one in zip(builds, rows, strict=True)]
    first = next((end for end in ends if end.code), ends[0])
    return Ascent(
        sum(end.log_likelihood for end in ends), np.sum([end.score for end in ends], axis=0),
        np.sum([end.information for end in ends], axis=0), first.code, first.failed_at,
    )  # fmt: skip


class Sums:
    """The sums over all rows."""

    def __init__(self, d: int):
        self.score, self.information = np.zeros(d), np.zeros((d, d))

    def add(self, kept: tuple[np.ndarray, np.ndarray], first: int) -> None:
        """A block of rows: the slopes of the log-likelihood (d, rows), and the features (d, rows, f)."""
        slopes, found = kept
        Φ = found.reshape(len(found), -1)
        self.score += slopes.sum(axis=1)
        self.information += Φ @ Φ.T


def row(sloped: Sloped, keep: str) -> tuple[Any, Any]:
    """The slope of the log-likelihood of a sample, and the rows of its information."""
    info, slope = sloped.info, sloped.slope
    return slope.log_likelihood, features(
        info.innovation, info.innovation_covariance, slope.innovation, slope.innovation_covariance
    )
