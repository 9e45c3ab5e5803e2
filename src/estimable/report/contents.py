"""The contents of a report, as plain data."""

from typing import Any, NamedTuple


class Fact(NamedTuple):
    """One of the main numbers of a report, with a `label`, a `value`, and a `detail`."""

    label: str
    value: str
    detail: str = ""


class Key(NamedTuple):
    """One entry of a legend: a label, a colour, and how the line is drawn.

    The kinds of line are "line" or "solid", "dash", "dot", "dashdot", "longdash", "band" and "dots".
    """

    label: str
    colour: str
    drawn: str


class Table(NamedTuple):
    """A table with headings and rows of text."""

    heading: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


class Chart(NamedTuple):
    """One diagram of a report: its heading, its legend, and its traces and layout for plotly.js.

    The horizontal axis is that of the report, unless the layout has its own axis `xaxis`. `part`: the heading above the
    diagram. `table`: its numbers, which the reader may open.
    """

    heading: str
    keys: tuple[Key, ...]
    traces: tuple[dict[str, Any], ...]
    layout: dict[str, Any]
    caption: str = ""
    part: str = "What was estimated"
    table: Table | None = None

    @property
    def over(self) -> str:
        """The title of its own axis; empty if it has none."""
        return self.layout["xaxis"]["title"]["text"] if "xaxis" in self.layout else ""

    @property
    def is_square(self) -> bool:
        """Whether both axes have the same scale."""
        return "scaleanchor" in self.layout.get("yaxis", {})


class Finding(NamedTuple):
    """One consistency check of a report: its `name`, its `sentence`, and whether it is `met` (None: no verdict)."""

    name: str
    sentence: str
    met: bool | None


class Section(NamedTuple):
    """A table of terms and their descriptions."""

    heading: str
    items: tuple[tuple[str, str], ...]


class Report(NamedTuple):
    """The contents of a report: a title, sentences, main numbers, charts, checks, and the assumptions.

    - `commands`: pairs of what a command does and the command itself, which reproduce the report.
    - `tables`: tables below the main numbers. `found`: sections before the charts.
    - `times`: the values of the horizontal axis of the charts. They may be another quantity, which `time_axis` names. With
      `log_axis` the axis is logarithmic.
    """

    title: str
    lead: tuple[str, ...]
    facts: tuple[Fact, ...]
    times: Any
    time_axis: str
    charts: tuple[Chart, ...]
    verdicts: tuple[Finding, ...]
    sections: tuple[Section, ...]
    commands: tuple[tuple[str, str], ...]
    found: tuple[Section, ...] = ()
    log_axis: bool = False
    tables: tuple[Table, ...] = ()
