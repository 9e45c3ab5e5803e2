"""Matrices of a model as functions of a measured channel, such as the airspeed: a table or a function."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np

from .. import checks
from ..annotations import Array, Numbers
from ..frozen import frozen, static

AXES = {"A": "n n", "B": "n m", "C": "p n", "D": "p m", "Q": "q q", "R": "p p", "G": "n q", "S": "q p"}
COVARIANCES = ("Q", "R")
Matrices: TypeAlias = dict[str, Any]
Function: TypeAlias = Callable[[float], Mapping[str, Numbers]]  # of one value of the channel
Given: TypeAlias = Function | Mapping[str, Numbers]  # a function, or a table


@frozen
class Schedule:
    """Some matrices as functions of one channel: a function value -> {name: matrix}, or tables with linear interpolation.

    `at` (S,): the values of the channel in the table, increasing. `tables`: {name: (S, .., ..)}. `sizes`: of the axes of
    the model's matrices, for the checks.
    """

    channel: str = static()
    function: Function | None = static(default=None)
    at: tuple[float, ...] = static(default=())
    tables: Any = None
    sizes: tuple[tuple[str, int], ...] = static(default=())

    @property
    def given(self) -> "Given":
        """The function or the table."""
        return self.function or {"at": self.at, **(self.tables if isinstance(self.tables, dict) else {})}

    @property
    def sentence(self) -> str:
        """The matrices that follow the channel, and how."""
        if self.function is not None:
            return "by a function; the matrices above are nominal"
        table = f"a table of {len(self.at)} values from {self.at[0]:g} to {self.at[-1]:g}"
        return f"{', '.join(self.tables)} by {table}; the matrices above are nominal"

    def mapped(self, change: Callable[[Matrices], Matrices]) -> "Schedule":
        """The schedule of another model: `change` gives its matrices {name: matrix} from those of this one, linearly in each."""
        if (function := self.function) is not None:
            return Schedule(self.channel, function=lambda value: change(dict(function(value))))
        rows = [change({name: table[i] for name, table in self.tables.items()}) for i in range(len(self.at))]
        return Schedule(
            self.channel, at=self.at, tables={name: np.stack([row[name] for row in rows]) for name in rows[0]}
        )

    def matrices(self, values: np.ndarray, faults: checks.Faults) -> Matrices:
        """{name: (T, .., ..)} at the values (T,) of the channel."""
        return self._interpolated(values, faults) if self.function is None else self._evaluated(values, faults)

    def _interpolated(self, values: np.ndarray, faults: checks.Faults) -> Matrices:
        at = np.asarray(self.at)
        if np.any(outside := (values < at[0]) | (values > at[-1])):
            k = int(np.argmax(outside))
            faults.add(
                f"`schedule` of {self.channel!r} covers {at[0]:g} to {at[-1]:g}, but the channel is {values[k]:g} at row {k}: "
                "widen the table. To hold its ends, repeat the first or last matrix at a far value."
            )
            return {}
        i = np.clip(np.searchsorted(at, values, side="right") - 1, 0, len(at) - 2)
        part = ((values - at[i]) / (at[i + 1] - at[i]))[:, None, None]
        return {name: (1 - part) * table[i] + part * table[i + 1] for name, table in self.tables.items()}

    def _evaluated(self, values: np.ndarray, faults: checks.Faults) -> Matrices:
        assert self.function is not None
        distinct, rows = np.unique(values, return_inverse=True)
        results = []
        for value in distinct:
            try:
                results.append(self.function(float(value)))
            except Exception as error:  # any exception of the user's function
                faults.add(
                    f"`schedule` of {self.channel!r} failed at {value:g}: {type(error).__name__}: {str(error).rstrip('.')}."
                )
                return {}
        names = list(results[0]) if isinstance(results[0], Mapping) else []
        if not all(isinstance(one, Mapping) and list(one) == names for one in results) or not names:
            faults.add(
                f"`schedule` of {self.channel!r} must return the same matrices at every value, such as {{'A': .., 'B': ..}}. "
                f"At {distinct[0]:g} it returns {checks.short(results[0])}."
            )
            return {}
        if not _known_names(self.channel, names, faults):
            return {}
        tables = {name: self._table(name, [one[name] for one in results], faults) for name in names}
        return {} if faults.sentences else {name: table[rows] for name, table in tables.items() if table is not None}

    def _table(self, name: str, matrices: Sequence[Numbers], faults: checks.Faults) -> np.ndarray | None:
        for axis, size in self.sizes:
            faults.learn(axis, size, f"the model has {axis} = {size}")
        return _read_table(f"{name} of the schedule of {self.channel!r}", name, matrices, faults)


def read_schedule(
    given: Mapping[str, Given] | tuple[Schedule, ...] | None, matrices: Matrices, faults: checks.Faults
) -> tuple[Schedule, ...] | None:
    """The schedules of a model with these (nominal) matrices, from {channel: table or function}."""
    if given is None:
        return None
    if isinstance(given, tuple) and all(isinstance(one, Schedule) for one in given):
        given = {one.channel: one.given for one in given}
    if not isinstance(given, Mapping) or not given or not all(isinstance(name, str) for name in given):
        faults.add(
            "`schedule` must be a mapping of a channel to a table or a function, such as "
            f"{{'airspeed': {{'at': [100, 200], 'A': [A1, A2]}}}}. Got {checks.short(given)}."
        )
        return None
    read = [_read_one(channel, one, matrices, faults) for channel, one in given.items()]
    tabled = [name for one in read if one is not None and one.tables for name in one.tables]
    if twice := sorted({name for name in tabled if tabled.count(name) > 1}):
        faults.add(f"`schedule` gives {checks.listed(twice)} by two channels: a matrix follows one channel.")
    return tuple(one for one in read if one is not None)


def _read_one(channel: str, given: Given, matrices: Matrices, faults: checks.Faults) -> Schedule | None:
    if callable(given):
        return Schedule(channel, function=given, sizes=tuple(sorted(_sizes(matrices).items())))
    if not isinstance(given, Mapping) or "at" not in given or len(given) < 2:
        faults.add(
            f"`schedule` of {channel!r} must be a function of the value that returns {{'A': .., ..}}, or a table "
            f"{{'at': values, 'A': matrices, ..}}. Got {checks.short(given)}."
        )
        return None
    names = [name for name in given if name != "at"]
    return _read_tables(channel, names, given, matrices, faults) if _known_names(channel, names, faults) else None


def _read_tables(
    channel: str, names: list[str], given: Mapping[str, Numbers], matrices: Matrices, faults: checks.Faults
) -> Schedule | None:
    before = len(faults.sentences)
    at = faults.array(f"at of the schedule of {channel!r}", given["at"], "S")
    if at is not None and (len(at) < 2 or np.any(np.diff(at) <= 0)):
        faults.add(
            f"`schedule` of {channel!r}: `at` must be at least two increasing values. Got {checks.short(given['at'])}."
        )
    for name in names:
        if matrices.get(name) is None:
            faults.add(f"`schedule` of {channel!r} gives {name}, but the model has none: give it a nominal `{name}`.")
    tables = {name: _read_table(f"{name} of the schedule of {channel!r}", name, given[name], faults) for name in names}
    for name, table in tables.items():
        if table is not None and at is not None and len(table) != len(at):
            counted = "1 matrix" if len(table) == 1 else f"{len(table)} matrices"
            faults.add(f"`schedule` of {channel!r}: {name} has {counted}, and `at` has {len(at)} values.")
    return (
        None if len(faults.sentences) > before else Schedule(channel, at=tuple(np.asarray(at).tolist()), tables=tables)
    )


def _known_names(channel: str, names: list, faults: checks.Faults) -> bool:
    for name in names:
        if name not in AXES:
            near = checks.suggestion(name, AXES) if isinstance(name, str) else ""
            faults.add(f"`schedule` of {channel!r} may give {checks.listed(AXES)}. Got {name!r}.{near}")
    return all(name in AXES for name in names)


def _read_table(words: str, name: str, given: Numbers | Sequence[Numbers], faults: checks.Faults) -> np.ndarray | None:
    """The matrices of a table, (S, .., ..)."""
    if checks.depth(given) != 3:
        faults.add(f"`{words}` must be a list of matrices, one for each value. Got {checks.short(given)}.")
        return None
    read = faults.covariance if name in COVARIANCES else faults.array
    return read(words, given, AXES[name], leading=words)


def _sizes(matrices: Matrices) -> dict[str, int]:
    """The sizes of the axes of the model's matrices."""
    sizes = {}
    for name, axes in AXES.items():
        if matrices.get(name) is not None:
            sizes |= dict(zip(axes.split(), np.shape(matrices[name])[-2:], strict=True))
    return sizes


def along(schedules: tuple[Schedule, ...], values: dict[str, np.ndarray]) -> Matrices:
    """{name: (T, .., ..)} of all schedules at the values (T,) of their channels. Raises `InputError` with every fault."""
    faults, found = checks.Faults(), {}
    for one in schedules:
        matrices = one.matrices(values[one.channel], faults)
        if twice := sorted(found.keys() & matrices.keys()):
            faults.add(f"`schedule` gives {checks.listed(twice)} by two channels: a matrix follows one channel.")
        found |= matrices
    faults.finish()
    return found


def last_known(values: Array) -> np.ndarray:
    """A measured channel (T,) with each NaN replaced by the value before it; NaN before the first value."""
    rows = np.maximum.accumulate(np.where(np.isnan(values), -1, np.arange(len(values))))
    return np.where(rows < 0, np.nan, np.asarray(values)[rows])


def read_values(channels: tuple[str, ...], given: Mapping[str, Numbers]) -> tuple[dict[str, np.ndarray], bool]:
    """{channel: (T,)} of the given values, and whether each is one number."""
    faults, found = checks.Faults(), {}
    if not isinstance(given, Mapping):
        checks.refuse(f"`values` must be a mapping of channels to values. Got {checks.short(given)}.")
    constant = all(checks.depth(one) == 0 for one in given.values())
    for channel in channels:
        if channel not in given:
            faults.add(f"the values of {channel!r} are missing: the model follows {checks.listed(channels)}.")
            continue
        found[channel] = faults.array(
            f"values of {channel!r}", np.ravel(given[channel]) if constant else given[channel], "T"
        )
    for name in given:
        if name not in channels:
            follows = checks.listed(channels) if channels else "no channel"
            faults.add(f"the model follows {follows}, not {name!r}.{checks.suggestion(name, channels)}")
    faults.finish()
    return found, constant
