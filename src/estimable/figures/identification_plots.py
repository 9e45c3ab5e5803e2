"""Figures of identification."""

from typing import Any

import numpy as np
import plotly.graph_objects as go

LINE, LIMIT = "#0072B2", "#D55E00"
CRITERIA = (
    ("bic", "BIC", LINE, "solid"), ("aicc", "AICc", LIMIT, "dash"), ("aic", "AIC", "#CC79A7", "dot"),
    ("cross_validation", "cross-validation", "#009E73", "dashdot"),
)  # fmt: skip


def plot_excitation(found: Any) -> go.Figure:
    """The smallest eigenvalue of the scaled information over the samples, on a logarithmic axis, with its limit."""
    figure = go.Figure()
    positive = found.eigenvalues > 0
    figure.add_scatter(
        x=found.samples[positive], y=found.eigenvalues[positive], mode="lines", line={"color": LINE, "width": 2},
        name="smallest eigenvalue",
    )  # fmt: skip
    figure.add_hline(y=found.check.limit, line_dash="dash", line_color=LIMIT, annotation_text="limit")
    figure.update_layout(template="plotly_white", height=380, title=found.check.sentence, font={"size": 13})
    figure.update_xaxes(title_text="sample")
    figure.update_yaxes(title_text="of the scaled information", type="log")
    return figure


def plot_orders(found: Any) -> go.Figure:
    """Each criterion relative to its minimum, by order; the recommended order is dashed."""
    figure, tops = go.Figure(), [10.0]
    for name, word, colour, dash in CRITERIA:
        values = getattr(found, name)
        finite = np.isfinite(values)
        above = values[finite] - values[finite].min()
        tops.append(float(above[found.orders[finite] >= found.order].max(initial=0.0)))
        figure.add_scatter(
            x=found.orders[finite], y=above, mode="lines+markers", name=word, line={"color": colour, "dash": dash}
        )
    figure.add_vline(x=found.order, line_dash="dash", annotation_text="recommended")
    figure.update_layout(template="plotly_white", height=380, title=found.sentence, font={"size": 13})
    figure.update_xaxes(title_text="order", dtick=1)
    figure.update_yaxes(title_text="above its minimum", range=[-0.05 * max(tops), 1.2 * max(tops)])
    return figure
