"""The diagrams of gains: several in one, and the smallest loss of each that would have been detected over time."""

from collections.abc import Sequence
from itertools import product

import numpy as np

from ..figures.bands import Band, cropped
from ..results import DetectableLoss
from ..results.detectable import size_of
from ..results.gain_row import label_of
from .contents import Chart, Key, Table
from .curves import MARK, Moment, band_of, line_of, marked, packed

COLOURS = ("#B34700", "#0063A0", "#00704F", "#A63A82")
DRAWN = ("solid", "dash")  # of the first four gains, and of four more
MOST_TOGETHER = len(COLOURS) * len(DRAWN)
OPACITY = 0.12  # of the band of one of several gains
PART = "What would have been detected"


def together(gains: Sequence[Band], changes: Sequence[Moment], unit: str) -> Chart:
    """All gains in one diagram, each with its band, and the onset and detection of every change."""
    traces, keys = [], []
    for i, gain in enumerate(gains):
        colour, drawn = _style(i)
        sigma = np.where(np.isfinite(gain.sigma), gain.sigma, np.nan) if gain.sigma is not None else None
        middle = gain.middle if sigma is None else np.where(np.isnan(sigma), np.nan, gain.middle)
        if sigma is not None:
            traces += band_of(middle, sigma, colour, OPACITY)
        traces.append(line_of(middle, sigma, label_of(gain.name), colour, drawn))
        keys.append(Key(label_of(gain.name), colour, drawn))
    ranges = [limits for gain in gains if (limits := cropped(gain)) is not None]
    within = (min(low for low, _ in ranges), max(high for _, high in ranges)) if len(ranges) == len(gains) else None
    keys += [Key(f"change of {label_of(one.gain)} at {one.onset:.4g}{unit}", MARK, "line") for one in changes]
    layout = {"yaxis": {"title": {"text": ""}, "range": within}, **marked(changes)}
    return Chart("Gains ± 2 sigma", tuple(keys), tuple(traces), layout)


def detectable_chart(loss: DetectableLoss) -> Chart:
    """The smallest loss of each gain that begins with an interval and would have been detected before its end."""
    ends = np.array([(one.start, one.end) for one in loss.intervals]).ravel()
    several, levels = len(loss.gains) > 1, [f"{100 * power:.0f} %" for power in loss.power]
    drawn_levels = range(len(levels) - 1 if several else 0, len(levels))
    traces, keys = [], []
    for i, (gain, level) in enumerate(product(range(len(loss.gains)), drawn_levels)):
        colour, drawn = _style(i)
        name = label_of(loss.gains[gain]) if several else f"detected with probability {levels[level]}"
        size = np.array([one.loss[gain, level] for one in loss.intervals])
        size = np.repeat(np.where(np.isfinite(size), size, np.nan), 2)
        traces.append({
            "x": packed(ends), "y": packed(size), "mode": "lines", "name": name,
            "line": {"color": colour, "width": 2, "dash": drawn}, "hovertemplate": "%{y:.2g}",
        })  # fmt: skip
        keys.append(Key(name, colour, drawn))
    caption = (
        f"A loss that begins with the interval and raises an alarm before its end, with probability {levels[-1]}. A gap: the "
        "input of the interval shows no loss, however large."
    )
    layout = {"yaxis": {"title": {"text": "loss, in units of the gain"}, "type": "log"}}
    return Chart("Smallest detectable loss", tuple(keys), tuple(traces), layout, caption, PART, _table(loss, levels))


def _table(loss: DetectableLoss, levels: list[str]) -> Table:
    """A row for each interval, a column for each gain and probability."""
    names = [level if len(loss.gains) == 1 else f"{label_of(gain)}, {level}" for gain in loss.gains for level in levels]
    rows = tuple(
        (f"{one.start:.4g} to {one.end:.4g} s", *map(size_of, one.loss.ravel()))
        for one in loss.intervals
    )  # fmt: skip
    return Table("As a table", ("interval", *names), rows)


def _style(i: int) -> tuple[str, str]:
    return COLOURS[i % len(COLOURS)], DRAWN[i // len(COLOURS) % len(DRAWN)]
