"""The parts of a diagram: curves, bands and marks for plotly.js."""

import base64
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

MARK = "#1A1A1A"
SHADE = "rgba(26,26,26,0.12)"
FILL = 0.22  # opacity of a band


class Moment(NamedTuple):
    """A change of a gain: its name, its onset and its detection, in units of the time axis."""

    gain: str
    onset: float
    seen: float


def packed(values: np.ndarray) -> dict[str, str]:
    """Numbers in the binary form of plotly.js, half the size of a list.

    >>> packed([1.0])
    {'dtype': 'f4', 'bdata': 'AACAPw=='}
    """
    return {"dtype": "f4", "bdata": base64.b64encode(np.asarray(values, "<f4").tobytes()).decode()}


def line_of(
    middle: np.ndarray, sigma: np.ndarray | None, name: str, colour: str, drawn: str = "solid"
) -> dict[str, Any]:
    """A curve whose value, with 2 sigma, appears where the reader points."""
    how = {"color": colour, "width": 2} if drawn == "solid" else {"color": colour, "width": 2, "dash": drawn}
    line = {"y": packed(middle), "mode": "lines", "line": how, "name": name}
    if sigma is None:
        return {**line, "hovertemplate": "%{y:.4g}"}
    return {**line, "customdata": packed(2 * sigma), "hovertemplate": "%{y:.4g} ± %{customdata:.2g}"}


def band_of(middle: np.ndarray, sigma: np.ndarray, colour: str, opacity: float = FILL) -> list[dict[str, Any]]:
    """The area within 2 sigma of a curve."""
    bare = {"mode": "lines", "line": {"width": 0}, "hoverinfo": "skip"}
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    fill = {"fill": "tonexty", "fillcolor": f"rgba({red},{green},{blue},{opacity})"}
    return [{"y": packed(middle - 2 * sigma), **bare}, {"y": packed(middle + 2 * sigma), **bare, **fill}]


def marked(marks: Sequence[Moment]) -> dict[str, Any]:
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
