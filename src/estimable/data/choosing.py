"""The arguments of a record from chosen channels of topics: names, clocks, late and repeated stamps, rows."""

from collections.abc import Mapping, Sequence
from datetime import datetime, timedelta
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np

from .. import checks
from .frames import Channels, renamed
from .messy import one_row_an_instant
from .one_grid import Signal, on_given_rows, on_one_grid
from .time_units import EPOCH
from .topic import Topic

REPEATED = ("first", "last")


class Choice(NamedTuple):
    """How rows are made of stamps: the options of `Log.record` and `Record.from_pandas`."""

    grid: float | None = None
    start: float | None = None
    stop: float | None = None
    max_gap: float | None = None
    delay: Mapping[str, float] = {}
    offset: Mapping[str, float] = {}
    repeated: str | None = None
    hold: str = "zero_order"

    def check(self, faults: checks.Faults) -> None:
        """Check each option by itself."""
        for name in ("grid", "max_gap", "start", "stop"):
            if (value := getattr(self, name)) is not None:
                faults.number(name, value, above=0.0 if name in ("grid", "max_gap") else None, unit="seconds")
        if self.repeated is not None:
            faults.choice("repeated", self.repeated, REPEATED)
        for name in ("delay", "offset"):
            _check_seconds(name, getattr(self, name), faults)

    def late(self, *names: str) -> float:
        """By how many seconds stamps are late: the delay of the first of these names that has one."""
        return _seconds_of(self.delay, names)

    def added(self, *names: str) -> float:
        """The seconds to add to stamps: the offset of the first of these names that has one."""
        return _seconds_of(self.offset, names)


def _seconds_of(given: Mapping[str, float], names: Sequence[str]) -> float:
    return next((float(given[name]) for name in names if name in given), 0.0)


def _check_seconds(name: str, given: Mapping[str, float], faults: checks.Faults) -> None:
    if not isinstance(given, Mapping):
        faults.add(f"`{name}` must be a mapping of topics to seconds, as in {{'gps': 0.2}}. Got {checks.short(given)}.")
        return
    for key, value in given.items():
        faults.number(f"{name}[{key!r}]", value, unit="seconds")


def chosen(
    topics: Sequence[Topic], origin: datetime | None, outputs: Channels, inputs: Channels, choice: Choice
) -> dict[str, Any]:
    """The arguments of a `Record` of some channels of topics."""
    faults = checks.Faults()
    choice.check(faults)
    wanted = {name: renamed(name, given, faults) for name, given in (("outputs", outputs), ("inputs", inputs))}
    if not wanted["outputs"] and not faults.sentences:
        faults.add("`outputs` must name at least one channel.")
    faults.finish()
    found = {
        kind: {name: _find(channel, topics, faults) for name, channel in channels.items()}
        for kind, channels in wanted.items()
    }
    faults.finish()
    used = {topic.name: topic for kind in found.values() for topic, _ in kind.values()}  # type: ignore[misc]
    names = [name for kind in found.values() for name in kind]
    _check_keys("delay", choice.delay, [*used, *names], faults)
    _check_keys("offset", choice.offset, [*used], faults)
    zero, origin = _common_zero(list(used.values()), origin, choice, faults)
    _check_one_topic(found["outputs"], choice, faults)
    faults.finish()
    times = {name: topic.after(zero[name]) for name, topic in used.items()}
    signals = {
        kind: [_signal(name, *place, times, choice, faults) for name, place in channels.items()]  # type: ignore[misc]
        for kind, channels in found.items()
    }
    faults.finish()
    places = {name: place for kind in found.values() for name, place in kind.items()}
    units = {name: unit for name, (topic, channel) in places.items() if (unit := dict(topic.units).get(channel))}  # type: ignore[misc]
    stamps = None if choice.grid is not None else _stamps(found["outputs"], times, choice)
    return row_arguments(stamps, signals["outputs"], signals["inputs"], choice, faults) | {
        "outputs": list(wanted["outputs"]), "inputs": list(wanted["inputs"]), "origin": origin, "units": units,
        "sources": {name: f"{topic.name}/{channel}" for name, (topic, channel) in places.items()},  # type: ignore[misc]
    }  # fmt: skip


def _stamps(outputs: Mapping[str, Any], times: Mapping[str, np.ndarray], choice: Choice) -> np.ndarray:
    """The rows without a grid: the stamps of the topic of the outputs."""
    name, (topic, _) = next(iter(outputs.items()))
    return np.unique(times[topic.name] - choice.late(name, topic.name))


def row_arguments(
    stamps: np.ndarray | None,
    outputs: Sequence[Signal],
    inputs: Sequence[Signal],
    choice: Choice,
    faults: checks.Faults,
) -> dict[str, Any]:
    """The arguments of a `Record` that concern its rows: those of the grid, or without one the given stamps."""
    options = {"hold": choice.hold, "max_gap": choice.max_gap}
    if choice.grid is None and stamps is not None:
        rows = on_given_rows(stamps, outputs, inputs, **options)
    else:
        rows = on_one_grid(outputs, inputs, float(choice.grid or 0.0), faults=faults, **options)
    faults.finish()
    assert rows is not None
    if inputs and np.isnan(rows.u).any(axis=1).all():
        when = ", ".join(f"{one.name!r} from {one.t[0]:.6g} to {one.t[-1]:.6g} s" for one in inputs)
        faults.add(
            f"no row has all its inputs: they were logged {when}, and the outputs from {rows.t[0]:.6g} to {rows.t[-1]:.6g} s. Do "
            "the stamps count from different zeros? Then give `offset`."
        )
        faults.finish()
    first, stop = _within(rows.t, choice, faults)
    faults.finish()
    breaks = [k - first for k in rows.breaks if first < k < stop]
    cut = rows._replace(t=rows.t[first:stop], y=rows.y[first:stop], u=rows.u[first:stop])
    return cut._asdict() | {"grid": choice.grid, "breaks": breaks}


def table_arguments(channels: dict[str, Any], choice: Choice, faults: checks.Faults) -> dict[str, Any]:
    """The arguments of a `Record` of a table, whose channels share one column of times `t`.

    Without a grid the rows of the table are those of the record, and a NaN among the inputs is not known.
    """
    y, u = channels["y"], channels["u"]
    if choice.grid is None:
        return _table_rows(channels, choice, faults)
    if channels["t"] is None:
        faults.add("`grid` places samples by their times: give `time`, the column that holds them.")
    if channels["arrived"] is not None:
        faults.add("`arrived` marks the rows of the table, which `grid` replaces: leave one of them out.")
    if channels["sigma"] is not None:
        faults.add("`sigma` belongs to the rows of the table, which `grid` replaces: leave one of them out.")
    faults.finish()
    t, columns = np.asarray(channels["t"]), dict(channels["sources"])
    names = [*channels["outputs"], *channels["inputs"]]
    for option in ("delay", "offset"):
        _check_keys(option, getattr(choice, option), [*names, *columns.values()], faults)

    def signals(kind: str, values: np.ndarray) -> list[Signal]:
        every = []
        for name, column in zip(channels[kind], values.T, strict=True):
            keys = [name, columns.get(name, name)]
            every.append(Signal(name, t + choice.added(*keys) - choice.late(*keys), column))
        return [without_repeats(one, "the time column", choice.repeated, faults) for one in every]

    outputs, inputs = signals("outputs", y), signals("inputs", u)
    faults.finish()
    rows = row_arguments(t, outputs, inputs, choice, faults)
    return channels | rows | {"notes": (*channels["notes"], *rows["notes"])}


def _table_rows(channels: dict[str, Any], choice: Choice, faults: checks.Faults) -> dict[str, Any]:
    t = channels["t"]
    for name in ("delay", "offset"):
        if getattr(choice, name):
            faults.add(f"`{name}` moves samples to other rows: give `grid` in seconds.")
    asked = [name for name in ("start", "stop", "max_gap", "repeated") if getattr(choice, name) is not None]
    if t is None and asked:
        faults.add(f"`{asked[0]}` needs times: give `time`, the column that holds them.")
    faults.finish()
    if t is None or not asked:
        return channels
    values = {name: channels[name] for name in ("y", "u", "arrived", "sigma")}
    if choice.repeated is not None:
        t, values = one_row_an_instant(t, values, {}, faults, choice.repeated)
    after = [] if choice.max_gap is None else np.flatnonzero(np.diff(t) > choice.max_gap) + 1
    first, stop = _within(t, choice, faults)
    faults.finish()
    values = {name: None if column is None else column[first:stop] for name, column in values.items()}
    return channels | values | {"t": t[first:stop], "breaks": [int(k) - first for k in after if first < k < stop]}


def _within(t: np.ndarray, choice: Choice, faults: checks.Faults) -> tuple[int, int]:
    """The first row, and the one after the last, of those from `start` to `stop` seconds."""
    first = 0 if choice.start is None else int(np.searchsorted(t, choice.start))
    stop = len(t) if choice.stop is None else int(np.searchsorted(t, choice.stop, side="right"))
    if first >= stop:
        faults.add(
            f"no row lies between start = {choice.start} and stop = {choice.stop} s: the record goes from {t[0]:.6g} to "
            f"{t[-1]:.6g} s."
        )
    return first, stop


def _find(channel: str, topics: Sequence[Topic], faults: checks.Faults) -> tuple[Topic, str] | None:
    """The topic and the name in it of "topic/channel", or of "channel" in the only topic that has it."""
    found = [(topic, channel) for topic in topics if channel in topic.channels]
    found = found or [
        (topic, rest)
        for topic in topics
        for rest in [channel.removeprefix(f"{topic.name}/")]
        if rest != channel and rest in topic.channels
    ]
    if len(found) == 1:
        return found[0]
    if found:
        ways = checks.listed(f"{topic.name}/{channel}" for topic, _ in found)
        faults.add(f"several topics have a channel {channel!r}: say which of {ways}.")
        return None
    every = [f"{topic.name}/{name}" for topic in topics for name in topic.channels]
    faults.add(
        f"there is no channel {channel!r}. The channels are {checks.listed(every)}.{checks.suggestion(channel, every)}"
    )
    return None


def _check_keys(option: str, given: Mapping[str, float], allowed: list[str], faults: checks.Faults) -> None:
    """What `delay` and `offset` name must be a part of the record."""
    for key in given:
        if key not in allowed:
            faults.add(
                f"`{option}` names {key!r}, which is none of {checks.listed(allowed)}.{checks.suggestion(key, allowed)}"
            )


def _common_zero(
    topics: Sequence[Topic], origin: datetime | None, choice: Choice, faults: checks.Faults
) -> tuple[dict[str, Fraction], datetime | None]:
    """The zero of the record on the clock of each topic, and its date."""
    first = topics[0]
    others = [one.name for one in topics if one.clock != first.clock and one.name not in choice.offset]
    if others:
        clocks = ", ".join(f"{one.name!r} {one.clock!r}" for one in topics)
        faults.add(
            f"the topics have different clocks ({clocks}): give offset={{{others[0]!r}: seconds}}, which is added to its stamps."
        )
    offset = {one.name: Fraction(float(choice.offset.get(one.name, 0.0))) for one in topics}
    if first.clock != "utc":
        return {one.name: -offset[one.name] for one in topics}, origin
    zero = min(one.first + offset[one.name] for one in topics)
    date = EPOCH + timedelta(microseconds=round(zero * 10**6))
    return {one.name: zero - offset[one.name] for one in topics}, date


def _check_one_topic(outputs: Mapping[str, Any], choice: Choice, faults: checks.Faults) -> None:
    """Without a grid, the rows are the stamps of one topic, and all its channels are late by the same time."""
    if choice.grid is not None:
        return
    topics = sorted({topic.name for topic, _ in outputs.values()})
    if len(topics) > 1:
        faults.add(
            f"the outputs are of the topics {checks.listed(topics)}, which have different stamps: give `grid` in seconds."
        )
    elif len({choice.late(name, topics[0]) for name in outputs}) > 1:
        faults.add(
            "the outputs are late by different times (`delay`), so that their stamps differ: give `grid` in seconds."
        )


def _signal(
    name: str, topic: Topic, channel: str, times: Mapping[str, np.ndarray], choice: Choice, faults: checks.Faults
) -> Signal:
    """The samples of a channel in seconds after the zero of the record."""
    values, t, label = topic.channels[channel], times[topic.name], f"topic {topic.name!r}"
    if values.dtype.kind not in "fiub":
        kinds = {"c": "complex numbers", "U": "text", "O": "text or objects", "M": "dates", "m": "durations"}
        what = kinds.get(values.dtype.kind, str(values.dtype))
        faults.add(f"channel {topic.name}/{channel} must hold numbers. It holds {what}.")
        return Signal(name, np.zeros(1), np.zeros(1))
    values = values.astype(float, copy=False)
    if not check_stamps(t, label, faults):
        return Signal(name, t, values)
    late = choice.late(name, topic.name)
    return without_repeats(Signal(name, t - late if late else t, values), label, choice.repeated, faults)


def check_stamps(t: np.ndarray, label: str, faults: checks.Faults) -> bool:
    """Whether stamps increase: a clock that stays at one time is dead, and one that goes back was restarted."""
    steps = np.diff(t)
    if len(t) > 2 and not steps.any():
        faults.add(f"{label} has a dead clock: all its stamps are {t[0]:g} s. Choose channels of another topic.")
        return False
    if np.any(steps < 0):
        k = int(np.argmax(steps < 0))
        faults.add(
            f"the stamps of {label} go back from {t[k]:.9g} to {t[k + 1]:.9g} s at row {k + 2}: cut it there, or sort it by time."
        )
        return False
    return True


def without_repeats(signal: Signal, label: str, repeated: str | None, faults: checks.Faults) -> Signal:
    """The first or the last value of each stamp; values that are not known do not count."""
    known = signal.known
    same = known.steps == 0
    if not same.any():
        return known
    if repeated is None:
        k = int(np.argmax(same))
        faults.add(
            f"{label} has {checks.counted(int(same.sum()), 'repeated stamp')}, the first at {known.t[k]:.9g} s, with several "
            f"values of {signal.name!r}: give repeated='first' or repeated='last'."
        )
        return known
    kept = np.concatenate([[True], ~same]) if repeated == "first" else np.concatenate([~same, [True]])
    return Signal(signal.name, known.t[kept], known.values[kept])
