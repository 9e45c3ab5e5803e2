"""The figure of a verdict."""

import math
from typing import Any

import plotly.graph_objects as go
from plotly.subplots import make_subplots

PREDICTED, FILTERED, SPECTRUM = "#0072B2", "#56B4E9", "#555555"  # distinguishable with colour blindness
FLOOR = 1e-17  # where a singular value of zero is drawn on the logarithmic axis


def plot_estimability(found: Any) -> go.Figure:
    """By how much the outputs reduce the variance of each state, and the Gramian's spectrum with the limits of the verdict.

    Left: a pair of bars for each state, with past outputs only and with the present one. Right: the singular values relative to
    the largest, as points, with the limits of a verdict over a horizon (in steady state the verdict is that of the model itself).
    """
    figure = make_subplots(
        rows=1, cols=2, subplot_titles=["variance reduction by the outputs", "singular values, relative to the largest"]
    )
    shares = (
        ("past outputs", found.variance_reduction, PREDICTED),
        ("and the present", found.filter_variance_reduction, FILTERED),
    )
    for name, share, colour in shares:
        bar = go.Bar(x=list(found.states), y=100 * share, name=name, marker_color=colour)
        figure.add_trace(bar, row=1, col=1)
    figure.update_yaxes(title_text="%", range=[0, 105], row=1, col=1)
    _spectrum(figure, found)
    figure.update_layout(
        template="plotly_white", height=380, barmode="group", font={"size": 13},
        margin={"l": 70, "r": 30, "t": 60, "b": 70}, legend={"orientation": "h", "x": 0, "y": -0.15},
    )  # fmt: skip
    return figure


def _spectrum(figure: go.Figure, found: Any) -> None:
    σ = found.singular_values
    relative = [max(float(value / σ[0]), FLOOR) if σ[0] > 0 else FLOOR for value in σ]
    number = list(range(1, len(σ) + 1))
    points = go.Scatter(x=number, y=relative, mode="markers", marker={"color": SPECTRUM, "size": 9}, showlegend=False)
    figure.add_trace(points, row=1, col=2)
    for limit, meaning in zip(found.tolerance, ("below: zero", "below: borderline"), strict=True):
        across: Any = {"row": 1, "col": 2}
        figure.add_hline(y=limit, line={"dash": "dash", "color": "#CC79A7"}, **across)
        where = {
            "xref": "x2 domain",
            "x": 1.0,
            "yref": "y2",
            "y": math.log10(limit),
            "xanchor": "right",
            "yanchor": "top",
        }
        figure.add_annotation(text=meaning, showarrow=False, font={"size": 11}, **where)
    figure.update_yaxes(type="log", exponentformat="power", row=1, col=2)
    figure.update_xaxes(title_text="number", dtick=1 if len(σ) <= 12 else None, row=1, col=2)
