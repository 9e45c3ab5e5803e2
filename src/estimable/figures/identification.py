"""Figures of identification."""

from typing import Any

import plotly.graph_objects as go

LINE = "#0072B2"


def plot_excitation(found: Any) -> go.Figure:
    """The smallest eigenvalue of the scaled information over the samples, on a logarithmic axis; its limit dashed."""
    figure = go.Figure()
    told = found.eigenvalues > 0
    figure.add_scatter(
        x=found.samples[told], y=found.eigenvalues[told], mode="lines", line={"color": LINE, "width": 2},
        name="smallest eigenvalue",
    )  # fmt: skip
    figure.add_hline(y=found.check.limit, line_dash="dash", line_color="#D55E00", annotation_text="limit")
    figure.update_layout(template="plotly_white", height=380, title=found.check.sentence, font={"size": 13})
    figure.update_xaxes(title_text="sample")
    figure.update_yaxes(title_text="of the scaled information", type="log")
    return figure
