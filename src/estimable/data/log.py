"""Logs: topics of several rates and clocks, and the record that is made of some of their channels."""

from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Any

from .. import checks
from ..frozen import frozen, set_field, static
from .choosing import Choice, chosen
from .record import Record
from .topic import Topic


@frozen
class Log:
    """What a recorder wrote: topics, the date of its zero, and parameters and notes of the recorder.

    - `topics`: the topics, in the order of the file.
    - `origin`: the date of t = 0 of the clocks "boot" and "start". None: unknown.
    - `parameters`: {name: value}, as the recorder wrote them.
    - `notes`: sentences about how the log was read.

    `record` makes a `Record` of some channels.
    """

    topics: Any
    origin: datetime | None = static(default=None)
    parameters: Any = None
    notes: Any = static(default=())

    def __post_init__(self):
        faults = checks.Faults()
        topics = tuple(self.topics) if isinstance(self.topics, list | tuple) else ()
        if not topics or not all(isinstance(one, Topic) for one in topics):
            faults.add(f"`topics` must be a list of Topic. Got {checks.short(self.topics)}.")
        elif twice := sorted({one.name for one in topics if [other.name for other in topics].count(one.name) > 1}):
            faults.add(f"`topics` must have different names. Several are named {checks.listed(twice)}.")
        faults.finish()
        set_field(self, topics=topics, notes=tuple(self.notes))

    def __repr__(self) -> str:
        return f"Log({', '.join(f'{one.name}: {len(one.ticks)} rows' for one in self.topics)})"

    def record(
        self,
        *,
        outputs: Sequence[str] | Mapping[str, str],
        inputs: Sequence[str] | Mapping[str, str] = (),
        grid: float | None = None,
        start: float | None = None,
        stop: float | None = None,
        max_gap: float | None = None,
        delay: Mapping[str, float] | None = None,
        offset: Mapping[str, float] | None = None,
        repeated: str | None = None,
        hold: str = "zero_order",
    ) -> Record:
        """A record of some channels.

        - `outputs`, `inputs`: channels, as "topic/channel" or "channel" where only one topic has it; or a mapping
          {name in the model: channel}.
        - `grid`: the step of the rows in seconds. None: the rows are the stamps of the topic of the outputs.
        - `start`, `stop`: the first and last time of the record in seconds.
        - `max_gap`: after so many seconds an input is no longer known, and nothing connects across. None: an input is known
          up to 1.5 of its steps where its topic has a clock, otherwise until its next sample.
        - `delay`: {topic or channel: seconds} by which its stamps are late.
        - `offset`: {topic: seconds} to add to its stamps, so that they count from the zero of the first output's topic.
        - `repeated`: which of several rows at one stamp counts, "first" or "last". None: they are refused.
        - `hold`: as in `Record`.

        Outputs are placed in the nearest row and never interpolated. Inputs are the mean over the row of what the actuator held
        (`hold="zero_order"`), or linear between their samples (`"first_order"`). `placing` of the record says how far placing
        moved each output.

        Raises `InputError` with all faults of the call.

        >>> imu = Topic("imu", [0, 10, 20, 30], 1e-3, {"gx": [0.0, 1.0, 2.0, 3.0]})
        >>> motor = Topic("motor", [0, 5, 15, 25], 1e-3, {"m1": [0.0, 1.0, 0.0, 1.0]})
        >>> record = Log([imu, motor]).record(outputs=["gx"], inputs=["m1"], grid=0.01)
        >>> record.u.ravel().round(9).tolist()
        [0.5, 0.5, 0.5, 1.0]
        """
        choice = Choice(grid, start, stop, max_gap, delay or {}, offset or {}, repeated, hold)
        return Record(**chosen(self.topics, self.origin, outputs, inputs, choice), hold=hold)
