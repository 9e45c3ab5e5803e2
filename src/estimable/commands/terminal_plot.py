"""A curve and its band, drawn with characters."""

from typing import NamedTuple

import numpy as np

from ..figures.bands import value_range

BRAILLE = 0x2800
DOTS = ((0x01, 0x02, 0x04, 0x40), (0x08, 0x10, 0x20, 0x80))  # bits of a braille character, by column and then by row
ENOUGH = 0.35  # fraction of a cell that the band must fill to be drawn there
STEPS = (1.0, 2.0, 5.0, 10.0)  # distances between labels, in powers of ten


class Ink(NamedTuple):
    """The characters of a plot."""

    band: str
    side: str
    tick: str
    corner: str
    floor: str
    mark: str
    dotted: bool


UNICODE = Ink("░", "│", "┤", "└", "─", "┬", True)
ASCII = Ink(":", "|", "+", "+", "-", "+", False)


class Frame(NamedTuple):
    """The cells of a plot, and the times and values at its edges."""

    width: int
    height: int
    left: float
    right: float
    bottom: float
    top: float


def plot(
    t: np.ndarray,
    middle: np.ndarray,
    sigma: np.ndarray,
    *,
    width: int,
    height: int = 12,
    marks: dict[str, tuple[float, float]] | None = None,
    ink: Ink = UNICODE,
) -> list[str]:
    """Lines of text, at most `width` long: the curve, its ± 2 sigma band, values at the left, seconds below.

    `marks` names spans of time, which are shown under the axis. Where sigma is infinite only the band is drawn.
    """
    lower, upper = middle - 2 * sigma, middle + 2 * sigma
    bottom, top = value_range(middle, lower, upper)
    labels = ticks(bottom, top, max(2, height // 3))
    margin = max(len(label) for label in labels.values()) + 1
    left, right = (float(t[0]), float(t[-1])) if len(t) > 1 else (float(t[0]) - 0.5, float(t[0]) + 0.5)
    frame = Frame(max(width - margin - 2, 10), height, left, right, bottom, top)
    cells = _band(frame, t, np.clip(lower, bottom, top), np.clip(upper, bottom, top), ink)
    _curve(cells, frame, t, np.where(np.isfinite(sigma), middle, np.nan), ink)
    rows = {_row(frame, value): label for value, label in labels.items()}
    sides = [f"{rows.get(i, ''):>{margin}}{ink.tick if i in rows else ink.side}" for i in range(height)]
    lines = [(side + "".join(row)).rstrip() for side, row in zip(sides, cells, strict=True)]
    return [*lines, *_time_axis(frame, margin, ink), *_spans(frame, margin, marks or {}, ink)]


def ticks(low: float, high: float, count: int) -> dict[float, str]:
    """About `count` round values between two, each with its label.

    >>> list(ticks(0.0, 12.0, 6).values())
    ['0', '2', '4', '6', '8', '10', '12']
    """
    raw = (high - low) / count
    power = 10.0 ** np.floor(np.log10(raw))
    step = power * next(s for s in STEPS if s * power >= raw * (1 - 1e-9))
    digits = max(0, -int(np.floor(np.log10(step) + 1e-9)))
    first, last = int(np.ceil(low / step - 1e-9)), int(np.floor(high / step + 1e-9))
    return {i * step: f"{i * step + 0.0:.{digits}f}" for i in range(first, last + 1)}


def _row(frame: Frame, value: float) -> int:
    share = (frame.top - value) / (frame.top - frame.bottom)
    return min(max(int(share * frame.height), 0), frame.height - 1)


def _column(frame: Frame, time: float) -> int:
    share = (time - frame.left) / (frame.right - frame.left)
    return min(max(int(share * frame.width), 0), frame.width - 1)


def _band(frame: Frame, t: np.ndarray, lower: np.ndarray, upper: np.ndarray, ink: Ink) -> list[list[str]]:
    """The cells, with the band drawn in those that it fills to `ENOUGH`."""
    times = frame.left + (np.arange(frame.width) + 0.5) / frame.width * (frame.right - frame.left)
    cell = (frame.top - frame.bottom) / frame.height
    ceiling = (frame.top - np.arange(frame.height) * cell)[:, None]
    filled = np.minimum(ceiling, np.interp(times, t, upper)) - np.maximum(ceiling - cell, np.interp(times, t, lower))
    return [[ink.band if share >= ENOUGH else " " for share in row] for row in filled / cell]


def _curve(cells: list[list[str]], frame: Frame, t: np.ndarray, middle: np.ndarray, ink: Ink) -> None:
    """Draw the curve over the band, with two by four dots in each cell if the characters allow it."""
    across, down = (2, 4) if ink.dotted else (1, 1)
    times = frame.left + (np.arange(frame.width * across) + 0.5) / (frame.width * across) * (frame.right - frame.left)
    share = (frame.top - np.interp(times, t, middle)) / (frame.top - frame.bottom)
    dots: dict[tuple[int, int], int] = {}
    before = None
    for x, value in enumerate(share):
        y = None if not 0 <= value <= 1 else min(int(value * frame.height * down), frame.height * down - 1)
        for dot in () if y is None else _stroke(before, y):
            cell = (dot // down, x // across)
            dots[cell] = dots.get(cell, 0) | DOTS[x % across][dot % down]
        before = y
    for (row, column), pattern in dots.items():
        cells[row][column] = chr(BRAILLE | pattern) if ink.dotted else "*"


def _stroke(before: int | None, y: int) -> range:
    """The dots of one column: from next to the last one up to this one."""
    if before is None or abs(before - y) <= 1:
        return range(y, y + 1)
    return range(y, before) if y < before else range(before + 1, y + 1)


def _time_axis(frame: Frame, margin: int, ink: Ink) -> list[str]:
    """The axis, and the time under it; the unit "s" is below the values."""
    labels = ticks(frame.left, frame.right, max(2, min(8, frame.width // 8)))
    line, words = [ink.floor] * frame.width, list(f"{'s':>{margin}} {'':{frame.width}}")
    for value, label in labels.items():
        column = _column(frame, value)
        line[column] = ink.mark
        start = min(margin + 1 + max(column - len(label) // 2, 0), len(words) - len(label))
        words[start : start + len(label)] = label
    return [" " * margin + ink.corner + "".join(line), "".join(words).rstrip()]


def _spans(frame: Frame, margin: int, marks: dict[str, tuple[float, float]], ink: Ink) -> list[str]:
    """One line with the named spans of time; a name without room is left out."""
    line = [" "] * frame.width
    for name, (start, end) in marks.items():
        first, last = _column(frame, start), _column(frame, end)
        span = f"{name:{ink.floor}^{last - first + 1}}"
        free = set(line[first : last + 1]) == {" "}
        if free and len(span) <= last - first + 1 and len(span) >= len(name) + 2:
            line[first : last + 1] = ["|", *span[1:-1], "|"]
    return [(" " * (margin + 1) + "".join(line)).rstrip()] if set(line) != {" "} else []
