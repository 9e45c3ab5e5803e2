"""Loops whose plant or estimator follows a schedule: the course of its channels over the run."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .. import checks
from ..annotations import Numbers
from ..estimation.following import along_values, channels_of
from ..models.controlled import ControlledPlant
from ..protocols import Algorithm


def along(
    plants: Sequence[tuple[Any, Any]], estimator: Any, schedule: Mapping[str, Numbers] | None, reference: Numbers
) -> tuple[list[tuple[Any, Any]], Any, dict[str, np.ndarray]]:
    """The plants and the estimator along the course of their channels, and that course, {channel: (T,)}.

    Raises `InputError` with every fault.
    """
    followed = [plant.scheduled_by for plant, _ in plants if isinstance(plant, ControlledPlant)]
    followed += [channels_of(estimator)] if isinstance(estimator, Algorithm) else []
    channels = tuple(dict.fromkeys(name for names in followed for name in names))
    if not channels and schedule is None:
        return list(plants), estimator, {}
    course = _read(schedule, channels, len(np.atleast_1d(np.asarray(reference, object))))
    flown = [(p.along(course) if isinstance(p, ControlledPlant) else p, simulator) for p, simulator in plants]
    return flown, along_values(estimator, course) if isinstance(estimator, Algorithm) else estimator, course


def _read(schedule: Mapping[str, Numbers] | None, channels: tuple[str, ...], T: int) -> dict[str, np.ndarray]:
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
