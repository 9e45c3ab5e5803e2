"""The gain of a record, as text."""

import shlex
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from ..annotations import Tree
from ..diagnostics.consistency import Consistency
from ..phrases import spread_of
from . import gain_table, innovation_checks, run_filter
from .gain_summary import GainAt, GainSummary, by_name
from .numbers import counted
from .record_options import as_words
from .run_filter import FilterRun
from .terminal_plot import ASCII, UNICODE, plot

if TYPE_CHECKING:
    from rich.console import Console
    from rich.text import Text

WIDEST = 100


def as_data(run: FilterRun, summary: GainSummary) -> dict[str, Any]:
    """What `gain` and `demo` print as JSON."""
    before, after, names, result = summary.before, summary.after, summary.names, run.result
    check, first = innovation_checks.innovation_check(run.judged), next(iter(summary.changes), None)
    return {
        **run_filter.as_data(run),
        "outputs": result.names.outputs,
        "inputs": result.names.inputs,
        "gains": names,
        "failure_time_s": first.onset_s if first else None,
        "detected_at_s": first.detected_at_s if first else None,
        "changes": [change._asdict() for change in summary.changes],
        "gain_before": by_name(names, before.mean),
        "gain_before_sigma": by_name(names, before.sigma),
        "before_s": before.time,
        "gain_after": by_name(names, after.mean),
        "gain_after_sigma": by_name(names, after.sigma),
        "after_s": after.time,
        "gain_interval": _interval(run),
        "finding": gain_table.finding(run),
        "rows": gain_table.as_data(run),
        **_verdict(run),
        "findings": findings(run, summary, check),
        "log_likelihood": result.log_likelihood,
        "nis": innovation_checks.described(check),
        "innovation_faults": innovation_checks.faults(run.judged, run.record),
    }


def as_text(run: FilterRun, summary: GainSummary, console: "Console") -> list[Any]:
    """What `gain` and `demo` print as text: the findings and the gain before and after, its plot, the check, and the files.

    Of several gains there is one line each, and no plot.
    """
    unicode = not console.options.ascii_only
    check = innovation_checks.innovation_check(run.judged)
    if len(summary.names) > 1:
        rows = gain_table.table(gain_table.rows_of(run), "±" if unicode else "+/-")
        files = f"{_length(run)}; {run.model_path.name}, filter {run.filter}, engine {run.result.engine}"
        return [*findings(run, summary, check), "", rows, "", innovation_checks.sentence(check), files]
    return [
        *findings(run, summary, check), "", _table(run, summary, "±" if unicode else "+/-"), "",
        *_plot(run, summary, min(console.width, WIDEST), unicode), "",
        innovation_checks.sentence(check), *innovation_checks.also(innovation_checks.faults(run.judged, run.record)),
        "", *header(run),
    ]  # fmt: skip


def findings(run: FilterRun, summary: GainSummary, check: Consistency | None) -> tuple[str, ...]:
    """The verdict on the model, the findings about each gain, and the smallest loss that would have been detected."""
    several = len(summary.names) > 1
    if run.assessment is None:
        sentences = (gain_table.finding(run),) if several else summary.findings
        return (*innovation_checks.warning(check), *sentences)
    found = run.assessment
    if several:
        shown = () if found.detectable is None else gain_table.shown(found.detectable, found.rows)
        return (found.trust.sentence, found.finding, *shown)
    changed = {change.gain for change in summary.changes}
    shown = () if found.detectable is None else found.detectable.sentences
    quiet = [sentence for name, sentence in zip(summary.names, shown, strict=False) if name not in changed]
    still = () if found.detectable is None else found.detectable.still
    return (found.trust.sentence, *summary.findings, *quiet, *still)


def _interval(run: FilterRun) -> Any:
    """The 95 % interval of each gain at the end."""
    median, sigma = (values[-1] for values in run.result.gain_standing)
    if run.result.gain_quantiles is not None:
        ends = np.asarray(run.result.gain_quantiles)[-1][:, [0, 4]]
    else:
        ends = np.stack([median - 1.959964 * sigma, median + 1.959964 * sigma], axis=1)
    pairs = [[float(low), float(high)] for low, high in ends]
    return pairs[0] if len(pairs) == 1 else dict(zip(run.result.names.gains, pairs, strict=True))


def _verdict(run: FilterRun) -> dict[str, Any]:
    """The verdict of the whole chain; nothing where a filter ran as given."""
    if run.assessment is None:
        return {"verdict": None, "reasons": [], "untestable": [], "detectable_loss": None, "prepared": []}
    found, loss = run.assessment, run.assessment.detectable
    return {
        "verdict": found.trust.word,
        "verdict_p": found.trust.p,
        "reasons": found.trust.reasons,
        "untestable": [one.sentence for one in found.trust.untestable],
        "detectable_loss": None if loss is None else gain_table.loss_as_data(loss),
        "prepared": found.notes,
    }


def detectable(run: FilterRun) -> list[Any]:
    """What `gain --detectable` prints: for each interval the smallest loss that begins with it and shows before its end."""
    found = run.assessment
    if found is None or found.detectable is None:
        return []
    power = 100 * found.detectable.power[-1]
    title = f"A loss that begins with the interval and is detected before its end, with probability {power:.0f} %:"
    return ["", title, gain_table.detectable_table(found.detectable, found.rows)]


def header(run: FilterRun) -> list[str]:
    """The files that were read, and the filter that ran."""
    names = run.result.names
    outputs = f"output{'s' if len(names.outputs) > 1 else ''} {', '.join(names.outputs)}"
    inputs = f"; input{'s' if len(names.inputs) > 1 else ''} {', '.join(names.inputs)}" if names.inputs else ""
    return [
        f"{_length(run)}; {outputs}{inputs}",
        f"{run.model_path.name}, filter {run.filter}, engine {run.result.engine}",
        *(run.assessment.notes if run.assessment else _settings(run)),
        *_unseen(run),
        *_gaps(run),
    ]


def _length(run: FilterRun) -> str:
    lasting = "" if run.record.seconds is None else f" over {run.record.seconds:.4g} s"
    return f"{run.record_path.name}: {counted(len(run.record), 'sample')}{lasting}"


def _settings(run: FilterRun) -> Iterable[str]:
    """The settings of the filter."""
    from rich.markup import escape

    settings = run_filter.settings_in_force(run.algorithm)
    if settings:
        yield escape(f"With {', '.join(f'{name}={_written(value)}' for name, value in settings.items())}.")


def _written(value: Tree) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value).replace(" ", "")


def _unseen(run: FilterRun) -> Iterable[str]:
    """The share of each output that was not seen, and the outputs that a gate rejected."""
    seen = np.mean([run.record.seen[:, run.record.outputs.index(name)] for name in run.result.names.outputs], axis=1)
    for name, share in zip(run.result.names.outputs, seen, strict=True):
        if share == 0:
            yield f"No sample of {name} was seen: it gives no information."
        elif share < 1:
            yield f"{100 * (1 - share):.2g} % of {name} was not seen."
    if (rejected := run.result.extra.get("rejected")) is not None:
        out, of = int(rejected.sum()), int(run.record.seen.sum())
        yield f"The gate rejected {out:,} of {of:,} outputs. A large share means that it may be rejecting good data."


def _gaps(run: FilterRun) -> Iterable[str]:
    """What was done where an input was not recorded; of many gaps, the longest."""
    found = run.result.gaps
    if not found:
        return
    longest = max(found, key=lambda gap: gap.seconds)
    more = "" if len(found) == 1 else f" (the longest of {len(found)} gaps)"
    yield f"Gap without a recorded input{more}: {longest.sentence}."


def next_steps(run: FilterRun, settings: Iterable[str], reading: dict[str, Any]) -> tuple[str, ...]:
    """What to do after `gain`: the same run again, written as a table."""
    return ("", "Every sample, as a table:", f"  {command_of(run, 'estimate', settings, reading)} --out gain.csv")


def command_of(run: FilterRun, command: str, settings: Iterable[str], reading: dict[str, Any]) -> str:
    """The command line of the same run."""
    words = [str(run.record_path), "--model", str(run.model_path), "--filter", run.filter]
    for setting in settings:
        words += ["--set", setting]
    return " ".join([f"estimable {command} {shlex.join(words)}", *as_words(reading)])


def _table(run: FilterRun, summary: GainSummary, sign: str) -> Any:
    from rich import box
    from rich.table import Table

    lost = run.algorithm.innermost.gain_is_effectiveness
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 2, 0, 0), show_edge=False)
    for heading in ("", "second"):
        table.add_column(heading)
    for heading in [f"gain {sign} 2 sigma", *(["effectiveness lost"] if lost else [])]:
        table.add_column(heading, justify="right", style="bold")
    for word, at in (("before", summary.before), ("after", summary.after)):
        table.add_row(word, f"{at.time:.4g}", *_cells(at, lost, sign))
    return table


def _cells(at: GainAt, lost: bool, sign: str) -> list[str]:
    gain, spread = float(at.mean[0]), 2 * float(at.sigma[0])
    shown = [spread_of(gain, spread, sign=sign)]
    return [*shown, spread_of(100 * (1 - gain), 100 * spread, unit=" %", sign=sign)] if lost else shown


def _plot(run: FilterRun, summary: GainSummary, width: int, unicode: bool) -> list[Any]:
    from rich.text import Text

    result = run.result
    median, sigma = (values[:, 0] for values in result.gain_standing)
    sigma = np.where(np.isnan(median), np.inf, sigma)
    t = np.arange(len(sigma), dtype=float) if result.t is None else result.t
    windows = {}
    for change in summary.changes[:1]:
        if change.onset_s is not None:
            windows["change"] = (change.onset_s, change.detected_at_s)
    drawn = plot(t, np.nan_to_num(median), sigma, width=width, marks=windows, ink=UNICODE if unicode else ASCII)
    title = f"{summary.names[0]} over time, with its {'±' if unicode else '+/-'} 2 sigma band"
    return [title, *(_coloured(Text(line, no_wrap=True)) for line in drawn)]


def _coloured(line: "Text") -> "Text":
    line.highlight_regex("[░:]+", "blue")
    line.highlight_regex("[\u2800-\u28ff*]+", "bold bright_cyan")
    return line
