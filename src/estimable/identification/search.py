"""The search that identifiers ask for: the maximum of a likelihood whose step they declare."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..annotations import Tree
from ..engines import choice
from ..engines.step import Stepping
from ..errors import AssumptionError
from ..estimation.climb import Limits, climb
from ..estimation.slopes import Ascent, Rows, ascent_over
from ..kernels.innovation_information import Build, Maximum
from ..results import Info, Interval, Sample


def maximise(build: Build, rows: Sequence[Sample], start: np.ndarray, stride: np.ndarray) -> Maximum:
    """The maximum reached from `start`; see `kernels.innovation_information.Search`.

    Raises `AssumptionError` where the likelihood is not finite there.
    """
    bound = [Rows(samples, _intervals(samples)) for samples in rows]
    builds = [_of_record(build, i) for i in range(len(bound))]

    def at(θ: np.ndarray) -> Ascent:
        return ascent_over(builds, θ, bound)

    far = np.full(len(start), np.inf)
    found = climb(at, start, Limits(-far, far, stride))
    if not np.isfinite(found.end.log_likelihood):
        raise AssumptionError("the likelihood is not finite at the start of the search: the model may be unstable.")
    innovations = [_innovations(*build(found.θ, i), one) for i, one in enumerate(bound)]
    return Maximum(found.θ, found.end.log_likelihood, found.end.information, innovations, found.converged)


def _of_record(build: Build, i: int) -> Callable[[np.ndarray], tuple[Any, Any]]:
    """The step and the prior of one record at θ."""
    return lambda θ: build(θ, i)


def _intervals(samples: Sample) -> Interval:
    return Interval(samples.u, samples.u, None, np.ones(len(samples.y)))


def _innovations(step: Stepping, prior: Tree, rows: Rows) -> tuple[np.ndarray, np.ndarray]:
    """The innovations of a record and their covariances."""
    _, run = choice.scan("auto", step, prior, rows.samples, rows.intervals, keep="all", select=_kept)
    e, V = run.info
    return np.asarray(e), np.asarray(V)


def _kept(info: Info, keep: str) -> tuple[Any, Any]:
    return info.innovation, info.innovation_covariance
