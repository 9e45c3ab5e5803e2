"""Records: measured outputs, logged inputs, times, and which inputs arrived."""

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, field
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import numpy as np
from jax.core import Tracer

from .. import checks
from ..annotations import Numbers
from ..frozen import frozen, replace, set_field, static
from ..models.discretisation import HOLDS
from ..models.sampled import Clock
from .frames import REMEDY, channels_of
from .messy import measured, one_row_an_instant

if TYPE_CHECKING:
    import pandas as pd
Units: TypeAlias = Mapping[str, str] | Sequence[tuple[str, str]]  # {channel: unit}

LOST = ("zero", "hold")
UNIFORM = 1e-6  # largest relative scatter of regular time steps: the rounding of a file


@frozen
class Record:
    """Measured outputs and logged inputs, one row for each sample.

    Row k holds the outputs `y[k]`, measured at `t[k]`, and the input `u[k]`, applied from `t[k]` to `t[k+1]`.

    Settings:

    - `y` (T, p): the outputs. NaN, None or a masked entry marks a missing output.
    - `u` (T, m): the inputs that were sent. NaN marks an input that was not logged. A 1-D `y` or `u` is one channel.
    - `dt` or `t`: the step in seconds, or increasing times (T,) in seconds. Without either, a discrete model provides the
      step.
    - `hold`: "zero_order" if the input is constant from sample to sample, "first_order" if it moves linearly to `u[k+1]`.
    - `arrived` (T, m): 1 if the input was applied, 0 if the network lost it, NaN if that is unknown. `lost`: what the
      actuator applies when an input is lost, "zero" or "hold" (its last input).
    - `outputs` and `inputs`: names of the channels (default y1.., u1..). The names match the channels to those of a model.
    - `units`: {name: unit}, for tables and figures.

    Raises `InputError` with all faults at once.

    >>> record = Record([[1.0], [float("nan")], [0.8]], [[0.0], [1.0], [1.0]], dt=0.1, outputs=["level"])
    >>> len(record), record.outputs, record.inputs, record.seconds
    (3, ('level',), ('u1',), 0.2)
    """

    y: Any
    u: Any = None
    _: KW_ONLY
    dt: float | None = static(default=None)
    t: Any = None
    inputs: Any = static(default=None)
    outputs: Any = static(default=None)
    arrived: Any = None
    lost: str = static(default="zero")
    hold: str = static(default="zero_order")
    units: Any = static(default=())
    held: Annotated[Any, "m"] = field(
        default=None, init=False
    )  # the input held by the actuator before row 0, if earlier rows were cut off
    timed: bool | None = static(default=None, init=False)  # True: the step is that of `t` alone

    def __post_init__(self):
        faults = checks.Faults()
        y = faults.array("y", column(measured(self.y)), "T p", nan=True)
        u = self.u
        if u is None and y is not None:
            u = np.zeros((len(y), 0))
        u = None if u is None else faults.array("u", column(u), "T m", nan=True)
        if y is not None and len(y) == 0:
            faults.add("the record is empty: `y` has no row.")
        elif y is not None and y.shape[1] == 0:
            faults.add("`y` has no column: a record needs an output.")
        faults.choice("hold", self.hold, HOLDS)
        faults.choice("lost", self.lost, LOST)
        arrived = None if self.arrived is None else _read_arrived(self.arrived, self.hold, faults)
        dt = None if self.dt is None else faults.number("dt", self.dt, above=0.0, unit="seconds")
        t = _read_times(self.t, 0 if y is None else len(y), faults)
        names = {
            "outputs": faults.names("outputs", self.outputs, "p", "y"),
            "inputs": faults.names("inputs", self.inputs, "m", "u"),
        }
        units = _read_units(self.units, names["outputs"] + names["inputs"], faults)
        if t is not None and y is not None and not faults.sentences:
            channels = {"y": y, "u": u, "arrived": arrived}
            labels = {"y": names["outputs"], "u": names["inputs"], "arrived": names["inputs"]}
            t, channels = one_row_an_instant(t, channels, labels, faults)
            y, u, arrived = channels["y"], channels["u"], channels["arrived"]
        dt, t = _read_step(dt, t, 0 if y is None else len(y), faults)
        faults.finish()
        timed = True if self.t is not None and self.dt is None else None
        set_field(self, y=y, u=u, arrived=arrived, dt=dt, t=t, units=units, timed=timed, **names)

    @staticmethod
    def from_pandas(
        frame: "pd.DataFrame",
        *,
        outputs: Sequence[str],
        inputs: Sequence[str] = (),
        time: str | None = None,
        dt: float | None = None,
        arrived: str | Sequence[str] | None = None,
        lost: str = "zero",
        hold: str = "zero_order",
        units: Units = (),
        na_values: Numbers | None = None,
    ) -> "Record":
        """A record from named columns of a DataFrame.

        `time`: a column of seconds or of timestamps, or None: then `dt`, or the index if it is a DatetimeIndex or
        named "time". `arrived`: columns of 1 and 0, one for each input, or one for all inputs. `na_values`: as in `read_record`.

        Raises `InputError` if a column is missing or holds anything but numbers; the message names the row.
        """
        channels = channels_of(
            frame, outputs=outputs, inputs=inputs, time=time, dt=dt, arrived=arrived, na_values=na_values
        )
        return Record(**channels, dt=dt, lost=lost, hold=hold, units=units)

    def __repr__(self) -> str:
        lasting = "" if self.t is None else f", {self.t[0]:g} to {self.t[-1]:g} s"
        missing = np.isnan(self.y).sum()
        gaps = "" if not missing else f", {missing} of {self.y.size} outputs not seen"
        channels = f"outputs {', '.join(self.outputs)}" + (f"; inputs {', '.join(self.inputs)}" if self.inputs else "")
        return f"Record({checks.counted(len(self), 'row')}{lasting}; {channels}{gaps})"

    def __len__(self) -> int:
        return self.y.shape[0]

    def __getitem__(self, rows: slice) -> "Record":
        """Some consecutive rows, as a record."""
        if not isinstance(rows, slice) or rows.step not in (None, 1) or not _is_whole(rows.start, rows.stop):
            checks.refuse("a record is cut by a slice of consecutive rows, as in record[100:200].")
        first, stop, _ = rows.indices(len(self))
        if stop <= first:
            begin, end = ("" if bound is None else bound for bound in (rows.start, rows.stop))
            checks.refuse(f"record[{begin}:{end}] holds no row: the record has {len(self)}.")
        cut = {name: None if (a := getattr(self, name)) is None else a[rows] for name in ("y", "u", "t", "arrived")}
        if self.lost == "hold" and self.arrived is not None and first > 0:
            cut["held"] = self.applied()[first - 1]
        if self.dt is None and self.t is not None:
            cut["dt"] = _regular_step(self.t[rows])
        return replace(self, **cut)

    def split(self, fraction: float) -> tuple["Record", "Record"]:
        """The first `fraction` of the rows, and the others."""
        faults = checks.Faults()
        fraction = faults.number("fraction", fraction, above=0.0, upper=1.0)
        cut = 1 if fraction is None else round(fraction * len(self))
        if fraction is not None and not 0 < cut < len(self):
            rows = checks.counted(len(self), "row")
            faults.add(f"`fraction` must leave rows in both parts. {fraction:g} of {rows} is {cut}.")
        faults.finish()
        return self[:cut], self[cut:]

    @property
    def seconds(self) -> float | None:
        """Duration from the first sample to the last; None if the record has no time."""
        return None if self.t is None else float(self.t[-1] - self.t[0])

    @property
    def seen(self) -> np.ndarray:
        """The mask of the seen outputs, (T, p)."""
        return ~np.isnan(self.y)

    def clock(self, dt: float | None = None) -> Clock:
        """The steps of this record. `dt` is the step of a record without time. The last row has the step of the row before."""
        regular = self.dt if self.dt is not None else dt
        if regular is not None or self.t is None or len(self) == 1:
            return Clock.every(0.0 if regular is None else regular, self.hold)
        lengths, rows = _groups(np.diff(self.t), scatter(self.t, np.median(np.diff(self.t))))
        filled = 2 ** int(np.ceil(np.log2(len(lengths))))  # so that another record seldom needs a new compilation
        lengths = np.append(lengths, np.full(filled - len(lengths), lengths[-1]))
        return Clock(lengths, np.append(rows, rows[-1]), self.hold)

    def applied(self) -> np.ndarray:
        """The input that the actuator applied, (T, m), NaN if unknown: the sent input if it arrived, otherwise the substitute
        that `lost` names.
        """
        if self.arrived is None:
            return self.u
        applied = np.where(self.arrived == 1, self.u, np.where(self.arrived == 0, 0.0, np.nan))
        if self.lost == "hold":
            rows = np.arange(applied.shape[-2])[:, None]
            last = np.maximum.accumulate(np.where(self.arrived != 0, rows, -1), axis=-2)  # row of the held input
            held = np.zeros_like(applied[..., :1, :]) if self.held is None else self.held[..., None, :]
            applied = np.where(last < 0, held, np.take_along_axis(applied, np.maximum(last, 0), axis=-2))
        return applied


def several(name: str, given: Any, faults: checks.Faults) -> list[Record]:
    """One record, or a list of them, as a list; empty if it is at fault."""
    records = [given] if isinstance(given, Record) else list(given) if isinstance(given, list | tuple) else []
    if not records or not all(isinstance(one, Record) for one in records):
        faults.add(f"`{name}` must be a Record, or a list of them. Got {checks.short(given)}.")
        return []
    return records


def column(value: Numbers) -> Numbers:
    """A 1-D array of numbers as one channel."""
    if isinstance(value, Tracer):
        return value[:, None] if value.ndim == 1 else value
    try:
        array = np.asarray(value)
    except ValueError:
        return value
    return array[:, None] if array.ndim == 1 and array.dtype.kind in "fiub" else value


def _is_whole(*bounds: int | None) -> bool:
    """Whether each is an integer or None."""
    return all(bound is None or isinstance(bound, int | np.integer) for bound in bounds)


def _read_units(units: Units, channels: tuple[str, ...], faults: checks.Faults) -> tuple[tuple[str, str], ...]:
    """(name, unit) of each channel that has one."""
    pairs = tuple(units.items()) if isinstance(units, Mapping) else units
    texts = isinstance(pairs, tuple) and all(
        isinstance(pair, tuple) and len(pair) == 2 and all(isinstance(text, str) for text in pair) for pair in pairs
    )
    if not texts:
        faults.add(f"`units` must be a mapping of names to units, as in {{'speed': 'm/s'}}. Got {checks.short(units)}.")
        return ()
    faults.printable("units", (unit for _, unit in pairs))
    unknown = [name for name, _ in pairs if name not in channels]
    if unknown:
        near = checks.suggestion(unknown[0], channels)
        faults.add(f"`units` names channels that the record does not have: {checks.listed(unknown)}.{near}")
    return tuple(sorted(pairs))


def _read_arrived(arrived: Numbers, hold: str, faults: checks.Faults) -> np.ndarray | None:
    if faults.sizes.get("m") == 0:
        faults.add("`arrived` marks which inputs were applied, but the record has no input: give `u`.")
        return None
    read = faults.array("arrived", column(arrived), "T m", nan=True)
    if read is not None and not np.all(np.isnan(read) | (read == 0) | (read == 1)):
        faults.add("`arrived` must be 1 (applied), 0 (lost) or NaN (unknown).")
    if isinstance(hold, str) and hold == "first_order":
        faults.add('`arrived` needs hold = "zero_order": an input that arrives in packets is constant between them.')
    return read


def _read_times(t: Numbers | None, rows: int, faults: checks.Faults) -> np.ndarray | None:
    """The times, which never go back; None if the record has none, or they are at fault."""
    if t is None:
        return None
    faults.learn("T", rows, f"`y` has {rows} rows")
    if getattr(getattr(t, "dtype", None), "kind", "f") in "mM":
        faults.add("`t` must be seconds, not dates. Did you mean `(t - t[0]) / np.timedelta64(1, 's')`?")
        return None
    times = faults.array("t", t, "T")
    if times is None or rows == 0:
        return None
    if np.any(back := np.diff(times) < 0):
        k = int(np.argmax(back))
        before, after = float(times[k]), float(times[k + 1])
        faults.add(f"`t` must increase. From t[{k}] to t[{k + 1}] it goes from {before} to {after} s: {REMEDY}.")
        return None
    return times


def _read_step(
    dt: float | None, times: np.ndarray | None, rows: int, faults: checks.Faults
) -> tuple[float | None, np.ndarray | None]:
    """The regular step (None if there is none) and the times (None if the record has none)."""
    if times is None:
        return dt, None if dt is None else np.arange(rows) * dt
    if rows == 1:
        return dt, times
    mean, regular = float((times[-1] - times[0]) / (rows - 1)), _regular_step(times)
    if dt is not None and (regular is None or abs(dt - mean) > scatter(times, mean)):
        scattered = ", not regular" if regular is None else ""
        faults.add(f"`dt` = {dt:g} s and `t` disagree: the mean step of `t` is {mean:g} s{scattered}. Give one.")
    return regular, times


def _regular_step(t: np.ndarray) -> float | None:
    """The step of regular times; None if they are not regular, or there is only one."""
    if len(t) == 1:
        return None
    mean = float((t[-1] - t[0]) / (len(t) - 1))
    return float(f"{mean:.12g}") if np.all(np.abs(np.diff(t) - mean) <= scatter(t, mean)) else None


def scatter(t: np.ndarray, step: float) -> float:
    """The largest deviation from `step` by rounding: that of a file, and that of large times in float64."""
    return UNIFORM * step + 4 * np.finfo(float).eps * np.abs(t).max()


def _groups(steps: np.ndarray, width: float) -> tuple[np.ndarray, np.ndarray]:
    """The distinct lengths among steps, and the index of each step; steps within `width` count as one, at their mean."""
    ordered, starts, i = np.sort(steps), [], 0
    while i < len(ordered):
        starts.append(ordered[i])
        i = np.searchsorted(ordered, ordered[i] + width, side="right")
    rows = np.searchsorted(starts, steps, side="right") - 1
    return np.bincount(rows, weights=steps) / np.bincount(rows), rows


def match(names: tuple[str, ...], defaults: bool, record_names: tuple[str, ...], what: str, faults: checks.Faults):
    """Columns of a record for a model's channels, by name; by position if the model has the default names."""
    if all(name in record_names for name in names):
        return [record_names.index(name) for name in names]
    if defaults and len(names) == len(record_names):
        return list(range(len(names)))
    missing = [name for name in names if name not in record_names]
    near = "".join(dict.fromkeys(checks.suggestion(name, record_names) for name in missing))
    there = f"its {what}s are {checks.listed(record_names)}" if record_names else f"it has no {what}s"
    faults.add(f"the record has no {what} named {checks.listed(missing)}: {there}.{near}")
    return []
