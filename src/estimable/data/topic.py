"""Topics: the channels that a recorder writes together, with their stamps."""

from collections.abc import Mapping
from datetime import timedelta
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import checks
from ..frozen import frozen, set_field, static
from .frames import time_of
from .record_arguments import Texts, texts_of
from .stamps import TimeOptions
from .time_units import EPOCH

if TYPE_CHECKING:
    import pandas as pd

CLOCKS = ("boot", "start", "utc", "row")


@frozen
class Topic:
    """The channels that a recorder writes together, with one stamp a row.

    - `name`: the name of the topic.
    - `ticks` (T,): the stamps as they are stored; integers stay integers. They may repeat.
    - `tick`: the length of a tick in seconds, such as 1e-6.
    - `channels`: {name: values (T,)}; NaN marks what was not logged.
    - `units`: {channel: unit}.
    - `clock`: what the stamps count from: "boot" of the device, "start" of the log, "utc" (1970), or "row", without a clock.

    Raises `InputError` with all faults at once.

    >>> Topic("imu", [0, 4000, 8000], 1e-6, {"gx": [0.0, 0.1, 0.2]}).t.tolist()
    [0.0, 0.004, 0.008]
    """

    name: str = static()
    ticks: Any
    tick: float
    channels: Any
    units: Any = static(default=())
    clock: str = static(default="start")

    def __post_init__(self):
        faults = checks.Faults()
        faults.text("name", self.name)
        ticks = np.asarray(self.ticks)
        if ticks.ndim != 1 or ticks.dtype.kind not in "iuf" or not np.isfinite(ticks).all():
            faults.add(f"`ticks` must be a list of numbers. Got {checks.short(self.ticks)}.")
        elif len(ticks) == 0:
            faults.add(f"topic {checks.short(self.name)} has no row: leave it out.")
        tick = faults.number("tick", self.tick, above=0.0, unit="seconds")
        faults.choice("clock", self.clock, CLOCKS)
        channels, units = self._read_channels(ticks, faults), ()
        if not faults.sentences:
            units = texts_of("units", "{'gx': 'rad/s'}", self.units, tuple(channels), faults)
        faults.finish()
        ticks = ticks.astype(np.int64) if ticks.dtype.kind in "iu" else ticks.astype(float)
        set_field(self, ticks=ticks, tick=tick, channels=channels, units=units)

    def _read_channels(self, ticks: np.ndarray, faults: checks.Faults) -> dict[str, np.ndarray]:
        if not isinstance(self.channels, Mapping):
            faults.add(f"`channels` must be a mapping of names to values. Got {checks.short(self.channels)}.")
            return {}
        channels = {str(name): np.asarray(values) for name, values in self.channels.items()}
        for name, values in channels.items():
            if values.shape != ticks.shape:
                faults.add(
                    f"channel {name!r} must have a value for each of the {len(ticks)} ticks. Got {values.shape}."
                )
        return channels

    @staticmethod
    def from_pandas(
        name: str,
        frame: "pd.DataFrame",
        *,
        time: str | None = None,
        dt: float | None = None,
        time_unit: str | None = None,
        time_format: str | None = None,
        zone: str | None = None,
        units: Texts = (),
    ) -> "Topic":
        """A topic from all columns of a DataFrame. The arguments are those of `Record.from_pandas`.

        Dates, and numbers that count from 1970, give the clock "utc"; other times the clock "start".
        """
        faults = checks.Faults()
        read = time_of(frame, time, dt, (), TimeOptions(time_unit, time_format, zone), faults)
        faults.finish()
        channels = {str(column): frame[column].to_numpy() for column in frame.columns if column != time}
        if read is None:
            return Topic(
                name,
                np.arange(len(frame)),
                1.0 if dt is None else dt,
                channels,
                units,
                "row" if dt is None else "start",
            )
        if read.origin is None:
            return Topic(name, read.t, 1.0, channels, units)
        zero = (read.origin if read.origin.tzinfo else read.origin.replace(tzinfo=EPOCH.tzinfo)) - EPOCH
        ticks = zero // timedelta(microseconds=1) * 1000 + np.rint(read.t * 1e9).astype(np.int64)
        return Topic(name, ticks, 1e-9, channels, units, "utc")

    @property
    def t(self) -> np.ndarray:
        """The stamps in seconds of the topic's clock; of "utc" since the first stamp."""
        return self.after(self.first if self.clock == "utc" else Fraction(0))

    @property
    def first(self) -> Fraction:
        """The first stamp in seconds, exactly."""
        return Fraction(self.ticks[0].item()) * Fraction(str(self.tick))

    def after(self, zero: Fraction) -> np.ndarray:
        """The stamps in seconds after a time on the topic's clock; differences of integers are exact."""
        since, a_second = self.ticks - self.ticks[0], 1 / Fraction(str(self.tick))
        return float(self.first - zero) + since / float(a_second)
