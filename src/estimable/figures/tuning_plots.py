"""The figure of a rho synthesis: every criterion over the bandwidth."""

from typing import Any

import numpy as np

KINDS = (  # the kinds of disturbances, and the criteria for each
    ("An impulse", ("response_time",)),
    ("Unmodelled terms", ("rho", "sigma")),
    ("A bounded force", ("external", "peak_gain")),
    ("Noise", ("dispersion", "control")),
    ("A constant force", ("static_error",)),
    ("A harmonic force", ("resonance", "magnification")),
)
WORDS = {
    "response_time": ("response time", "s"),
    "rho": ("margin rho", ""),
    "sigma": ("margin sigma", ""),
    "external": ("state per bounded force, 1 / rho", ""),
    "peak_gain": ("one state per bounded force", ""),
    "dispersion": ("rms of the state", ""),
    "control": ("rms of the control", ""),
    "static_error": ("state per constant force", ""),
    "resonance": ("peak resonance", ""),
    "magnification": ("peak over static", ""),
    "composite": ("composite", ""),
}
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#7A5C00", "#6A3D9A", "#117733", "#882255", "#444444")
DASHES = ("solid", "dash", "dot", "dashdot", "longdash")
CHOSEN, INK = "#1A1A1A", "#222222"
MOST = 10.0  # times the best value: the range shown at first


def speed(bandwidth: float) -> str:
    """A bandwidth, as text.

    >>> speed(4.5912), speed(float("inf"))
    ('4.59 rad/s', 'no bandwidth')
    """
    return f"{bandwidth:.3g} rad/s" if np.isfinite(bandwidth) else "no bandwidth"


def series(found: Any) -> list[tuple[str, str, str, str, Any, Any]]:
    """For each criterion: name, title, colour, dash, values, and the factor by which they are worse than the best; last the
    composite of several. `external` is omitted: relative to its best, it equals `rho`."""
    rows = []
    names = [name for name in found.criteria if name != "external"]
    names += ["composite"] if len(found.weights) > 1 else []
    for i, name in enumerate(names):
        values = found.composite if name == "composite" else found.criteria[name]
        times = values if name == "composite" else found.times_worse(name)
        colour = CHOSEN if name == "composite" else COLOURS[i % len(COLOURS)]
        rows.append((name, WORDS[name][0], colour, DASHES[i % len(DASHES)], values, times))
    return rows


def plot_tuning(found: Any) -> Any:
    """The factor by which each criterion is worse than its best, over the bandwidth, with its optimum and the chosen design."""
    import plotly.graph_objects as go

    figure, ω = go.Figure(), np.where(np.isfinite(found.bandwidth), found.bandwidth, np.nan)
    for name, words, colour, dash, values, times in series(found):
        unit = f" {WORDS[name][1]}" if WORDS[name][1] else ""
        hover = f"{words}: %{{customdata:.4g}}{unit} (%{{y:.3g}} of the best)"
        how = {"legendgroup": name, "name": words, "customdata": values, "hovertemplate": hover + "<extra></extra>"}
        figure.add_scatter(x=ω, y=times, mode="lines", line={"color": colour, "dash": dash, "width": 2.5}, **how)
        at = found.optima[name].design
        mark = {"color": colour, "symbol": "circle", "size": 11, "line": {"color": "#FFFFFF", "width": 1.5}}
        figure.add_scatter(
            x=[ω[at]],
            y=[times[at]],
            mode="markers",
            marker=mark,
            showlegend=False,
            **{**how, "customdata": [values[at]]},
        )
    place = ω[found.chosen]
    if np.isfinite(place):
        across = {"type": "line", "x0": place, "x1": place, "yref": "paper", "y0": 0, "y1": 1}
        figure.add_shape(**across, line={"color": CHOSEN, "dash": "dash", "width": 2})
        figure.add_annotation(x=np.log10(place), y=1, yref="paper", yanchor="bottom", text="chosen", showarrow=False)
    figure.update_layout(
        template="plotly_white", height=620, font={"size": 15, "color": INK}, margin={"l": 70, "r": 20, "t": 50, "b": 60},
        legend={"orientation": "h", "y": -0.18, "yanchor": "top", "x": 0.0, "font": {"size": 14}}, hovermode="closest",
    )  # fmt: skip
    axis = {"type": "log", "showline": True, "linecolor": "#666666", "ticks": "outside"}
    figure.update_xaxes(title_text="bandwidth of the loop [rad/s]", **axis)
    figure.update_yaxes(title_text="times worse than its own best", range=[-0.03, np.log10(MOST)], **axis)
    return figure
