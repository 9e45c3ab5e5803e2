"""The report of a rho synthesis: the criteria over the bandwidth, and the chosen design."""

import platform
from collections.abc import Sequence
from importlib.metadata import version
from typing import Any

import numpy as np

from ..figures.tuning_plots import CHOSEN, INK, KINDS, MOST, WORDS, series, speed
from ..results.designs import BEST, RhoSynthesis
from .assumptions import matrix_text, model_items
from .contents import Chart, Fact, Finding, Key, Report, Section
from .curves import packed

AGREED = 0.05  # largest relative difference of the curve of rho from the proven margin
PART = "What each bandwidth costs"


def tuning_report(
    found: RhoSynthesis,
    *,
    title: str = "Rho synthesis",
    lead: Sequence[str] = (),
    commands: Sequence[tuple[str, str]] = (),
) -> Report:
    """Make a report of a `RhoSynthesis`. `lead`: sentences at its head. `commands`: pairs of what a command does and the
    command itself.
    """
    finite = np.isfinite(found.bandwidth)
    rows = np.flatnonzero(finite)[np.argsort(found.bandwidth[finite], kind="stable")]
    return Report(
        title, tuple(lead), tuple(_facts(found)), found.bandwidth[rows], "bandwidth of the loop [rad/s]",
        (_relative(found, rows), *(_own(found, rows, *kind) for kind in KINDS)), tuple(_verdicts(found)),
        (Section("Model", tuple(model_items(found.model))), _versions()), tuple(commands), (_gains(found),), log_axis=True,
    )  # fmt: skip


def _facts(found: RhoSynthesis) -> Any:
    i = found.chosen
    yield Fact("Chosen bandwidth", speed(found.bandwidth[i]), f"eta {found.eta[i]:.3g} per second")
    yield Fact(
        "Margin rho", f"{found.margin.margin:.3g}", f"at most {found.criteria['rho'].max():.3g}, at {_at(found, 'rho')}"
    )
    for name, unit in (("response_time", " s"), ("control", "")):
        least = found.optima[name]
        yield Fact(
            WORDS[name][0].capitalize(), f"{found.criteria[name][i]:.3g}{unit}",
            f"at least {least.value:.3g}{unit}, at {_at(found, name)}",
        )  # fmt: skip


def _at(found: RhoSynthesis, name: str) -> str:
    return speed(found.optima[name].bandwidth)


def _relative(found: RhoSynthesis, rows: np.ndarray) -> Chart:
    """All criteria, each relative to its best value."""
    traces, keys = [], []
    for name, words, colour, dash, values, times in series(found):
        how = {"mode": "lines", "line": {"color": colour, "width": 2.5, "dash": dash}, "name": words}
        hover = {"customdata": packed(values[rows]), "hovertemplate": "%{y:.3g} of its best (%{customdata:.4g})"}
        traces.append({"y": packed(times[rows]), **how, **hover})
        traces.append(_mark(found, name, times, colour))
        keys.append(Key(words, colour, dash))
    layout = {"yaxis": {"type": "log", "range": [-0.03, float(np.log10(MOST))], "title": {"text": "times its best"}}}
    caption = "A dot marks the best value of a criterion; the dashed line is the chosen design."
    heading = "All criteria, each relative to its best value"
    return Chart(heading, tuple(keys), tuple(traces), layout | _chosen(found), caption, PART)


def _own(found: RhoSynthesis, rows: np.ndarray, kind: str, names: tuple[str, ...]) -> Chart:
    """The criteria of one kind of disturbance, in their own units."""
    drawn = {name: (colour, dash) for name, _, colour, dash, _, _ in series(found)} | {"external": (INK, "solid")}
    traces, keys = [], []
    for name in names:
        colour, dash = drawn[name]
        values = found.criteria[name]
        how = {"mode": "lines", "line": {"color": colour, "width": 2.5, "dash": dash}, "name": WORDS[name][0]}
        traces.append({"y": packed(values[rows]), **how, "hovertemplate": "%{y:.4g}"})
        traces.append(_mark(found, name, values, colour))
        best = found.optima[name]
        keys.append(Key(f"{WORDS[name][0]}: {BEST[name]} {best.value:.3g} at {speed(best.bandwidth)}", colour, dash))
    unit = WORDS[names[0]][1]
    layout = {
        "yaxis": {
            "type": "log",
            "exponentformat": "power",
            "dtick": _ticks(found.criteria[names[0]]),
            "title": {"text": unit},
        }
    }
    return Chart(kind, tuple(keys), tuple(traces), layout | _chosen(found), part=PART)


def _ticks(values: np.ndarray) -> int | str:
    """Every decade, or 1, 2 and 5 of each if there are few."""
    seen = values[np.isfinite(values)]
    return 1 if np.log10(seen.max() / seen.min()) > 2 else "D2"


def _mark(found: RhoSynthesis, name: str, values: np.ndarray, colour: str) -> dict[str, Any]:
    best = found.optima[name]
    mark = {"color": colour, "size": 11, "line": {"color": "#FFFFFF", "width": 1.5}}
    place = best.bandwidth if np.isfinite(best.bandwidth) else None
    return {
        "x": [place], "y": [float(values[best.design])], "mode": "markers", "marker": mark, "hoverinfo": "skip",
    }  # fmt: skip


def _chosen(found: RhoSynthesis) -> dict[str, Any]:
    if not np.isfinite(found.bandwidth[found.chosen]):
        return {}
    place = float(found.bandwidth[found.chosen])
    line = {"type": "line", "x0": place, "x1": place, "yref": "paper", "y0": 0, "y1": 1}
    return {"shapes": [{**line, "line": {"color": CHOSEN, "width": 1.8, "dash": "dash"}}]}


def _verdicts(found: RhoSynthesis) -> Any:
    margin, curve = found.margin, float(found.criteria["rho"][found.chosen])
    chain = f"rho {margin.margin:.4g} <= sigma {margin.sigma:.4g} <= stability radius {margin.stability_radius:.4g}"
    yield Finding("The margin", f"{chain}: proven for the chosen loop", True)
    off = abs(curve / margin.margin - 1)
    yield Finding(
        "The curve of rho",
        f"it differs by {100 * off:.2g} % from the proven margin at the chosen design",
        bool(off <= AGREED),
    )
    last = len(found.eta) - 1
    for name, best in found.optima.items():
        if name in found.weights and best.design in (0, last):
            side = "largest" if best.design == last else "smallest"
            sentence = f"{WORDS[name][0]} is best at the {side} eta of the range: a wider range may be better"
            yield Finding(f"The range, for {WORDS[name][0]}", sentence, None)
    inside = 0 < found.chosen < last
    sentence = (
        "the chosen design is inside the range of eta"
        if inside
        else "the chosen design is at the end of the range of eta"
    )
    yield Finding("The choice", sentence, inside or None)


def _gains(found: RhoSynthesis) -> Section:
    words = ", ".join(f"{WORDS[name][0]} {weight:g}" for name, weight in found.weights.items())
    gains = ("Feedback", matrix_text(found.feedback)), ("Filter", matrix_text(found.filter))
    units = ("Units of the states", matrix_text(found.scaling)), ("Noise of the rms values", found.noise)
    return Section("The chosen gains", (*gains, ("Weights of the criteria", words), *units))


def _versions() -> Section:
    from .. import __version__

    made = f"estimable {__version__}, float64; Python {platform.python_version()}, numpy {version('numpy')}"
    return Section("Made with", (("Software", made),))
