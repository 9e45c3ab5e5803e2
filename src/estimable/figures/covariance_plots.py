"""The figure of a covariance analysis."""

import math
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from ..analysis.answered import AnsweredQuestion

KNOWN, ALONE, WANTED = "#0072B2", "#777777", "#D55E00"  # distinguishable with colour blindness
COLUMNS = 3


def plot_covariance(found: AnsweredQuestion) -> go.Figure:
    """Sigma over time for each quantity, on logarithmic axes: with the outputs, by the model alone (dashed), and the requirement
    with the time from which on it is met."""
    q = len(found.names)
    columns = min(q, COLUMNS)
    rows = math.ceil(q / columns)
    figure = make_subplots(rows=rows, cols=columns, subplot_titles=list(found.names))
    first = found.time[1] / 2 if len(found.time) > 1 else 1.0
    time = np.where(found.time > 0, found.time, first)  # a logarithmic axis has no zero
    for i in range(q):
        where: dict[str, Any] = {"row": i // columns + 1, "col": i % columns + 1}
        lines = (
            ("model alone", found.prior_sigma[:, i], {"color": ALONE, "dash": "dash"}),
            ("with the outputs", found.sigma[:, i], {"color": KNOWN, "width": 2}),
        )
        for name, values, line in lines:
            shown = [None if not np.isfinite(v) or v <= 0 else float(v) for v in values]
            figure.add_trace(go.Scatter(x=time, y=shown, name=name, line=line, showlegend=i == 0), **where)
        r, since = found.requirement[i], found.time_to_requirement[i]
        if np.isfinite(r):
            figure.add_hline(y=r, line={"color": WANTED, "dash": "dot"}, **where)
        if np.isfinite(since):
            mark = go.Scatter(x=[max(since, first)], y=[r], mode="markers", name="met from here on",
                              marker={"color": WANTED, "size": 9}, showlegend=False)  # fmt: skip
            figure.add_trace(mark, **where)
    figure.update_xaxes(type="log", exponentformat="power")
    figure.update_yaxes(type="log", exponentformat="power")
    for i in range(columns):
        figure.update_xaxes(title_text="time, s", row=rows, col=i + 1)
    figure.update_yaxes(title_text="sigma", col=1)
    figure.update_layout(
        template="plotly_white", height=max(320, 240 * rows), font={"size": 13},
        margin={"l": 70, "r": 30, "t": 50, "b": 60}, legend={"orientation": "h", "x": 0, "y": 1.12},
    )  # fmt: skip
    return figure
