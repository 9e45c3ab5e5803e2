"""Write docs/gain.svg: the gain of the packaged flight, as `estimable demo` estimates it."""

from pathlib import Path

import numpy as np

import estimable as es

FILE = Path(__file__).parents[2] / "docs" / "gain.svg"
WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 760, 300, 56, 16, 16, 44
TRUE = ((0.0, 1.0), (4.5, 1.0), (4.5, 0.5), (12.0, 0.5))  # time [s], gain
LIMIT = 1.6  # the top of the axis


def estimated():
    """Time [s], gain and its standard deviation, sample by sample."""
    file = es.read_model(es.packaged.path("f16-model.toml"))
    channels = {"outputs": file.model.outputs, "inputs": file.model.inputs}
    record = es.read_record(es.packaged.path("f16-flight.csv"), **channels, **file.record)
    detector = es.ChangeDetection(es.UnknownGain(file.model, file.gain.prior), persistence=15.0)
    result = es.estimate(detector, record, prior=file.prior)
    return record.t, result.gain[:, 0], np.sqrt(result.gain_covariance[:, 0, 0])


def points(t, gain):
    """The points of a path, in pixels."""
    x = LEFT + (WIDTH - LEFT - RIGHT) * np.asarray(t) / 12
    y = TOP + (HEIGHT - TOP - BOTTOM) * (1 - np.clip(gain, 0, LIMIT) / LIMIT)
    return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))


def text(t, gain, words, *, shift=(0, 0), **style):
    """Words at a point of the diagram, moved by `shift` pixels."""
    x, y = (float(number) + move for number, move in zip(points([t], [gain]).split(","), shift, strict=True))
    fields = "".join(f' {name.replace("_", "-")}="{value}"' for name, value in style.items())
    return f'<text x="{x:.1f}" y="{y:.1f}"{fields}>{words}</text>'


def drawing(every=3):
    """The figure, with each `every`-th sample."""
    t, gain, sigma = (values[::every] for values in estimated())
    band = points(np.append(t, t[::-1]), np.append(gain + 2 * sigma, (gain - 2 * sigma)[::-1]))
    grid = [f'<polyline points="{points((0, 12), (level, level))}" stroke="#ddd"/>' for level in (0, 0.5, 1, 1.5)]
    labels = [text(0, level, f"{level:g}", shift=(-8, 4), text_anchor="end") for level in (0, 0.5, 1, 1.5)]
    labels += [text(second, 0, second, shift=(0, 18), text_anchor="middle") for second in range(0, 13, 2)]
    labels += [
        text(6, 0, "time [s]", shift=(0, 36), text_anchor="middle"),
        text(
            8.2, 0.5, "estimated gain of the elevator, ± 2 sigma", shift=(0, -34), text_anchor="middle", fill="#1f77b4"
        ),
        text(4.5, 1.0, "true gain", shift=(10, -6), fill="#555"),
    ]
    return "\n".join([
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" font-family="sans-serif" font-size="13">',
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="white"/>',
        *grid,
        f'<polygon points="{band}" fill="#1f77b4" fill-opacity=".2"/>',
        f'<polyline points="{points(*zip(*TRUE, strict=True))}" fill="none" stroke="#555" stroke-dasharray="6 4"/>',
        f'<polyline points="{points(t, gain)}" fill="none" stroke="#1f77b4" stroke-width="1.8"/>',
        *labels,
        "</svg>\n",
    ])  # fmt: skip


if __name__ == "__main__":
    FILE.write_text(drawing())
