"""The diagrams of an estimate: gains, states with their measurements, innovations."""

import base64
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..figures.bands import Band, bands, cropped
from ..results import Estimate, SmoothedEstimate
from ..tables import standard_deviation
from .contents import Chart, Key

GAIN, STATE, MEASURED, INNOVATION, BOUND, MARK = "#B34700", "#0063A0", "#6B6B6B", "#444444", "#A63A82", "#1A1A1A"
SMOOTHED = "#2F7D32"
SHADE = "rgba(26,26,26,0.12)"
STILL = "rgba(107,107,107,0.18)"  # of an interval without information
FILL = 0.22  # opacity of a band
MOST_POINTS = 6000  # most points drawn of a curve; of a longer record every k-th row is drawn
MOST_CHARTS = 24
MOST_MARKS = 4  # most changes whose times are in the legend
MOST_DOTS = 1500  # most rows for which measurements are drawn as separate dots


class Moment(NamedTuple):
    """A change of a gain: its name, its onset and its detection, in units of the time axis."""

    gain: str
    onset: float
    seen: float


def thinned(rows: int) -> slice:
    """The rows that are drawn."""
    return slice(None, None, max(1, -(-rows // MOST_POINTS)))


def packed(values: np.ndarray) -> dict[str, str]:
    """Numbers in the binary form of plotly.js, half the size of a list.

    >>> packed([1.0])
    {'dtype': 'f4', 'bdata': 'AACAPw=='}
    """
    return {"dtype": "f4", "bdata": base64.b64encode(np.asarray(values, "<f4").tobytes()).decode()}


class MeasuredState(NamedTuple):
    """The measurements of a state: the output's name, its unit or "", and its values (T,)."""

    output: str
    unit: str
    values: np.ndarray


def charts_of(
    result: Estimate,
    measured: dict[str, MeasuredState],
    changes: Sequence[Moment],
    quiet: Mapping[str, tuple[float, float]] | None = None,
    outputs: Mapping[str, MeasuredState] | None = None,
    smoothed: SmoothedEstimate | None = None,
) -> list[Chart]:
    """The gains, then the outputs with their measurements, the states, unknown inputs, and the innovations.

    `quiet`: of a gain, the interval in which the input carries no information about it. `outputs`: the measurements of the
    outputs; None: no output is drawn, and `measured` are those of states. `smoothed`: a second curve.
    """
    drawn = [*bands(result), *(output_bands(result) if outputs is not None else [])]
    rows = thinned(len(drawn[0].middle))
    panels: list[Chart] = []
    unit = "" if result.t is None else " s"
    units = {result.names.labelled(name): unit for name, unit in result.names.units}
    order = {"gain": 0, "output": 1, "state": 2, "unknown_input": 3, "innovation": 4}
    later = {} if smoothed is None else {(b.kind, b.name): b for b in (*bands(smoothed), *output_bands(smoothed))}
    for band in sorted(drawn, key=lambda band: order[band.kind])[:MOST_CHARTS]:
        thin = band._replace(middle=band.middle[rows], sigma=None if band.sigma is None else band.sigma[rows])
        if band.kind == "innovation":
            panels.append(_innovation(thin, cropped(band), units.get(band.name, "")))
        elif band.kind == "gain":
            marks = [change for change in changes if change.gain == band.name]
            still = (quiet or {}).get(band.name)
            panels.append(_shaded(_estimate(thin, GAIN, cropped(band), None, marks, unit), still))
        else:
            output = (outputs or {}).get(band.name) if band.kind == "output" else measured.get(band.name)
            seen = None if output is None else output._replace(values=output.values[rows])
            panels.append(_estimate(thin, STATE, cropped(band), seen, (), unit))
        if (after := later.get((band.kind, band.name))) is not None:
            panels[-1] = _with_smoothed(panels[-1], after._replace(middle=after.middle[rows]), rows)
    return panels


def output_bands(result: Estimate | SmoothedEstimate) -> list[Band]:
    """What the estimated states say that each sensor should show, without its noise."""
    outputs, names = result.outputs(), result.names
    if outputs.mean is None:
        return []
    sigma = None if outputs.covariance is None else standard_deviation(outputs.covariance)
    return [
        Band(names.labelled(name), "output", outputs.mean[:, i], None if sigma is None else sigma[:, i])
        for i, name in enumerate(names.outputs)
    ]


def _with_smoothed(chart: Chart, band: Band, rows: slice) -> Chart:
    """The chart with the smoothed curve."""
    sigma = None if band.sigma is None else np.where(np.isfinite(band.sigma[rows]), band.sigma[rows], np.nan)
    line = _line(band.middle, sigma, "smoothed", SMOOTHED)
    return chart._replace(keys=(*chart.keys, Key("smoothed", SMOOTHED, "line")), traces=(*chart.traces, line))


def _estimate(
    band: Band,
    colour: str,
    within: tuple[float, float] | None,
    output: MeasuredState | None,
    marks: Sequence[Moment],
    unit: str,
) -> Chart:
    """A quantity with its band, its measurements and its changes."""
    sigma = None if band.sigma is None else np.where(np.isfinite(band.sigma), band.sigma, np.nan)
    middle = band.middle if sigma is None else np.where(np.isnan(sigma), np.nan, band.middle)
    traces, keys = [], [Key("estimate", colour, "line")]
    if sigma is not None:
        traces += _band(middle, sigma, colour)
        keys.append(Key("± 2 sigma", colour, "band"))
    if output is not None:
        traces.append(_dots(output.values, output.output))
        keys.append(Key(f"measured {output.output}", MEASURED, "dots" if _is_sparse(output.values) else "line"))
    traces.append(_line(middle, sigma, band.name, colour))
    keys += _mark_keys(marks, unit)
    measured = "" if output is None else output.unit
    label = f"{band.name} [{measured}]" if measured and band.kind == "state" else band.name
    layout = {"yaxis": {"title": {"text": measured}, "range": within}, **_marked(marks)}
    heading = "Gain" if band.name == "gain" else f"{band.kind.replace('_', ' ').capitalize()} {label}"
    return Chart(heading, tuple(keys), tuple(traces), layout)


def _shaded(chart: Chart, interval: tuple[float, float] | None) -> Chart:
    """The chart with an interval without information shaded."""
    if interval is None:
        return chart
    start, end = interval
    box = {
        "type": "rect",
        "x0": start,
        "x1": end,
        "yref": "paper",
        "y0": 0,
        "y1": 1,
        "fillcolor": STILL,
        "line": {"width": 0},
    }
    layout = {**chart.layout, "shapes": [box, *chart.layout.get("shapes", [])]}
    return chart._replace(keys=(*chart.keys, Key("no information from the input", MEASURED, "band")), layout=layout)


def _innovation(band: Band, within: tuple[float, float] | None, unit: str) -> Chart:
    """Innovations and their bounds."""
    line = {"width": 1.0, "color": INNOVATION}
    traces = [
        {"y": packed(band.middle), "mode": "lines", "line": line, "name": "innovation", "hovertemplate": "%{y:.3g}"}
    ]
    keys = [Key("innovation", INNOVATION, "line")]
    if band.sigma is not None:
        bound = {"mode": "lines", "line": {"color": BOUND, "width": 1.8, "dash": "dash"}, "hoverinfo": "skip"}
        sigma = np.where(np.isfinite(band.sigma), band.sigma, np.nan)
        traces += [{"y": packed(side * 2 * sigma), **bound} for side in (1, -1)]
        keys.append(Key("± 2 sigma: 95 % inside", BOUND, "dash"))
    layout = {"yaxis": {"title": {"text": unit}, "range": within}}
    return Chart(f"Innovation of {band.name}", tuple(keys), tuple(traces), layout)


def _line(middle: np.ndarray, sigma: np.ndarray | None, name: str, colour: str) -> dict[str, Any]:
    line = {"y": packed(middle), "mode": "lines", "line": {"color": colour, "width": 2}, "name": name}
    if sigma is None:
        return {**line, "hovertemplate": "%{y:.4g}"}
    return {**line, "customdata": packed(2 * sigma), "hovertemplate": "%{y:.4g} ± %{customdata:.2g}"}


def _band(middle: np.ndarray, sigma: np.ndarray, colour: str) -> list[dict[str, Any]]:
    bare = {"mode": "lines", "line": {"width": 0}, "hoverinfo": "skip"}
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    fill = {"fill": "tonexty", "fillcolor": f"rgba({red},{green},{blue},{FILL})"}
    return [{"y": packed(middle - 2 * sigma), **bare}, {"y": packed(middle + 2 * sigma), **bare, **fill}]


def _dots(values: np.ndarray, name: str) -> dict[str, Any]:
    """Measurements: dots, or a thin line if there are too many to distinguish."""
    if _is_sparse(values):
        how = {"mode": "markers", "marker": {"color": MEASURED, "size": 4, "opacity": 0.6}}
    else:
        how = {"mode": "lines", "line": {"color": MEASURED, "width": 1}}
    return {"y": packed(values), "name": name, "hovertemplate": "%{y:.4g} measured", **how}


def _is_sparse(values: np.ndarray) -> bool:
    return len(values) <= MOST_DOTS


def _mark_keys(marks: Sequence[Moment], unit: str) -> list[Key]:
    """The onset and the detection of each change."""
    if len(marks) > MOST_MARKS:
        return [Key(f"{len(marks)} changes", MARK, "line"), Key("their detection", MARK, "dash")]
    return [
        key
        for mark in marks
        for key in (
            Key(f"change at {mark.onset:.4g}{unit}", MARK, "line"), Key(f"detected at {mark.seen:.4g}{unit}", MARK, "dash"),
        )
    ]  # fmt: skip


def _marked(marks: Sequence[Moment]) -> dict[str, Any]:
    """A solid line at the onset of each change, a dashed one at its detection, and the interval between them shaded."""
    shapes = []
    for mark in marks:
        across = {"yref": "paper", "y0": 0, "y1": 1}
        edge = {"type": "line", **across}
        line = {"color": MARK, "width": 1.8}
        shapes += [
            {"type": "rect", "x0": mark.onset, "x1": mark.seen, "fillcolor": SHADE, "line": {"width": 0}, **across},
            {"x0": mark.onset, "x1": mark.onset, "line": line, **edge},
            {"x0": mark.seen, "x1": mark.seen, "line": {**line, "dash": "dash"}, **edge},
        ]  # fmt: skip
    return {"shapes": shapes}
