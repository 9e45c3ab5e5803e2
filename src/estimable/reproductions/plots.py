"""The pictures of the reproductions: one look for all of them."""

from typing import Any

import numpy as np
import plotly.graph_objects as go

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9")  # told apart by colour-blind eyes too
DASHES = ("solid", "solid", "dash", "dot", "dashdot")
SYMBOLS = ("circle-open", "x", "square-open", "diamond-open", "cross")
INK = "#222222"


def scatter(groups: dict[str, Any], *, x: str, y: str) -> go.Figure:
    """Points in the complex plane, one symbol and colour a group."""
    figure = go.Figure()
    for (name, values), colour, symbol in zip(groups.items(), COLOURS, SYMBOLS, strict=False):
        points = np.asarray(values, complex)
        marker = {"color": colour, "symbol": symbol, "size": 11, "line": {"width": 2}}
        figure.add_scatter(x=np.real(points), y=np.imag(points), mode="markers", name=name, marker=marker)
    return styled(figure, x=x, y=y)


def styled(figure: go.Figure, *, x: str, y: str, height: int = 440) -> go.Figure:
    """White ground, dark text, a legend above."""
    figure.update_layout(
        template="plotly_white", height=height, font={"size": 15, "color": INK},
        margin={"l": 70, "r": 20, "t": 50, "b": 60},
        legend={"orientation": "h", "y": 1.02, "yanchor": "bottom", "x": 0.0, "font": {"size": 14}},
    )  # fmt: skip
    figure.update_xaxes(title_text=x, showline=True, linecolor="#666666", ticks="outside")
    figure.update_yaxes(title_text=y, showline=True, linecolor="#666666", ticks="outside")
    return figure
