"""Loops whose plant or estimator follows a schedule: the course of its channels over the run, or their measurements."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from .. import checks
from ..annotations import Numbers
from ..estimation.following import along_values, channels_of, nominal
from ..models.controlled import ControlledPlant
from ..protocols import Algorithm


class Followed(NamedTuple):
    """The plants with their simulators, and the estimator, along the `course` of their channels, {channel: (T,)}.

    `scheduled`: the estimator before, where it reads some of its channels from the outputs of a simulator, from the columns
    `measured`; the estimator here is then the nominal one. Else None.
    """

    plants: list[tuple[Any, Any]]
    estimator: Any
    course: dict[str, np.ndarray]
    scheduled: Any
    measured: dict[str, int]

    def at(self, k: int, y: np.ndarray) -> Any:
        """The estimator at row k, with the last known outputs y of the plant."""
        for name, column in self.measured.items():
            if np.isnan(y[column]):
                checks.refuse(
                    f"the matrices of the estimator follow {name!r}, whose first reading is lost: give its course."
                )
        values = {name: float(row[k]) for name, row in self.course.items()}
        return along_values(self.scheduled, values | {name: float(y[j]) for name, j in self.measured.items()})


def along(
    plants: Sequence[tuple[Any, Any]],
    estimator: Algorithm[Any],
    schedule: Mapping[str, Numbers] | None,
    reference: Numbers,
) -> Followed:
    """The plants and the estimator of a loop along a schedule. Raises `InputError` with every fault."""
    followed = [plant.scheduled_by for plant, _ in plants if isinstance(plant, ControlledPlant)]
    own = channels_of(estimator) if isinstance(estimator, Algorithm) else ()
    channels = tuple(dict.fromkeys(name for names in (*followed, own) for name in names))
    if not channels and schedule is None:
        return Followed(list(plants), estimator, {}, None, {})
    plant, simulator = plants[0]
    outputs = () if simulator is None else plant.model.outputs
    measured = {name: outputs.index(name) for name in own if name in outputs and name not in (schedule or {})}
    course = _read(schedule, [name for name in channels if name not in measured], _rows(reference))
    flown = [(p.along(course) if isinstance(p, ControlledPlant) else p, simulator) for p, simulator in plants]
    if measured:
        return Followed(flown, nominal(estimator), course, estimator, measured)
    known = along_values(estimator, course) if isinstance(estimator, Algorithm) else estimator
    return Followed(flown, known, course, None, {})


def _rows(reference: Numbers) -> int:
    return len(np.atleast_1d(np.asarray(reference, object)))


def _read(schedule: Mapping[str, Numbers] | None, channels: Sequence[str], T: int) -> dict[str, np.ndarray]:
    """The course of each channel, (T,)."""
    if schedule is not None and not isinstance(schedule, Mapping):
        checks.refuse(f"`schedule` must be a mapping of channels to values. Got {checks.short(schedule)}.")
    faults, course = checks.Faults(), {}
    faults.learn("T", T, f"`reference` has {checks.counted(T, 'row')}")
    for name in channels:
        if name not in (schedule or {}):
            faults.add(
                f"the matrices of the loop follow {name!r}: give its course, schedule={{{name!r}: values}}, one for each row of "
                "`reference`."
            )
    for name, values in (schedule or {}).items():
        if name not in channels:
            follows = checks.listed(channels) if channels else "no channel"
            faults.add(f"`schedule` has {name!r}, but the loop follows {follows}.{checks.suggestion(name, channels)}")
            continue
        read = faults.array(f"schedule of {name!r}", [values] * T if checks.depth(values) == 0 else values, "T")
        if read is not None:
            course[name] = read
    faults.finish()
    return course
