"""Records: measured outputs, logged inputs, times, and which inputs arrived."""

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, field
from datetime import datetime
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from .. import checks
from ..annotations import Numbers
from ..frozen import frozen, replace, set_field, static
from ..models.angles import Given, unwrapped
from ..models.angles import read as read_angles
from ..models.discretisation import HOLDS
from ..models.sampled import Clock
from . import record_arguments as read
from . import undeclared
from .choosing import Choice, table_arguments
from .frames import Channels, channels_of
from .messy import measured, one_row_an_instant
from .record_arguments import Texts, column, regular_step, scatter
from .regular_rows import multiples_of, regular_rows
from .stamps import TimeOptions

if TYPE_CHECKING:
    import pandas as pd

LOST = ("zero", "hold")


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
    - `angles`: which channels are angles, {name: "rad", "deg", a period, or a range (lower, upper)}, for models that do not say
      so. None instead of a unit: the channel is no angle, although it jumps by a turn.
    - `sigma` (T, p): the standard deviation of the noise of each output in each row, where it is known. NaN: that of the model.
    - `breaks`: rows before which nothing connects: the recorder was restarted, or what the plant did between is unknown.
      A row k in `breaks` says that the state at row k does not follow from row k - 1.
    - `origin`: the date of t = 0 as a `datetime`. One without a zone is local time as the recorder wrote it.
    - `grid`: the step in seconds of the grid on which the rows were placed. None: the rows are those of the recorder.
    - `placing`: {output: rms error}, how far placing on the grid moved the values of an output, as its stamps lie between rows.
    - `sources`: {name: "topic/channel"}, where each channel came from.
    - `notes`: sentences about how the record was read, such as the rule that decided the unit of time.

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
    sigma: Any = None
    lost: str = static(default="zero")
    hold: str = static(default="zero_order")
    units: Any = static(default=())
    angles: Any = static(default=())
    breaks: Any = static(default=())
    origin: datetime | None = static(default=None)
    grid: float | None = static(default=None)
    placing: Any = static(default=())
    sources: Any = static(default=())
    notes: Any = static(default=())
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
        arrived = None if self.arrived is None else read.arrived_of(self.arrived, self.hold, faults)
        sigma = None if self.sigma is None else read.sigma_of(self.sigma, faults)
        dt = None if self.dt is None else faults.number("dt", self.dt, above=0.0, unit="seconds")
        t = read.times_of(self.t, 0 if y is None else len(y), faults)
        names = {
            "outputs": faults.names("outputs", self.outputs, "p", "y"),
            "inputs": faults.names("inputs", self.inputs, "m", "u"),
        }
        facts = self._read_facts(names["outputs"] + names["inputs"], 0 if y is None else len(y), faults)
        if t is not None and y is not None and not faults.sentences:
            channels = {"y": y, "u": u, "arrived": arrived, "sigma": sigma}
            labels = {
                "y": names["outputs"],
                "u": names["inputs"],
                "arrived": names["inputs"],
                "sigma": names["outputs"],
            }
            rows = t
            t, channels = one_row_an_instant(t, channels, labels, faults)
            facts["breaks"] = tuple(sorted({int(np.searchsorted(t, rows[k])) for k in facts["breaks"]} - {0}))
            y, u, arrived, sigma = (channels[name] for name in ("y", "u", "arrived", "sigma"))
        dt, t = read.step_of(dt, t, 0 if y is None else len(y), faults)
        faults.finish()
        timed = True if self.t is not None and self.dt is None else None
        set_field(self, y=y, u=u, arrived=arrived, sigma=sigma, dt=dt, t=t, timed=timed, **names, **facts)

    def _read_facts(self, channels: tuple[str, ...], rows: int, faults: checks.Faults) -> dict[str, Any]:
        """The fields that describe the rows and the channels."""
        return {
            "units": read.texts_of("units", "{'speed': 'm/s'}", self.units, channels, faults),
            "sources": read.texts_of("sources", "{'speed': 'airspeed/true'}", self.sources, channels, faults),
            "breaks": read.breaks_of(self.breaks, rows, faults),
            "angles": read_angles(self.angles, channels, "a channel of the record", faults, denied=True),
            "origin": read.origin_of(self.origin, faults),
            "grid": None if self.grid is None else faults.number("grid", self.grid, above=0.0, unit="seconds"),
            "placing": read.numbers_of("placing", self.placing, channels, faults),
            "notes": read.notes_of(self.notes, faults),
        }

    @staticmethod
    def from_pandas(
        frame: "pd.DataFrame",
        *,
        outputs: Channels,
        inputs: Channels = (),
        time: str | None = None,
        dt: float | None = None,
        time_unit: str | None = None,
        time_format: str | None = None,
        zone: str | None = None,
        repeated: str | None = None,
        grid: float | None = None,
        start: float | None = None,
        stop: float | None = None,
        max_gap: float | None = None,
        delay: Mapping[str, float] | None = None,
        offset: Mapping[str, float] | None = None,
        arrived: str | Sequence[str] | None = None,
        lost: str = "zero",
        hold: str = "zero_order",
        units: Texts = (),
        angles: Given = (),
        sigma: Mapping[str, str] | None = None,
        na_values: Numbers | None = None,
    ) -> "Record":
        """A record from named columns of a DataFrame.

        `time`: a column of numbers or dates, or None: then `dt`, or the index if it holds dates or is named "time". The other
        arguments are those of `read_record`.

        Raises `InputError` if a column is missing or holds anything but numbers; the message names the row.
        """
        faults = checks.Faults()
        choice = Choice(grid, start, stop, max_gap, delay or {}, offset or {}, repeated, hold)
        choice.check(faults)
        faults.finish()
        channels = channels_of(
            frame, outputs=outputs, inputs=inputs, time=time, dt=dt, arrived=arrived, na_values=na_values,
            options=TimeOptions(time_unit, time_format, zone), sigma=sigma,
        )  # fmt: skip
        channels = table_arguments(channels, choice, faults)
        return Record(**channels, dt=dt if grid is None else None, lost=lost, hold=hold, units=units, angles=angles)

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
        cut = {
            name: None if (a := getattr(self, name)) is None else a[rows]
            for name in ("y", "u", "t", "arrived", "sigma")
        }
        if self.lost == "hold" and self.arrived is not None and first > 0:
            cut["held"] = self.applied()[first - 1]
        cut["breaks"] = tuple(row - first for row in self.breaks if first < row < stop)
        if self.dt is None and self.t is not None:
            cut["dt"] = regular_step(self.t[rows])
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

    def on_grid(self, dt: float | None = None) -> "Record":
        """The record with a row for every multiple of a step (default: the median step), for methods that need equal steps.

        Every stamp must be within a tenth of a step of a multiple. A missing row has no output; its input is that of its
        neighbours where they agree, otherwise NaN, which means unknown. `placing` holds the effect of the scatter of the stamps.

        Raises `InputError` that names the worst row.

        >>> record = Record([1.0, 2.0, 4.0], [5.0, 5.0, 6.0], t=[0.0, 1.0, 3.0]).on_grid()
        >>> record.y.ravel().tolist(), record.u.ravel().tolist(), record.dt
        ([1.0, 2.0, nan, 4.0], [5.0, 5.0, nan, 6.0], 1.0)
        """
        faults = checks.Faults()
        step = None if dt is None else faults.number("dt", dt, above=0.0, unit="seconds")
        if self.t is None:
            checks.refuse("a grid needs times: give the record `t`, in seconds.")
        faults.finish()
        t = np.asarray(self.t)
        if self.dt is not None and (dt is None or abs(dt - self.dt) <= scatter(t, self.dt)):
            return self
        found = multiples_of(t, step, faults)
        faults.finish()
        fields = {
            name: getattr(self, name) for name in ("t", "y", "u", "arrived", "sigma", "outputs", "breaks", "notes")
        }
        return replace(self, **regular_rows(fields, found), timed=True)

    @property
    def parts(self) -> list["Record"]:
        """The record cut at its breaks: parts whose rows connect."""
        edges = [0, *self.breaks, len(self)]
        return [self[first:stop] for first, stop in pairwise(edges)]

    @property
    def without_notes(self) -> "Record":
        """The record without what only describes where it came from: `origin`, `grid`, `placing`, `sources` and
        `notes`."""
        return replace(self, origin=None, grid=None, placing=(), sources=(), notes=())

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
        lengths, rows = groups(np.diff(self.t), scatter(self.t, np.median(np.diff(self.t))))
        filled = 2 ** int(np.ceil(np.log2(len(lengths))))  # so that another record seldom needs a new compilation
        lengths = np.append(lengths, np.full(filled - len(lengths), lengths[-1]))
        return Clock(lengths, np.append(rows, rows[-1]), self.hold)

    def continuous(self) -> "Record":
        """The same record, in which declared angles run on through any number of turns."""
        y, u = unwrapped(self.y, self.angles, self.outputs), unwrapped(self.u, self.angles, self.inputs)
        return replace(self, y=y, u=u) if self.angles else self

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
    """One record, or a list of them, as a list in which angles run on through any number of turns; empty if it is at fault."""
    records = [given] if isinstance(given, Record) else list(given) if isinstance(given, list | tuple) else []
    if not records or not all(isinstance(one, Record) for one in records):
        faults.add(f"`{name}` must be a Record, or a list of them. Got {checks.short(given)}.")
        return []
    for one in records:
        undeclared.check(one.y, one.outputs, [channel for channel, *_ in one.angles], faults)
    return [one.continuous() for one in records]


def _is_whole(*bounds: int | None) -> bool:
    """Whether each is an integer or None."""
    return all(bound is None or isinstance(bound, int | np.integer) for bound in bounds)


def groups(steps: np.ndarray, width: float) -> tuple[np.ndarray, np.ndarray]:
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
