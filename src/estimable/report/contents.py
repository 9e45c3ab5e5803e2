"""What a report holds: plain data, from which the page is made."""

from typing import Any, NamedTuple


class Fact(NamedTuple):
    """One number that a reader looks for first: what it is, its value, and a word of detail."""

    label: str
    value: str
    detail: str = ""


class Key(NamedTuple):
    """One line of a legend: what it means, its colour, and how it is drawn: "line" or "solid", "dash", "dot", "dashdot",
    "longdash", "band" or "dots"."""

    label: str
    colour: str
    drawn: str


class Chart(NamedTuple):
    """One diagram: heading, legend, and the traces and layout of plotly.js.

    Its times are those of the report, unless the layout has an axis `xaxis` of its own. `part`: the heading it stands under.
    """

    heading: str
    keys: tuple[Key, ...]
    traces: tuple[dict[str, Any], ...]
    layout: dict[str, Any]
    caption: str = ""
    part: str = "What was estimated"

    @property
    def over(self) -> str:
        """The title of its own axis; empty where it has none."""
        return self.layout["xaxis"]["title"]["text"] if "xaxis" in self.layout else ""

    @property
    def is_square(self) -> bool:
        """Whether both axes have one scale."""
        return "scaleanchor" in self.layout.get("yaxis", {})


class Finding(NamedTuple):
    """One consistency check: its name, what it says, and whether it is met (None: it says nothing of that)."""

    name: str
    sentence: str
    met: bool | None


class Section(NamedTuple):
    """Pairs of a term and what is said of it."""

    heading: str
    items: tuple[tuple[str, str], ...]


class Report(NamedTuple):
    """A page: title, what was found in sentences, facts, charts over `times`, verdicts, and what stands behind them.

    `commands`: (what it does, what to type) that reproduce it; `found`: sections that stand before the charts.
    `times` may be another quantity, which `time_axis` names, on a logarithmic axis where `log_axis` says so.
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
