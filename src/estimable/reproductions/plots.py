"""The figures of the reproductions, in one style."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ..annotations import Numbers
from .entries import ReproducedRow

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9")  # distinguishable with colour blindness
DASHES = ("solid", "dash", "dot", "dashdot", "longdash")
SYMBOLS = ("circle-open", "x", "square-open", "diamond-open", "cross")
INK, FAINT = "#222222", "#767676"
PANEL = 330  # pixels


class Line(NamedTuple):
    """One curve; `sigma` draws its ± 1 sigma band, `colour` is an index into `COLOURS` or a colour."""

    name: str
    x: Any
    y: Any
    colour: int | str = 0
    dash: str = "solid"
    width: float = 2.0
    sigma: Any = None
    shape: str = "linear"


class Panel(NamedTuple):
    """One diagram: the title of its vertical axis, its lines, and its range (None: the full range)."""

    y: str
    lines: Sequence[Line]
    within: tuple[float, float] | None = None


def over_time(panels: Sequence[Panel], *, x: str = "time [s]") -> Any:
    """Curves over a common axis, one panel under the other."""
    from plotly.subplots import make_subplots

    figure = make_subplots(rows=len(panels), cols=1, shared_xaxes=True, vertical_spacing=0.06)
    named = set()
    for row, panel in enumerate(panels, start=1):
        for line in panel.lines:
            figure.add_traces(_traces(line, shown=line.name not in named), rows=row, cols=1)
            named.add(line.name)
    styled(figure, x="", y="", height=140 + PANEL * len(panels))
    for row, panel in enumerate(panels, start=1):
        figure.update_yaxes(title_text=panel.y, range=panel.within, row=row, col=1)
    figure.update_xaxes(title_text=x, row=len(panels), col=1)
    if len(panels) > 1:
        figure.update_xaxes(title_text="", row=1, col=1)
    return figure.update_layout(hovermode="x unified")


def band(gain: float, share: float, t: Numbers) -> list[Line]:
    """Dashed lines at a share above and below a value."""
    sides = [(f"± {100 * share:.0f} %", 1 + share), (f"± {100 * share:.0f} %", 1 - share)]
    ends = np.array([np.min(t), np.max(t)])
    return [Line(name, ends, np.full(2, gain * factor), FAINT, "dash", 1.5) for name, factor in sides]


def next_to_ours(rows: Sequence[ReproducedRow], labels: Sequence[Any], *, x: str, y: str) -> Any:
    """Published values next to ours with their sigmas, one label for each row."""
    import plotly.graph_objects as go

    figure = go.Figure()
    published = {"color": COLOURS[1], "symbol": SYMBOLS[1], "size": 12, "line": {"width": 2}}
    ours = {"color": COLOURS[0], "symbol": SYMBOLS[0], "size": 12, "line": {"width": 2}}
    bars = {"type": "data", "array": [row.sigma or 0.0 for row in rows], "width": 8, "thickness": 2}
    figure.add_scatter(
        x=labels, y=[row.mean for row in rows], mode="markers", name="ours ± 1 sigma", marker=ours, error_y=bars
    )
    figure.add_scatter(x=labels, y=[row.published for row in rows], mode="markers", name="published", marker=published)
    return styled(figure, x=x, y=y).update_xaxes(type="category")


def scatter(groups: dict[str, Any], *, x: str, y: str) -> Any:
    """Points in the complex plane, one symbol and colour for each group."""
    import plotly.graph_objects as go

    figure = go.Figure()
    for (name, values), colour, symbol in zip(groups.items(), COLOURS, SYMBOLS, strict=False):
        points = np.asarray(values, complex)
        marker = {"color": colour, "symbol": symbol, "size": 11, "line": {"width": 2}}
        figure.add_scatter(x=np.real(points), y=np.imag(points), mode="markers", name=name, marker=marker)
    return styled(figure, x=x, y=y)


def styled(figure: Any, *, x: str, y: str, height: int = 440) -> Any:
    """White ground, dark text, and a legend below with as many lines as it needs."""
    figure.update_layout(
        template="plotly_white", height=height, font={"size": 15, "color": INK},
        margin={"l": 70, "r": 20, "t": 50, "b": 60},
        legend={"orientation": "h", "y": -90 / (height - 110), "yanchor": "top", "x": 0.0, "font": {"size": 14}},
    )  # fmt: skip
    figure.update_xaxes(title_text=x, showline=True, linecolor="#666666", ticks="outside")
    figure.update_yaxes(title_text=y, showline=True, linecolor="#666666", ticks="outside")
    return figure


def _traces(line: Line, *, shown: bool) -> list[Any]:
    import plotly.graph_objects as go

    colour = line.colour if isinstance(line.colour, str) else COLOURS[line.colour]
    how = {"color": colour, "dash": line.dash, "width": line.width, "shape": line.shape}
    drawn = [
        go.Scatter(x=line.x, y=line.y, name=line.name, line=how, mode="lines", legendgroup=line.name, showlegend=shown)
    ]
    if line.sigma is None:
        return drawn
    bare = {"mode": "lines", "line": {"width": 0}, "hoverinfo": "skip", "showlegend": False, "legendgroup": line.name}
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    fill = {"fill": "tonexty", "fillcolor": f"rgba({red},{green},{blue},0.25)"}
    upper, lower = np.asarray(line.y) + line.sigma, np.asarray(line.y) - line.sigma
    return [go.Scatter(x=line.x, y=upper, **bare), go.Scatter(x=line.x, y=lower, **bare, **fill), *drawn]
