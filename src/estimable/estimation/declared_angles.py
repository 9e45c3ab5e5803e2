"""The angles that a model and a record declare, together."""

from typing import Any

import numpy as np

from .. import checks
from ..data import undeclared
from ..data.record import Record
from ..filters.reported import Reported
from ..frozen import replace
from ..identifiers.channels import Channels
from ..models import angles
from ..models.angles import Angles
from ..models.nonlinear_model import NonlinearModel
from ..models.state_space import StateSpace
from ..protocols import Algorithm
from ..results import Info, Names
from .following import with_model


def angles_of(model: StateSpace | NonlinearModel | Channels) -> Angles:
    """The angles among the states and outputs of a model; none of channels without a model."""
    return model.angles if isinstance(model, StateSpace | NonlinearModel) else ()


def of_both(
    model: StateSpace | NonlinearModel | Channels, record: Record, columns: list[int], faults: checks.Faults
) -> Angles:
    """The angles among the states and outputs of the model. `columns`: those of its outputs in the record."""
    declared: dict[str, Any] = {name: span for name, *span in angles_of(model)}
    in_record = {name: span for name, *span in record.angles}
    for output, column in zip(model.outputs, columns, strict=False):
        span = in_record.get(record.outputs[column])
        if span is None:
            continue
        if output in declared and declared[output][1] != span[1]:
            faults.add(
                f"the model says that the period of {output!r} is {declared[output][1]:g}, the record says {span[1]:g}: they "
                "must be equal."
            )
        declared.setdefault(output, span)
    return tuple(sorted((name, *span) for name, span in declared.items()))


def with_angles(algorithm: Algorithm[Any], found: Angles) -> Any:
    """The algorithm with a model that has these angles."""
    inner = algorithm.innermost
    if not found or not isinstance(inner.model, StateSpace | NonlinearModel) or inner.model.angles == found:
        return algorithm
    return with_model(algorithm, lambda model: replace(model, angles=found))


def check_undeclared(y: np.ndarray, names: Names, found: Angles, faults: checks.Faults) -> None:
    """Point out the outputs y (.., T, p) that jump by a turn and are not declared."""
    undeclared.check(y, names.outputs, [name for name, *_ in found], faults)


def reported(algorithm: Algorithm[Any], names: Names) -> Any:
    """A sampled algorithm that reports each angle in its range."""
    found = tuple(one for one in names.angles if one[0] in names.states)
    return Reported(algorithm, found, names.states) if found else algorithm


def ranged(info: Info, names: Names) -> Info:
    """Reports (.., n) with each angle in its range."""
    mean = angles.ranged(info.mean, names.angles, names.states)
    return info if mean is info.mean else replace(info, mean=mean)
