"""A plotly figure as a small drawing: the curves of one panel, without axes."""

import re
from typing import Any, NamedTuple

import numpy as np

WIDTH, HEIGHT, EDGE, MOST = 320, 150, 8, 240
PREFERRED = ("#D55E00", "#009E73")  # gains, unknown inputs: what a panel of them shows is what the method is about
DASHES = {"dash": "5 4", "dot": "2 3", "dashdot": "6 3 2 3", "longdash": "8 4"}


class Curve(NamedTuple):
    """One trace: its points, and how they are drawn."""

    x: np.ndarray
    y: np.ndarray
    trace: Any


class Frame(NamedTuple):
    """The rectangle of numbers that is drawn."""

    left: float
    right: float
    low: float
    high: float

    def place(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Numbers as pixels."""
        across = (x - self.left) / ((self.right - self.left) or 1.0)
        up = (np.clip(y, self.low, self.high) - self.low) / ((self.high - self.low) or 1.0)
        return EDGE + across * (WIDTH - 2 * EDGE), HEIGHT - EDGE - up * (HEIGHT - 2 * EDGE)


def svg(figure: Any) -> str:
    """The drawing, as one line of SVG."""
    traces = [trace for trace in figure.data if trace.y is not None and len(trace.y)]
    panel = _panel(traces)
    curves = [_curve(trace, figure, panel) for trace in traces if (trace.xaxis or "x", trace.yaxis or "y") == panel]
    frame = _frame(curves, figure, panel)
    drawn = [_drawing(curve, curves[i - 1] if i else None, frame) for i, curve in enumerate(curves)]
    return (
        f'<svg class="thumbnail" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-hidden="true">'
        + "".join(drawn)
        + "</svg>"
    )


def _panel(traces: list[Any]) -> tuple[str, str]:
    for trace in traces:
        if trace.type == "scatter" and trace.line.color in PREFERRED:
            return trace.xaxis or "x", trace.yaxis or "y"
    return traces[0].xaxis or "x", traces[0].yaxis or "y"


def _axis(figure: Any, name: str) -> Any:
    return figure.layout[re.sub(r"^([xy])", r"\1axis", name)]


def _curve(trace: Any, figure: Any, panel: tuple[str, str]) -> Curve:
    y = np.asarray(trace.y, float)
    x = np.arange(len(y), dtype=float)
    if trace.x is not None and not isinstance(trace.x[0], str):
        x = np.asarray(trace.x, float)
    every = slice(None, None, max(1, -(-len(y) // MOST)))
    x, y = x[every], y[every]
    with np.errstate(all="ignore"):
        if _axis(figure, panel[0]).type == "log":
            x = np.log10(x)
        if _axis(figure, panel[1]).type == "log":
            y = np.log10(y)
    return Curve(x, y, trace)


def _frame(curves: list[Curve], figure: Any, panel: tuple[str, str]) -> Frame:
    x, y = (np.concatenate([getattr(curve, name) for curve in curves]) for name in ("x", "y"))
    x, y = x[np.isfinite(x)], y[np.isfinite(y)]
    low, high = _axis(figure, panel[1]).range or (y.min(), y.max())
    bars = any(curve.trace.type == "bar" for curve in curves)
    room = 0.5 if bars else 0.0
    return Frame(x.min() - room, x.max() + room, min(low, 0.0) if bars else low, high)


def _drawing(curve: Curve, before: Curve | None, frame: Frame) -> str:
    trace = curve.trace
    if trace.type == "bar":
        return _bars(curve, frame)
    x, y = frame.place(curve.x, curve.y)
    parts = []
    if trace.fill == "tonexty" and before is not None:
        parts.append(_filled(frame.place(before.x, before.y), (x, y), trace.fillcolor))
    colour = trace.line.color or trace.marker.color or "#0072B2"
    if "lines" in (trace.mode or "lines") and trace.line.width != 0:
        dash = DASHES.get(trace.line.dash or "")
        dashed = f' stroke-dasharray="{dash}"' if dash else ""
        path = _path(x, y)
        parts.append(f'<path d="{path}" fill="none" stroke="{colour}" stroke-width="1.6"{dashed}/>')
    if "markers" in (trace.mode or ""):
        parts += [f'<circle cx="{a:.1f}" cy="{b:.1f}" r="2.5" fill="{colour}"/>' for a, b in _finite(x, y)]
    return "".join(parts)


def _bars(curve: Curve, frame: Frame) -> str:
    colour = curve.trace.marker.color or "#0072B2"
    x, y = frame.place(curve.x, curve.y)
    _, floor = frame.place(curve.x, np.zeros_like(curve.y))
    wide = 0.7 * (WIDTH - 2 * EDGE) / (frame.right - frame.left) * (np.diff(curve.x).min() if len(curve.x) > 1 else 1.0)
    return "".join(
        f'<rect x="{a - wide / 2:.1f}" y="{min(b, c):.1f}" width="{wide:.1f}" height="{abs(c - b):.1f}" fill="{colour}"/>'
        for a, b, c in zip(x, y, floor, strict=True)
    )


def _filled(one: tuple[np.ndarray, np.ndarray], other: tuple[np.ndarray, np.ndarray], colour: str) -> str:
    edge = [*_finite(*one), *reversed(_finite(*other))]
    points = " ".join(f"{a:.1f},{b:.1f}" for a, b in edge)
    return f'<polygon points="{points}" fill="{colour}"/>'


def _finite(x: np.ndarray, y: np.ndarray) -> list[tuple[float, float]]:
    known = np.isfinite(x) & np.isfinite(y)
    return list(zip(x[known].tolist(), y[known].tolist(), strict=True))


def _path(x: np.ndarray, y: np.ndarray) -> str:
    """The points joined, with a gap where one is not known."""
    steps, pen = [], "M"
    for a, b in zip(x, y, strict=True):
        known = bool(np.isfinite(a) and np.isfinite(b))
        steps += [f"{pen}{a:.1f} {b:.1f}"] if known else []
        pen = "L" if known else "M"
    return "".join(steps)
