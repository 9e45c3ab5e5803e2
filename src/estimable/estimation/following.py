"""Algorithms of scheduled models: the values of the channels that the matrices follow, from a record or one by one."""

from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import jax
import numpy as np

from .. import checks
from ..annotations import Numbers
from ..data.record import Record
from ..filters.mixture import Mixture
from ..frozen import replace
from ..models.schedule import last_known
from ..models.state_space import StateSpace
from ..protocols import Algorithm, Wrapper
from ..results import Stacked
from .stack import stack

Values: TypeAlias = Mapping[str, float]  # {channel: value}
Given: TypeAlias = Values | Numbers | None  # y, u or `schedule`, as given to a run


def channels_of(algorithm: Algorithm[Any]) -> tuple[str, ...]:
    """The channels that the matrices of the algorithm's model follow; of a mixture, those of all its members."""
    if isinstance(algorithm, Mixture):
        return tuple(dict.fromkeys(name for member in algorithm.algorithms for name in channels_of(member)))
    if isinstance(algorithm, Wrapper):
        return channels_of(algorithm.algorithm)
    return algorithm.model.scheduled_by if isinstance(algorithm.model, StateSpace) else ()


def with_model(algorithm: Algorithm[Any], change: Callable[[Any], Any]) -> Any:
    """The algorithm with its model changed, inside all wrappers and in all members of a mixture."""
    if isinstance(algorithm, Mixture):
        return replace(algorithm, algorithms=tuple(with_model(member, change) for member in algorithm.algorithms))
    if isinstance(algorithm, Wrapper):
        return replace(algorithm, algorithm=with_model(algorithm.algorithm, change))
    return replace(algorithm, model=change(algorithm.model))


def along_values(algorithm: Algorithm[Any], values: Mapping[str, Numbers]) -> Any:
    """The algorithm with its model at given values of the channels, as `StateSpace.along`."""
    return with_model(algorithm, lambda model: model.along({name: values[name] for name in model.scheduled_by}))


def along_record(algorithm: Algorithm[Any], record: Record) -> Any:
    """The algorithm with the model that varies as the record says; itself where its model follows no channel."""
    return with_model(algorithm, lambda model: model_along(model, record)) if channels_of(algorithm) else algorithm


def model_along(model: StateSpace, record: Record) -> StateSpace:
    """The model that varies as the record says; itself where it follows no channel."""
    if not model.schedule:
        return model
    faults = checks.Faults()
    values = {channel: _column(record, channel, faults) for channel in model.scheduled_by}
    faults.finish()
    return model.along(values)


def _column(record: Record, channel: str, faults: checks.Faults) -> np.ndarray:
    """The channel in a record; a missing value is the one before it."""
    for names, columns in ((record.outputs, record.y), (record.inputs, record.u)):
        if channel in names:
            values = last_known(np.asarray(columns)[:, names.index(channel)])
            if np.isnan(values[0]):
                faults.add(
                    f"the first row of the record must have {channel!r}, which the matrices of the model follow."
                )
            return values
    near = checks.suggestion(channel, (*record.outputs, *record.inputs))
    faults.add(
        f"the matrices of the model follow {channel!r}, and the record has no such channel: name it among its outputs.{near}"
    )
    return np.zeros(len(record))


def bank_along_records(algorithms: Algorithm[Any] | Stacked, records: Record | Stacked) -> Any:
    """A bank of algorithms along its records: each of them is one, or a `Stacked`."""
    many = isinstance(algorithms, Stacked)
    first = _item(algorithms, 0)
    if not isinstance(first, Algorithm) or not channels_of(first):
        return algorithms
    if not isinstance(records, Stacked):
        if not many:
            return along_record(algorithms, records) if isinstance(records, Record) else algorithms
        return stack([along_record(_item(algorithms, i), records) for i in range(len(algorithms))])
    if not isinstance(_item(records, 0), Record) or (many and len(records) != len(algorithms)):
        return algorithms
    return stack([along_record(_item(algorithms, i), _item(records, i)) for i in range(len(records))])


def _item(part: Algorithm[Any] | Record | Stacked, i: int) -> Any:
    """Item i of a stack, or the shared one."""
    return jax.tree_util.tree_map(lambda leaf: leaf[i], part.items) if isinstance(part, Stacked) else part


class Following:
    """The current values of the channels of a run sample by sample, and the algorithm there."""

    def __init__(self, algorithm: Algorithm[Any], values: np.ndarray | None):
        self.algorithm, self.channels = algorithm, channels_of(algorithm)
        model, names = algorithm.innermost.model, algorithm.names
        self.sources = [
            ("y", model.outputs.index(channel)) if channel in model.outputs
            else ("u", names.inputs.index(channel)) if channel in names.inputs else ("schedule", channel)
            for channel in self.channels
        ]  # fmt: skip
        self.values = np.full(len(self.channels), np.nan) if values is None else np.asarray(values, float)
        self.found: dict[bytes, Any] = {}

    def read(self, faults: checks.Faults, **given: Given) -> np.ndarray:
        """The values after a call with y, u and `schedule`; what is not given or NaN remains."""
        values = self.values.copy()
        schedule = given.get("schedule")
        if schedule is not None and not isinstance(schedule, Mapping):
            faults.add(f"`schedule` must be a mapping of channels to values. Got {checks.short(schedule)}.")
            given["schedule"] = None
        for i, (channel, (source, place)) in enumerate(zip(self.channels, self.sources, strict=True)):
            one = _number(given.get(source), place)
            values[i] = one if np.isfinite(one) else values[i]
            if np.isnan(values[i]):
                faults.add(
                    f"the matrices of the model follow {channel!r}: give its value, schedule={{{channel!r}: ..}}."
                    if source == "schedule"
                    else f"the matrices of the model follow {channel!r}, which is not known yet: give it in `{source}`."
                )
        return values

    @property
    def now(self) -> Any:
        """The algorithm at the current values."""
        key = self.values.tobytes()
        if key not in self.found:
            if len(self.found) >= 64:
                self.found.clear()
            self.found[key] = along_values(self.algorithm, dict(zip(self.channels, self.values.tolist(), strict=True)))
        return self.found[key]


def _number(numbers: Given, place: str | int) -> float:
    """The number at a place; NaN where there is none."""
    try:
        return float(numbers[place])  # pyright: ignore[reportArgumentType, reportCallIssue, reportIndexIssue, reportOptionalSubscript]
    except (TypeError, ValueError, OverflowError, LookupError):
        return np.nan


def nominal(algorithm: Algorithm[Any]) -> Any:
    """The algorithm with the nominal matrices of its model, which have the shapes of all."""
    return with_model(algorithm, lambda model: model.nominal) if channels_of(algorithm) else algorithm
