"""A report as one self-contained HTML page: it loads nothing, and equal reports give equal files."""

import base64
import hashlib
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from ..writing import write
from .contents import Report

WORDS = {True: ("met", "✓ consistent"), False: ("unmet", "✗ not consistent"), None: ("unjudged", "– no verdict")}
DASHES = {"dash": "6 4", "dot": "2.5 3", "dashdot": "8 3 2.5 3", "longdash": "11 4"}


def write_report(report: Report, path: str | Path) -> None:
    """Write a report to an HTML file that needs no other file. If this fails, it raises `InputError`, and an older file stays
    unchanged.
    """
    page = page_of(report).encode()
    write(path, lambda stream: stream.write(page))


def page_of(report: Report) -> str:
    """The HTML text of a report."""
    data = {
        "times": base64.b64encode(np.asarray(report.times, "<f8").tobytes()).decode(),
        "timeAxis": report.time_axis,
        "logAxis": report.log_axis,
        "charts": [{"traces": chart.traces, "layout": chart.layout} for chart in report.charts],
    }
    scripts = _plotly(), _asset("page.js")
    return _template().render(
        report=report, over="time" if report.time_axis == "sample" else report.time_axis.split(" [")[0], data=data,
        style=Markup(_asset("page.css")), scripts=map(Markup, scripts), policy=_policy(*scripts), words=WORDS, dashes=DASHES,
    )  # fmt: skip


@cache
def _template() -> Any:
    """The page template, with automatic escaping."""
    environment = Environment(loader=PackageLoader("estimable", "report"), autoescape=True, undefined=StrictUndefined)
    environment.policies["json.dumps_kwargs"] = {"allow_nan": False}
    return environment.get_template("page.html")


@cache
def _policy(*scripts: str) -> str:
    """The policy that allows only these scripts and no loading. Plotly writes styles, and draws images of its diagrams."""
    hashes = " ".join(f"'sha256-{base64.b64encode(hashlib.sha256(s.encode()).digest()).decode()}'" for s in scripts)
    return f"default-src 'none'; script-src {hashes}; style-src 'unsafe-inline'; img-src data: blob:; base-uri 'none'"


@cache
def _asset(name: str) -> str:
    return files("estimable.report").joinpath(name).read_text(encoding="utf-8")


@cache
def _plotly() -> str:
    """plotly.js, read from its package data."""
    import plotly

    return (Path(plotly.__file__).parent / "package_data" / "plotly.min.js").read_text(encoding="utf-8")
