"""The figure of an estimate."""

from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from .. import checks
from .bands import Band, bands, broken, cropped

LINES = {
    "state": "#0072B2",
    "gain": "#D55E00",
    "unknown_input": "#009E73",
    "innovation": "#555555",
}  # distinguishable with colour blindness
FILLS = {"state": "rgba(0,114,178,0.2)", "gain": "rgba(213,94,0,0.2)", "unknown_input": "rgba(0,158,115,0.2)"}
ROW = 170  # pixels
GAP = 48  # pixels between two rows, for a title
EDGES = 130  # pixels above the first row and below the last


def plot_estimate(result: Any) -> go.Figure:
    """States, gains and unknown inputs with their 2 sigma bands, innovations with their ±2 sigma bounds, one row each.

    Quantities that the result does not hold are omitted. The line of an unknown quantity (a diffuse prior) has a gap. A
    result of one row is drawn as points with error bars.

    Raises `InputError` if the result has no row.
    """
    panels = bands(result)
    if not panels:
        checks.refuse('this result has no rows to draw, because it was made with keep="likelihood". Use keep="all".')
    t, axis = _time(result, len(panels[0].middle))
    height = EDGES + ROW * len(panels) + GAP * (len(panels) - 1)
    figure = make_subplots(
        rows=len(panels), cols=1, shared_xaxes=True, subplot_titles=[_title(panel) for panel in panels],
        vertical_spacing=GAP / (height - EDGES),
    )  # fmt: skip
    for row, panel in enumerate(panels, start=1):
        traces = _points(t, panel) if len(t) == 1 else _curves(*broken(t, panel))
        figure.add_traces(traces, rows=row, cols=1)
        figure.update_yaxes(range=cropped(panel), row=row, col=1)
    figure.update_xaxes(showticklabels=True)
    figure.update_xaxes(title_text=axis, row=len(panels), col=1)
    return _laid_out(figure, height)


def _time(result: Any, rows: int) -> tuple[np.ndarray, str]:
    """The time axis and its title."""
    return (np.arange(rows), "sample") if result.t is None else (result.t, "time (s)")


def _title(panel: Band) -> str:
    titles = {"unknown_input": f"unknown input {panel.name}", "innovation": f"innovation of {panel.name}"}
    spread = ", bounds ± 2 sigma" if panel.kind == "innovation" else ", ± 2 sigma"
    return titles.get(panel.kind, panel.name) + ("" if panel.sigma is None else spread)


def _curves(t: np.ndarray, panel: Band) -> list[go.Scatter]:
    """The quantity above its band; an innovation below its bounds."""
    line, spread = _line(t, panel), _spread(t, panel)
    return [line, *spread] if panel.kind == "innovation" else [*spread, line]


def _line(t: np.ndarray, panel: Band) -> go.Scatter:
    """The quantity itself."""
    known = panel.middle if panel.sigma is None else np.where(np.isinf(panel.sigma), np.nan, panel.middle)
    width = 1.0 if panel.kind == "innovation" else 1.8
    return go.Scatter(x=t, y=known, mode="lines", line={"color": LINES[panel.kind], "width": width}, name=panel.name)


def _spread(t: np.ndarray, panel: Band) -> list[go.Scatter]:
    """The band about an estimate, or the bounds about zero of an innovation."""
    if panel.sigma is None:
        return []
    sigma = np.where(np.isinf(panel.sigma), np.nan, panel.sigma)
    if panel.kind == "innovation":
        dashed = {"color": "#CC79A7", "width": 1.5, "dash": "dash"}
        bounds = {"+": 2 * sigma, "-": -2 * sigma}
        return [_edge(t, bound, f"{panel.name} {sign}2 sigma", line=dashed) for sign, bound in bounds.items()]
    fill = {"fill": "tonexty", "fillcolor": FILLS[panel.kind]}
    bare = {"width": 0}
    return [
        _edge(t, panel.middle + 2 * sigma, f"{panel.name} +2 sigma", line=bare),
        _edge(t, panel.middle - 2 * sigma, f"{panel.name} -2 sigma", line=bare, **fill),
    ]


def _edge(t: np.ndarray, y: np.ndarray, name: str, **how: Any) -> go.Scatter:
    return go.Scatter(x=t, y=y, mode="lines", name=name, **how)


def _points(t: np.ndarray, panel: Band) -> list[go.Scatter]:
    """A quantity of one sample: a point, with an error bar of 2 sigma."""
    bar = None
    if panel.sigma is not None and np.all(np.isfinite(panel.sigma)):
        bar = {"type": "data", "array": 2 * panel.sigma, "color": LINES[panel.kind]}
    marker = {"color": LINES[panel.kind], "size": 8}
    return [go.Scatter(x=t, y=panel.middle, mode="markers", marker=marker, error_y=bar, name=panel.name)]


def _laid_out(figure: go.Figure, height: int) -> go.Figure:
    """Titles at the left, and no legend: each row has a title."""
    figure.update_layout(
        template="plotly_white", height=height, showlegend=False, hovermode="x unified",
        margin={"l": 70, "r": 30, "t": 60, "b": 70}, font={"size": 13},
    )  # fmt: skip
    figure.update_annotations(x=0.0, xanchor="left", font={"size": 14})
    return figure
