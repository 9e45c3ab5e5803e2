"""The picture of an example: its `figure`, or what is drawn of the record that it ends with."""

import base64
from collections.abc import Callable
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from estimable import diagnostics

BLUE, ORANGE, GREEN, GREY = "#0072B2", "#D55E00", "#009E73", "#777777"
COLOURS = (BLUE, ORANGE, GREEN, "#CC79A7", "#7A5C00", GREY)
SIGNALS = (BLUE, "#CC79A7", "#7A5C00", GREY)  # orange is for gains
BANDS = {BLUE: "rgba(0,114,178,0.2)", ORANGE: "rgba(213,94,0,0.2)"}
Picture = tuple[go.Figure, str]  # and what it shows


def picture(names: dict[str, Any], of: str = "") -> Picture:
    """The figure that an example has made; else a drawing of the record called `of`, or of the last that has one."""
    if isinstance(names.get("figure"), go.Figure):
        return names["figure"], "The figure of this example."
    for name, thing in [(of, names[of])] if of else reversed(names.items()):
        draw = OF.get(type(thing).__name__)
        if draw is not None:
            figure, caption = draw(thing)
            return figure, caption.replace("{}", name)
    raise LookupError("the example assigns no `figure`, and nothing that the build can draw")


def height_of(figure: Any) -> int:
    """The pixels of a figure from top to bottom; plotly's own where it says nothing."""
    return int(figure.layout.height or 450)


def json_of(figure: go.Figure) -> str:
    """The figure as plotly.js reads it, with curves in single precision, safe inside an HTML page."""
    small: Any = go.Figure(figure)
    for trace in small.data:
        for axis in ("x", "y"):
            values = trace[axis]
            if values is not None and len(values) > 50 and np.asarray(values).dtype.kind == "f":
                packed = base64.b64encode(np.asarray(values, "<f4").tobytes()).decode()
                trace[axis] = {"dtype": "f4", "bdata": packed}
    small.update_layout(template="plotly_white", paper_bgcolor="#FFFFFF", width=None, autosize=True)
    return small.to_json().replace("</", "<\\/")


def _laid_out(figure: go.Figure, across: str, up: str, height: int = 320) -> go.Figure:
    figure.update_layout(
        template="plotly_white", height=height, font={"size": 13}, margin={"l": 70, "r": 20, "t": 40, "b": 55},
        legend={"orientation": "h", "y": 1.02, "yanchor": "bottom", "x": 0.0},
    )  # fmt: skip
    figure.update_xaxes(title_text=across, row=None)
    figure.update_yaxes(title_text=up)
    return figure


def _with_band(figure: go.Figure, x: Any, middle: Any, sigma: Any, colour: str = BLUE, row: int | None = None) -> None:
    """A curve above its band of two standard deviations."""
    place = {} if row is None else {"row": row, "col": 1}
    if np.isfinite(sigma).any():
        bare = {"mode": "lines", "line": {"width": 0}, "showlegend": False, "hoverinfo": "skip"}
        figure.add_scatter(x=x, y=middle + 2 * sigma, **bare, **place)
        figure.add_scatter(x=x, y=middle - 2 * sigma, fill="tonexty", fillcolor=BANDS[colour], **bare, **place)
    figure.add_scatter(x=x, y=middle, mode="lines", line={"color": colour, "width": 2}, showlegend=False, **place)


def _fit(fit: Any) -> Picture:
    found = diagnostics.step_response(fit)
    figure = go.Figure()
    _with_band(figure, found.at, found.values[:, 0, 0], found.sigma[:, 0, 0])
    caption = "The response of {} to a step, with its band of 2 sigma: diagnostics.step_response({})."
    return _laid_out(figure, "time (s)", "output"), caption


def _closed_loop(flown: Any) -> Picture:
    gains = flown.info.gain is not None
    titles = ["outputs, and the reference (dashed)", "commands", "gains, with their bands of 2 sigma"][: 2 + gains]
    figure = make_subplots(rows=len(titles), cols=1, shared_xaxes=True, subplot_titles=titles, vertical_spacing=0.12)
    for row, columns in enumerate((flown.output, flown.command), start=1):
        for i, column in enumerate(np.asarray(columns).T):
            line = {"color": SIGNALS[i % len(SIGNALS)], "width": 1.4}
            figure.add_scatter(x=flown.t, y=column, mode="lines", line=line, row=row, col=1)
    for column in np.asarray(flown.reference).T:
        dashed = {"color": "#222222", "dash": "dash", "width": 1.4}
        figure.add_scatter(x=flown.t, y=column, mode="lines", line=dashed, row=1, col=1)
    for i in range(flown.gain.shape[1] if gains else 0):
        _with_band(figure, flown.t, flown.gain[:, i], np.sqrt(flown.gain_covariance[:, i, i]), ORANGE, row=3)
    _laid_out(figure, "", "", 190 * len(titles)).update_layout(showlegend=False)
    figure.update_xaxes(title_text="time (s)", row=len(titles), col=1)
    figure.update_annotations(x=0.0, xanchor="left", font={"size": 14})
    return figure, "The run {}: its outputs, its commands" + (", and the estimated gains." if gains else ".")


def _monte_carlo(runs: Any) -> Picture:
    name = next(iter(runs.values))
    count, edges = np.histogram(np.ravel(runs.values[name]), bins=30)
    figure = go.Figure(go.Bar(x=(edges[1:] + edges[:-1]) / 2, y=count, marker={"color": BLUE}))
    return _laid_out(figure, name, "runs"), f'{{}}.values["{name}"], over all runs.'


def _loss_tolerance(found: Any) -> Picture:
    rates = np.linspace(0.0, 1.0, 101)[1:]
    at = [found.at(rate) for rate in rates]
    figure = go.Figure()
    for name, colour in (("lower", GREEN), ("upper", ORANGE)):
        total = np.array([np.trace(getattr(one, name)) for one in at])
        total[~np.isfinite(total)] = np.nan
        figure.add_scatter(x=rates, y=total, mode="lines", name=f"{name} bound", line={"color": colour, "width": 2})
    _laid_out(figure, "probability that a sample arrives", "trace of the expected covariance")
    figure.update_yaxes(type="log")
    return figure, "Bounds of the expected covariance, from {}.at(rate); a curve ends where that bound does not exist."


def _gain_information(found: Any) -> Picture:
    top = float(found.amplitude_for(0.05))
    amplitudes = np.linspace(0.05 * top, 2 * top, 60)
    sigma = np.array([found.at(amplitude).sigma for amplitude in amplitudes])
    figure = go.Figure()
    for i, name in enumerate(found.gains):
        line = {"color": COLOURS[i % len(COLOURS)], "width": 2}
        figure.add_scatter(x=amplitudes, y=sigma[:, i], mode="lines", name=name, line=line)
    _laid_out(figure, "amplitude of the dither", "smallest sigma of a gain")
    return figure, "{}.at(amplitude).sigma: how well each gain can be known."


def _bars(labels: Any, values: Any, across: str, up: str, caption: str) -> Picture:
    figure = go.Figure(go.Bar(x=list(labels), y=np.asarray(values, float), marker={"color": BLUE}))
    return _laid_out(figure, across, up), caption


def _structure(found: Any) -> Picture:
    order = [str(i) for i in range(1, len(found.singular_values) + 1)]
    caption = "{}.singular_values: one that is zero hides a direction."
    return _bars(order, found.singular_values, "singular value", "", caption)


def _regulability(found: Any) -> Picture:
    caption = "{}.variance_reduction: by how much of itself control lowers the cost of each state."
    return _bars(found.states, found.variance_reduction, "state", "", caption)


def _poles(found: Any) -> Picture:
    turn, figure, thin = np.linspace(0, 2 * np.pi, 181), go.Figure(), {"color": GREY, "width": 1}
    figure.add_scatter(x=np.cos(turn), y=np.sin(turn), mode="lines", line=thin, name="unit circle")
    poles = np.asarray(found.poles)
    mark = {"color": BLUE, "size": 11, "symbol": "x"}
    figure.add_scatter(x=np.real(poles), y=np.imag(poles), mode="markers", marker=mark, name="poles")
    _laid_out(figure, "real part", "imaginary part", 420)
    figure.update_yaxes(scaleanchor="x")
    return figure, "{}.poles, inside the unit circle."


def _trans_kalman(design: Any) -> Picture:
    table, figure = design.to_pandas().drop(columns="worst"), go.Figure()
    for i, (name, row) in enumerate(table.iterrows()):
        corners = [f"noises of corner {corner}" for corner in table.columns]
        colour = {"color": (GREEN, BLUE, ORANGE)[i % 3]}
        figure.add_bar(x=corners, y=row.to_numpy(float), name=str(name), marker=colour)
    _laid_out(figure, "", "cost over that of the filter that knows")
    figure.update_yaxes(type="log")
    return figure, "{}.to_pandas(): what each gain costs at each corner, relative to the filter that knows the noises."


def _perturbed(bound: Any) -> Picture:
    t, figure = np.arange(200) * (bound.dt or 0.1), go.Figure()
    for i, x0 in enumerate((0.5, 1.0, 2.0)):
        line = {"color": COLOURS[i], "width": 2}
        figure.add_scatter(x=t, y=bound.at(t, x0=x0), mode="lines", name=f"from a start of norm {x0:g}", line=line)
    _laid_out(figure, "time (s)", "bound on the norm of the state")
    return figure, "{}.at(t, x0=...): how far the state can go."


OF: dict[str, Callable[[Any], Picture]] = {  # by the class of the record
    "Fit": _fit,
    "ClosedLoop": _closed_loop,
    "MonteCarlo": _monte_carlo,
    "LossTolerance": _loss_tolerance,
    "GainInformation": _gain_information,
    "Observability": _structure,
    "Regulability": _regulability,
    "KalmanGain": _poles,
    "TransKalman": _trans_kalman,
    "Perturbed": _perturbed,
}
