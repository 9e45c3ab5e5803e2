"""A report as one self-contained HTML page: nothing is loaded from anywhere, equal reports are equal files."""

import base64
import json
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from .contents import Chart, Fact, Finding, Key, Report, Section

HINT = "Drag over a diagram to zoom all that share its axis, double-click to go back, point at a curve for its value."
WORDS = {True: ("met", "✓ consistent"), False: ("unmet", "✗ not consistent"), None: ("unjudged", "– no verdict")}
SWATCHES = {
    "line": '<line x1="0" y1="6" x2="26" y2="6" stroke="{0}" stroke-width="2.5"/>',
    "dot": '<line x1="0" y1="6" x2="26" y2="6" stroke="{0}" stroke-width="2.5" stroke-dasharray="2.5 3"/>',
    "dashdot": '<line x1="0" y1="6" x2="26" y2="6" stroke="{0}" stroke-width="2.5" stroke-dasharray="8 3 2.5 3"/>',
    "longdash": '<line x1="0" y1="6" x2="26" y2="6" stroke="{0}" stroke-width="2.5" stroke-dasharray="11 4"/>',
    "dash": '<line x1="0" y1="6" x2="26" y2="6" stroke="{0}" stroke-width="2.5" stroke-dasharray="6 4"/>',
    "band": '<rect x="0" y="1" width="26" height="10" fill="{0}" fill-opacity="0.25"/>',
    "dots": '<g fill="{0}"><circle cx="4" cy="7" r="2"/><circle cx="13" cy="4" r="2"/><circle cx="22" cy="8" r="2"/></g>',
}


def write_report(report: Report, path: str | Path) -> None:
    """Write a report to an HTML file that needs nothing else."""
    Path(path).write_text(page_of(report), encoding="utf-8")


def page_of(report: Report) -> str:
    """The HTML of a report."""
    body = [
        f"<h1>{escape(report.title)}</h1>",
        '<div class="lead">' + "".join(f"<p>{escape(sentence)}</p>" for sentence in report.lead) + "</div>",
        _facts(report.facts),
        *map(_section, report.found),
        *_charts(report.charts, "time" if report.time_axis == "sample" else report.time_axis.split(" [")[0]),
        "<h2>Can it be trusted?</h2>",
        "<table><tbody>" + "".join(map(_verdict, report.verdicts)) + "</tbody></table>",
        "<h2>What was assumed</h2>",
        *map(_section, report.sections),
        *(["<h2>How to reproduce it</h2>", *map(_command, report.commands)] if report.commands else []),
    ]  # fmt: skip
    data = {
        "times": base64.b64encode(np.asarray(report.times, "<f8").tobytes()).decode(),
        "timeAxis": report.time_axis,
        "logAxis": report.log_axis,
        "charts": [{"traces": chart.traces, "layout": chart.layout} for chart in report.charts],
    }
    return "\n".join(
        [
            "<!DOCTYPE html>", '<html lang="en">', "<head>", '<meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<title>{escape(report.title)}</title>", f"<style>\n{_asset('page.css')}</style>", "</head>", "<body>", "<main>",
            *body, "</main>",
            "<noscript><p>The diagrams need JavaScript; nothing is loaded from elsewhere.</p></noscript>",
            f'<script type="application/json" id="data">{_embedded(data)}</script>',
            f"<script>{_plotly()}</script>", f"<script>\n{_asset('page.js')}</script>", "</body>", "</html>", "",
        ]
    )  # fmt: skip


def _facts(facts: tuple[Fact, ...]) -> str:
    if not facts:
        return ""
    tiles = (
        f"<div><dt>{escape(fact.label)}</dt><dd>{escape(fact.value)}<small>{escape(fact.detail)}</small></dd></div>"
        for fact in facts
    )
    return f'<dl class="facts">{"".join(tiles)}</dl>'


def _charts(charts: tuple[Chart, ...], over: str) -> list[str]:
    """The diagrams, each part under its heading."""
    drawn, part = [], None
    for i, chart in enumerate(charts):
        if chart.part != part:
            drawn.append(f"<h2>{escape(chart.part)}</h2>")
            drawn += [f'<p class="hint screen">{HINT}</p>'] if part is None else []
        part = chart.part
        drawn.append(_chart(i, chart, over))
    return drawn


def _chart(i: int, chart: Chart, over: str) -> str:
    heading = f"<h3>{escape(chart.heading)}</h3>"
    keys = f'<ul class="keys">{"".join(map(_key, chart.keys))}</ul>'
    caption = f"<figcaption>{escape(chart.caption)}</figcaption>" if chart.caption else ""
    own = chart.layout.get("xaxis")
    label = escape(f"{chart.heading} over {own['title']['text'] if own else over}")
    kind = "chart square" if "scaleanchor" in chart.layout.get("yaxis", {}) else "chart"
    return f'<figure>{heading}{keys}<div class="{kind}" id="chart{i}" role="img" aria-label="{label}"></div>{caption}</figure>'


def _key(key: Key) -> str:
    drawing = SWATCHES["line" if key.drawn == "solid" else key.drawn].format(escape(key.colour))
    return f'<li><svg width="26" height="12" aria-hidden="true">{drawing}</svg>{escape(key.label)}</li>'


def _verdict(verdict: Finding) -> str:
    kind, word = WORDS[verdict.met]
    sentence = verdict.sentence[:1].upper() + verdict.sentence[1:]
    return f'<tr><th>{escape(verdict.name)}</th><td class="{kind}">{word}</td><td>{escape(sentence)}</td></tr>'


def _section(section: Section) -> str:
    rows = (f"<tr><th>{escape(term)}</th><td>{escape(text)}</td></tr>" for term, text in section.items)
    return f"<h3>{escape(section.heading)}</h3><table><tbody>{''.join(rows)}</tbody></table>"


def _command(command: tuple[str, str]) -> str:
    return f"<p>{escape(command[0])}</p><pre>{escape(command[1])}</pre>"


def _embedded(data: Any) -> str:
    """JSON that cannot end the element it stands in."""
    return json.dumps(data, allow_nan=False).replace("</", "<\\/")


def _asset(name: str) -> str:
    return files("estimable.report").joinpath(name).read_text(encoding="utf-8")


def _plotly() -> str:
    """plotly.js, from its package, which is not loaded for that."""
    import plotly

    return (Path(plotly.__file__).parent / "package_data" / "plotly.min.js").read_text(encoding="utf-8")
