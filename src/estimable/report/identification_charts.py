"""The diagrams of an identification: held-out data, orders, residuals, poles and zeros, responses."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from .. import diagnostics
from ..diagnostics.innovations import Correlations
from ..diagnostics.responses import FrequencyResponse, Response, Roots
from ..errors import InputError
from ..identifiers.residuals import first_lag
from ..results import Excitation, Fit
from ..results.comparisons import shown
from ..results.order_selection import OrderSelection
from .charts import BOUND, MEASURED, STATE, thinned
from .contents import Chart, Key
from .curves import FILL, MARK, packed

ACCENT = "#B34700"
CRITERIA = (("bic", "BIC", STATE, "solid"), ("aicc", "AICc", ACCENT, "dash"), ("aic", "AIC", BOUND, "dot"))
CROSS = ("cross_validation", "cross-validation", "#2E7D32", "dashdot")
RADIUS = np.sqrt(5.991)  # of an ellipse that contains 95 %
FARTHEST = 2.5  # largest modulus of the roots that are drawn
MOST_PAIRS = 6  # most pairs of output and input whose responses are drawn
UNSURE = 4.0  # largest sigma of log modulus or phase that is drawn
MERGED = (
    " An ellipse reaches beyond the next pole: these poles are not determined individually. The responses below are. A lower "
    "order may be sufficient."
)
TO_DECIBEL = 20 / np.log(10)
HELD, ORDER, LEFT, MODEL, EXCITED = (
    "Does the model simulate held-out data?", "Which order?", "Are the residuals white?", "The model",
    "Does the input excite the plant?",
)  # fmt: skip


def simulation_charts(
    names: Sequence[str], y: np.ndarray, simulated: np.ndarray, sigma: np.ndarray, fits: Sequence[float], split: float
) -> list[Chart]:
    """Measured and simulated outputs (T, p) with the band of the parameters and the noise; `split`: start of what was judged."""
    rows, charts = thinned(len(y)), []
    edge = {
        "type": "line",
        "x0": split,
        "x1": split,
        "yref": "paper",
        "y0": 0,
        "y1": 1,
        "line": {"color": MARK, "width": 1.5},
    }
    for i, name in enumerate(names):
        middle, spread = simulated[rows, i], 2 * sigma[rows, i]
        known = bool(np.isfinite(spread).any())
        traces = _band(None, middle - spread, middle + spread, STATE) if known else []
        traces.append(
            {**_curve(None, y[rows, i], f"measured {name}", MEASURED), "line": {"color": MEASURED, "width": 1}}
        )
        traces.append(_curve(None, middle, "simulated", STATE))
        keys = [Key("simulated from the inputs alone", STATE, "line"), Key(f"measured {name}", MEASURED, "line")]
        keys += [Key("± 2 sigma of the parameters and the noise", STATE, "band")] if known else []
        keys.append(Key("start of the held-out part", MARK, "line"))
        charts.append(
            Chart(
                f"{name}: {shown(fits[i])} of the held-out part",
                tuple(keys),
                tuple(traces),
                {"shapes": [edge]},
                part=HELD,
            )
        )
    return charts


def order_charts(found: OrderSelection, taken: int) -> list[Chart]:
    """Each criterion relative to its minimum, and the singular values; the chosen order is marked."""
    traces, keys = [], []
    for name, word, colour, dash in (*CRITERIA, CROSS):
        values = getattr(found, name)
        finite = np.isfinite(values)
        above = values[finite] - values[finite].min()
        line = {"color": colour, "width": 2, "dash": dash}
        traces.append({
            "x": found.orders[finite].tolist(), "y": packed(1 + above), "mode": "lines+markers", "name": word, "line": line,
            "marker": {"size": 8, "color": colour}, "hovertemplate": "%{y:.1f}",
        })  # fmt: skip
        keys.append(Key(f"{word}: {found.by(name)}", colour, "line" if dash == "solid" else "dash"))
    layout = {
        "xaxis": {"title": {"text": "order"}, "dtick": 1},
        "yaxis": {"title": {"text": "1 + amount above its minimum"}, "type": "log", "dtick": 1},
        "shapes": [_at(taken)],
    }  # fmt: skip
    caption = "Smaller is better; differences below 2 are not significant. Each method has its own order."
    keys.append(Key(f"order {taken}, chosen", MARK, "dash"))
    charts = [Chart("Criteria of ARX models", tuple(keys), tuple(traces), layout, caption, ORDER)]
    return [*charts, _singular_values(found, taken)] if found.singular_values is not None else charts


def _singular_values(found: OrderSelection, taken: int) -> Chart:
    values = np.asarray(found.singular_values)[: max(2 * len(found.orders), 10)]
    index = list(range(1, len(values) + 1))
    trace = {
        "x": index, "y": packed(values), "mode": "markers", "name": "singular value", "marker": {"size": 9, "color": STATE},
        "hovertemplate": "%{y:.3g}",
    }  # fmt: skip
    layout = {
        "xaxis": {"title": {"text": "number"}, "nticks": 8},
        "yaxis": {"title": {"text": ""}, "type": "log", "dtick": 1}, "shapes": [_at(taken + 0.5)],
    }  # fmt: skip
    keys = (Key("singular values", STATE, "dots"), Key(f"the chosen order, {taken}", MARK, "dash"))
    caption = (
        f"Singular values of the plant are larger than those of the noise. The largest gap is after number {found.gap}."
    )
    return Chart("Singular values of the Hankel matrix", keys, (trace,), layout, caption, ORDER)


def _at(x: float) -> dict[str, Any]:
    line = {"color": MARK, "width": 1.5, "dash": "dash"}
    return {"type": "line", "x0": x, "x1": x, "yref": "paper", "y0": 0, "y1": 1, "line": line}


def excitation_chart(found: Excitation, times: np.ndarray) -> Chart:
    """The smallest eigenvalue of the information up to each time, and its limit."""
    positive = found.eigenvalues > 0
    x = times[found.samples[positive]]
    trace = {"x": packed(x), "y": packed(found.eigenvalues[positive]), "mode": "lines", "name": "smallest eigenvalue",
             "line": {"color": STATE, "width": 2}, "hovertemplate": "%{y:.3g}"}  # fmt: skip
    bound = {"color": BOUND, "width": 1.8, "dash": "dash"}
    limit = float(found.check.limit)
    layout = {
        "xaxis": {"title": {"text": "time [s]"}}, "yaxis": {"title": {"text": "of the scaled information"}, "type": "log"},
        "shapes": [{"type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": limit, "y1": limit, "line": bound}],
    }  # fmt: skip
    keys = (Key("smallest eigenvalue up to this time", STATE, "line"), Key("limit", BOUND, "dash"))
    return Chart(
        "Information in the record about the parameters", keys, (trace,), layout, found.check.sentence, EXCITED
    )


def residual_charts(
    e: np.ndarray, u: np.ndarray, outputs: Sequence[str], inputs: Sequence[str], *, direct: bool
) -> list[Chart]:
    """Correlations of the held-out residuals (T, p) with themselves and with the inputs (T, m), with their bands."""
    charts = []
    for i, name in enumerate(outputs):
        charts += _correlations(
            lambda i=i, name=name: diagnostics.whiteness(e[:, i], name=name), f"Residuals of {name} with themselves"
        )
        for j, given in enumerate(inputs):
            charts += _correlations(
                lambda i=i, j=j: diagnostics.cross_correlation(e[:, i], u[:, j], first=first_lag(u[:, j], direct)),
                f"Residuals of {name} with {given}",
            )
    return charts


def _correlations(test: Callable[[], Correlations], heading: str) -> list[Chart]:
    """Bars by lag, and the band that contains 95 %; nothing if there are too few samples."""
    try:
        found: Correlations = test()
    except InputError:
        return []
    lags, band = found.lags.tolist(), float(np.median(found.band))
    bars = {"type": "bar", "x": lags, "y": packed(found.values), "marker": {"color": STATE}, "width": 0.5, "name": "correlation",
            "hovertemplate": "%{y:.3f}"}  # fmt: skip
    bound = {"color": BOUND, "width": 1.8, "dash": "dash"}
    shapes = [
        {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": side * band, "y1": side * band, "line": bound}
        for side in (1, -1)
    ]
    top = 1.25 * max(float(np.abs(found.values).max()), band)
    layout = {
        "xaxis": {"title": {"text": "lag [samples]"}, "dtick": 5}, "shapes": shapes,
        "yaxis": {"title": {"text": "correlation"}, "range": [-top, top], "zeroline": True},
    }  # fmt: skip
    keys = (Key("correlation", STATE, "line"), Key("± 2 sigma: 95 % inside", BOUND, "dash"))
    size = f"Sum of squares {found.statistic:.1f}, limit {found.limit:.1f} (99.9 % are below it)."
    return [Chart(heading, keys, (bars,), layout, size, LEFT)]


def model_charts(fit: Fit) -> list[Chart]:
    """Poles and zeros, then the responses of each pair of channels, with their confidence bands."""
    model = diagnostics.spread_of(fit).model
    pairs = [(i, j) for i in range(model.p) for j in range(model.m)][:MOST_PAIRS]
    frequency, step = diagnostics.frequency_response(fit), diagnostics.step_response(fit)
    charts = [_poles(fit, len(pairs) == 1)]
    for i, j in pairs:
        label = "" if len(pairs) == 1 else f", {model.inputs[j]} to {model.outputs[i]}"
        charts += [_step(step, i, j, label), *_bode(frequency, i, j, label)]
    return charts


def _poles(fit: Fit, alone: bool) -> Chart:
    """The map of poles, with the zeros if there is one input and one output."""
    angle = np.linspace(0, 2 * np.pi, 181)
    circle = {"x": packed(np.cos(angle)), "y": packed(np.sin(angle)), "mode": "lines", "line": {"color": "#999", "width": 1},
              "hoverinfo": "skip"}  # fmt: skip
    poles = diagnostics.poles(fit)
    keys, traces = [Key("poles (×)", STATE, "line"), Key("unit circle", "#999999", "line")], [circle]
    traces += _roots(poles, "pole", STATE, "x-thin")
    zeros = diagnostics.zeros(fit) if alone else None
    if zeros is not None:
        traces += _roots(zeros, "zero", ACCENT, "circle-open")
        keys.insert(1, Key("zeros (○)", ACCENT, "line"))
    known = bool(np.isfinite(poles.covariance).any())
    keys += [Key("95 % inside", STATE, "band")] if known else []
    values = np.concatenate([poles.values, [] if zeros is None else zeros.values])
    near = values[np.abs(values) <= FARTHEST]
    reach = 1.12 * max(1.0, float(np.abs(near).max(initial=0.0)))
    far = [_complex(complex(z)) for z in values[np.abs(values) > FARTHEST] if np.imag(z) >= 0]
    caption = f"Outside the diagram: {', '.join(far)}." if far else ""
    caption += "" if known else " This method gives no uncertainty of the poles."
    caption += MERGED if _merge(poles) else ""
    layout = {
        "hovermode": "closest", "xaxis": {"title": {"text": "real"}, "range": [-reach, reach], "zeroline": True},
        "yaxis": {"title": {"text": "imaginary"}, "range": [-reach, reach], "zeroline": True, "scaleanchor": "x"},
    }  # fmt: skip
    return Chart("Poles and zeros" if alone else "Poles", tuple(keys), tuple(traces), layout, caption.strip(), MODEL)


def _merge(poles: Roots) -> bool:
    """Whether an ellipse reaches beyond the next pole."""
    z, known = poles.values, np.isfinite(poles.covariance).all(axis=(1, 2))
    apart = np.abs(z[:, None] - z) + np.where(np.eye(len(z), dtype=bool), np.inf, 0.0)
    reach = RADIUS * np.sqrt(np.linalg.eigvalsh(poles.covariance[known])[:, -1]) if known.any() else np.zeros(0)
    return bool(np.any(reach > apart[known].min(axis=1, initial=np.inf)))


def _roots(found: Roots, word: str, colour: str, symbol: str) -> list[dict[str, Any]]:
    near = np.abs(found.values) <= FARTHEST
    values, traces = found.values[near], []
    for z, Σ in zip(values, found.covariance[near], strict=True):
        if np.isfinite(Σ).all():
            traces.append(_ellipse(z, Σ, colour))
    marker = {"symbol": symbol, "size": 11, "color": colour, "line": {"width": 2.2, "color": colour}}
    labels = [f"{word} {_complex(z)}" for z in values]
    points = {"x": packed(np.real(values)), "y": packed(np.imag(values)), "mode": "markers", "marker": marker, "text": labels,
              "hovertemplate": "%{text}<extra></extra>"}  # fmt: skip
    return [*traces, points]


def _ellipse(z: complex, Σ: np.ndarray, colour: str) -> dict[str, Any]:
    size, axes = np.linalg.eigh(Σ)
    angle = np.linspace(0, 2 * np.pi, 73)
    edge = RADIUS * axes @ (np.sqrt(np.maximum(size, 0.0))[:, None] * np.stack([np.cos(angle), np.sin(angle)]))
    return {"x": packed(z.real + edge[0]), "y": packed(z.imag + edge[1]), "mode": "lines", "fill": "toself", "hoverinfo": "skip",
            "fillcolor": _clear(colour), "line": {"color": colour, "width": 1}}  # fmt: skip


def _complex(z: complex) -> str:
    return f"{z.real:.3g}" + (f" {'±' if z.imag else ''} {abs(z.imag):.3g}i" if abs(z.imag) > 1e-9 else "")


def _step(found: Response, i: int, j: int, label: str) -> Chart:
    values, spread = found.values[:, i, j], 2 * found.sigma[:, i, j]
    known = bool(np.isfinite(spread).all())
    traces = _band(found.at, values - spread, values + spread, STATE) if known else []
    traces.append(_curve(found.at, values, "step response", STATE))
    layout = {"xaxis": {"title": {"text": "time [s]"}}, "yaxis": {"title": {"text": ""}, "zeroline": True}}
    return Chart(f"Step response{label}", _keys("step response", known), tuple(traces), layout, _caveat(known), MODEL)


def _bode(found: FrequencyResponse, i: int, j: int, label: str) -> list[Chart]:
    G, f = found.values[:, i, j], found.frequencies
    size = TO_DECIBEL * np.log(np.maximum(np.abs(G), np.finfo(float).tiny))
    phase = np.degrees(np.unwrap(np.angle(G)))
    charts = []
    for heading, unit, values, sigma, scale in (
        ("Gain", "dB", size, found.log_modulus_sigma[:, i, j], TO_DECIBEL),
        ("Phase", "degrees", phase, found.phase_sigma[:, i, j], 180 / np.pi),
    ):
        spread = 2 * scale * np.minimum(sigma, UNSURE)
        known = bool(np.isfinite(spread).any())
        traces = _band(f, values - spread, values + spread, STATE) if known else []
        traces.append(_curve(f, values, heading.lower(), STATE))
        room = 0.15 * (values.max() - values.min()) + 3
        layout = {
            "xaxis": {"title": {"text": "frequency [Hz]"}, "type": "log", "dtick": 1, "minor": {"ticks": "outside"}},
            "yaxis": {"title": {"text": unit}, "range": [float(values.min() - room), float(values.max() + room)]},
        }  # fmt: skip
        charts.append(
            Chart(f"{heading}{label}", _keys(heading.lower(), known), tuple(traces), layout, _caveat(known), MODEL)
        )
    return charts


def _keys(word: str, known: bool) -> tuple[Key, ...]:
    return (Key(word, STATE, "line"), *((Key("± 2 sigma", STATE, "band"),) if known else ()))


def _caveat(known: bool) -> str:
    return "" if known else "This method gives no uncertainty."


def _curve(x: np.ndarray | None, y: np.ndarray, name: str, colour: str) -> dict[str, Any]:
    line = {
        "y": packed(y),
        "mode": "lines",
        "name": name,
        "line": {"color": colour, "width": 2},
        "hovertemplate": "%{y:.4g}",
    }
    return line if x is None else {"x": packed(x), **line}


def _band(x: np.ndarray | None, lower: np.ndarray, upper: np.ndarray, colour: str) -> list[dict[str, Any]]:
    bare = {"mode": "lines", "line": {"width": 0}, "hoverinfo": "skip", **({} if x is None else {"x": packed(x)})}
    return [{"y": packed(lower), **bare}, {"y": packed(upper), **bare, "fill": "tonexty", "fillcolor": _clear(colour)}]


def _clear(colour: str) -> str:
    red, green, blue = (int(colour[k : k + 2], 16) for k in (1, 3, 5))
    return f"rgba({red},{green},{blue},{FILL})"
