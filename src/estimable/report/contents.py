"""The contents of a report, as plain data."""

from typing import Any, NamedTuple


class Fact(NamedTuple):
    """One of the main numbers of a report: its label, its value, and a detail."""

    label: str
    value: str
    detail: str = ""


class Key(NamedTuple):
    """One entry of a legend: its label, its colour, and how it is drawn: "line" or "solid", "dash", "dot", "dashdot",
    "longdash", "band" or "dots"."""

    label: str
    colour: str
    drawn: str


class Chart(NamedTuple):
    """One diagram: heading, legend, and the traces and layout of plotly.js.

    Its times are those of the report, unless the layout has its own axis `xaxis`. `part`: the heading above it.
    """

    heading: str
    keys: tuple[Key, ...]
    traces: tuple[dict[str, Any], ...]
    layout: dict[str, Any]
    caption: str = ""
    part: str = "What was estimated"

    @property
    def over(self) -> str:
        """The title of its own axis; empty if it has none."""
        return self.layout["xaxis"]["title"]["text"] if "xaxis" in self.layout else ""

    @property
    def is_square(self) -> bool:
        """Whether both axes have the same scale."""
        return "scaleanchor" in self.layout.get("yaxis", {})


class Finding(NamedTuple):
    """One consistency check: its name, its sentence, and whether it is met (None: no verdict)."""

    name: str
    sentence: str
    met: bool | None


class Section(NamedTuple):
    """A table of terms and their descriptions."""

    heading: str
    items: tuple[tuple[str, str], ...]


class Report(NamedTuple):
    """A page: title, findings as sentences, facts, charts over `times`, verdicts, and the assumptions.

    `commands`: (what it does, what to type) that reproduce it; `found`: sections before the charts. `times` may be another
    quantity, which `time_axis` names; with `log_axis` its axis is logarithmic.
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
