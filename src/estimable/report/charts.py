"""The diagrams of an estimate: gains, states with their measurements, innovations."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..figures.bands import Band, bands, cropped
from ..results import DetectableLoss, Estimate, SmoothedEstimate
from ..tables import standard_deviation
from . import gain_charts
from .contents import Chart, Key
from .curves import MARK, Moment, band_of, line_of, marked, packed

GAIN, STATE, MEASURED, INNOVATION, BOUND = "#B34700", "#0063A0", "#6B6B6B", "#444444", "#A63A82"
SMOOTHED = "#2F7D32"
STILL = "#2E6FB7"  # of an interval without information
MOST_POINTS = 6000  # most points drawn of a curve; of a longer record every k-th row is drawn
MOST_CHARTS = 24
KINDS = ("gain", "output", "state", "unknown_input", "innovation")  # in the order of the diagrams
MOST_MARKS = 4  # most changes whose times are in the legend
MOST_DOTS = 1500  # most rows for which measurements are drawn as separate dots


def thinned(rows: int) -> slice:
    """The rows that are drawn."""
    return slice(None, None, max(1, -(-rows // MOST_POINTS)))


class MeasuredState(NamedTuple):
    """The measurements of a state: the output's name, its unit or "", and its values (T,)."""

    output: str
    unit: str
    values: np.ndarray


def charts_of(
    result: Estimate,
    measured: dict[str, MeasuredState],
    changes: Sequence[Moment],
    outputs: Mapping[str, MeasuredState] | None = None,
    smoothed: SmoothedEstimate | None = None,
    *,
    detectable: DetectableLoss | None = None,
    together: bool = False,
) -> list[Chart]:
    """The gains, then the outputs with their measurements, the states, unknown inputs, and the innovations.

    `outputs`: the measurements of the outputs; None: no output is drawn, and `measured` are those of states. `smoothed`: a
    second curve. `detectable`: the smallest loss that would have been detected, in a separate diagram; where the input carries
    no information about a gain, its diagram is shaded. `together`: the gains are in one diagram.
    """
    drawn = [*bands(result), *(output_bands(result) if outputs is not None else [])]
    rows = thinned(len(drawn[0].middle))
    unit = "" if result.t is None else " s"
    units = {result.names.labelled(name): unit for name, unit in result.names.units}
    smooth = [] if smoothed is None else [*bands(smoothed), *output_bands(smoothed)]
    later = {(band.kind, band.name): _of_rows(band, rows) for band in smooth}
    drawn = [_of_rows(band, rows) for band in in_order(drawn)]
    quiet = {} if detectable is None else detectable.quiet
    gains = [band for band in drawn if band.kind == "gain"]
    panels: list[Chart] = []
    if together and 1 < len(gains) <= gain_charts.MOST_TOGETHER:
        drawn = drawn[len(gains) :]
        common = max(quiet.values()) if len(quiet) == len(gains) else None  # where no gain is informed
        panels.append(_shaded(gain_charts.together(gains, changes, unit), common))
    for band in drawn[:MOST_CHARTS]:
        if band.kind == "innovation":
            panels.append(_innovation(band, cropped(band), units.get(band.name, "")))
        elif band.kind == "gain":
            marks = [change for change in changes if change.gain == band.name]
            panels.append(_shaded(_estimate(band, GAIN, cropped(band), None, marks, unit), quiet.get(band.name)))
        else:
            output = (outputs or {}).get(band.name) if band.kind == "output" else measured.get(band.name)
            seen = None if output is None else output._replace(values=output.values[rows])
            panels.append(_estimate(band, STATE, cropped(band), seen, (), unit))
        if (after := later.get((band.kind, band.name))) is not None:
            panels[-1] = _with_smoothed(panels[-1], after)
    if detectable is not None and detectable.intervals:
        panels.append(gain_charts.detectable_chart(detectable))
    return panels


def output_bands(result: Estimate | SmoothedEstimate) -> list[Band]:
    """The outputs that the estimated states imply, without the noise of the sensors."""
    outputs, names = result.outputs(), result.names
    if outputs.mean is None:
        return []
    sigma = None if outputs.covariance is None else standard_deviation(outputs.covariance)
    return [
        Band(names.labelled(name), "output", outputs.mean[:, i], None if sigma is None else sigma[:, i])
        for i, name in enumerate(names.outputs)
    ]


def in_order(found: Sequence[Band]) -> list[Band]:
    """Gains, outputs, states, unknown inputs, innovations."""
    return sorted(found, key=lambda band: KINDS.index(band.kind))


def kind_of(band: Band) -> str:
    """The kind of a quantity, as the first words of a heading."""
    return band.kind.replace("_", " ").capitalize()


def _of_rows(band: Band, rows: slice) -> Band:
    """The rows of a band that are drawn."""
    return band._replace(middle=band.middle[rows], sigma=None if band.sigma is None else band.sigma[rows])


def _with_smoothed(chart: Chart, band: Band) -> Chart:
    """The chart with the smoothed curve."""
    sigma = None if band.sigma is None else np.where(np.isfinite(band.sigma), band.sigma, np.nan)
    line = line_of(band.middle, sigma, "smoothed", SMOOTHED)
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
        traces += band_of(middle, sigma, colour)
        keys.append(Key("± 2 sigma", colour, "band"))
    if output is not None:
        traces.append(_dots(output.values, output.output))
        keys.append(Key(f"measured {output.output}", MEASURED, "dots" if _is_sparse(output.values) else "line"))
    traces.append(line_of(middle, sigma, band.name, colour))
    keys += _mark_keys(marks, unit)
    measured = "" if output is None else output.unit
    label = f"{band.name} [{measured}]" if measured and band.kind == "state" else band.name
    layout = {"yaxis": {"title": {"text": measured}, "range": within}, **marked(marks)}
    heading = "Gain" if band.name == "gain" else f"{kind_of(band)} {label}"
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
        "opacity": 0.15,
        "line": {"width": 0},
    }
    layout = {**chart.layout, "shapes": [box, *chart.layout.get("shapes", [])]}
    return chart._replace(keys=(*chart.keys, Key("no information from the input", STILL, "band")), layout=layout)


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
