"""The last estimates of a record, as JSON and as text."""

from pathlib import Path
from typing import Any

from .. import writing
from ..figures.bands import bands
from ..phrases import decimals
from ..results import Estimate
from . import innovation_checks, run_filter
from .gain_report import script_of
from .gain_text import header
from .numbers import counted
from .run_filter import FilterRun

KINDS = (("mean", "state"), ("gain", "gain"), ("unknown_input", "unknown_input"))


def last_estimates(result: Estimate) -> dict[str, dict[str, tuple[float, float]]]:
    """{"state": {name: (mean, sigma)}, "gain": {...}, "unknown_input": {...}} of the last row that has an estimate.

    Sigma is infinite if the value is unknown.
    """
    last: dict[str, dict[str, tuple[float, float]]] = {"state": {}, "gain": {}, "unknown_input": {}}
    for band in bands(result):
        if band.kind in last and band.sigma is not None:
            row = -1 - (_delay(result) if band.kind == "unknown_input" else 0)
            last[band.kind][band.name] = (float(band.middle[row]), float(band.sigma[row]))
    return last


def _delay(result: Estimate) -> int:
    """How many rows the last estimate of the unknown input lies before the last row."""
    rows = 0 if result.unknown_input is None else len(result.unknown_input)
    return result.names.input_delay if rows > max(result.names.input_delay, 1) else 0


def as_data(run: FilterRun, out: Path | None, report: Path | None = None) -> dict[str, Any]:
    """What `estimate` prints as JSON."""
    result, last = run.result, last_estimates(run.result)
    return {
        **run_filter.as_data(run),
        **{key: _named(last[kind], 0) for key, kind in KINDS},
        **{f"{key}_sigma": _named(last[kind], 1) for key, kind in KINDS},
        "unknown_input_delay": result.names.input_delay if result.names.unknown_inputs else None,
        "note": result.names.note or None,
        "log_likelihood": result.log_likelihood,
        "nis": innovation_checks.described(innovation_checks.innovation_check(run.judged)),
        "innovation_faults": innovation_checks.faults(run.judged, run.record),
        "out": None if out is None else str(out),
        "report": None if report is None else str(report),
    }


def as_text(run: FilterRun) -> list[Any]:
    """What `estimate` prints as text."""
    from rich import box
    from rich.table import Table

    when = "last sample" if run.result.t is None else f"last sample, t = {run.result.t[-1]:.6g} s"
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 2, 0, 0), show_edge=False)
    table.add_column(when)
    table.add_column("estimate", justify="right", style="bold")
    table.add_column("sigma", justify="right")
    delay = _delay(run.result)
    for kind, named in last_estimates(run.result).items():
        earlier = f", {counted(delay, 'sample')} earlier" if kind == "unknown_input" and delay else ""
        for name, (mean, sigma) in named.items():
            table.add_row(name + earlier, *_shown(mean, sigma))
    check = innovation_checks.innovation_check(run.judged)
    note = [run.result.names.note] if run.result.names.note else []
    return [
        *innovation_checks.warning(check),
        *note,
        table,
        "",
        innovation_checks.sentence(check),
        *innovation_checks.also(innovation_checks.faults(run.judged, run.record)),
        f"Log-likelihood: {run.result.log_likelihood:.6g}.",
        "",
        *header(run),
    ]


def write_table(run: FilterRun, out: Path) -> str:
    """Write the estimates of all samples and return the message. Raises `InputError` if `out` cannot be written."""
    frame = run.result.to_pandas()
    if run.smoothed is not None:
        frame = frame.join(_smoothed_columns(run))
    text = frame.to_csv(index_label=frame.index.name or "sample")
    writing.write(out, lambda stream: stream.write(text.encode()), option="--out")
    return f"Wrote {counted(len(frame), 'row')} of {counted(len(frame.columns), 'column')} to {out}."


def _smoothed_columns(run: FilterRun) -> Any:
    """The columns of the smoother: NAME_smoothed of an output, smoothed_NAME of a state or gain."""
    assert run.smoothed is not None
    frame, names = run.smoothed.to_pandas(), run.smoothed.names
    outputs = [f"{name}_smoothed{end}" for name in names.outputs for end in ("", "_sigma")]
    others = [
        f"{name}{end}"
        for name in (*names.states, *names.gains, *names.unknown_inputs)
        for end in ("", "_sigma")
        if f"{name}{end}" in frame
    ]
    return frame[others].add_prefix("smoothed_").join(frame[[n for n in outputs if n in frame]])


def write_page(run: FilterRun, path: Path, command: str) -> str:
    """Write the page and return the message; `command` makes it again."""
    from ..report import report_of, write_report

    check = innovation_checks.innovation_check(run.judged)
    lead = (
        *innovation_checks.warning(check),
        innovation_checks.sentence(check),
        *(gap.sentence for gap in run.result.gaps),
    )
    script = script_of(run)
    if run.smoothed is not None:
        script += "\nsmoothed = es.smooth(algorithm, record, prior=file.prior)"
    page = report_of(
        run.result, record=run.record, algorithm=run.algorithm, prior=run.prior, title=f"States of {run.record_path.name}",
        lead=lead, commands=(("From a terminal:", command), ("In Python:", script)), files=(run.record_path, run.model_path),
        judged=run.judged, outputs=True, smoothed=run.smoothed,
    )  # fmt: skip
    write_report(page, path)
    return f"Wrote {path}: open it in a browser."


def _named(last: dict[str, tuple[float, float]], which: int) -> dict[str, float] | None:
    return {name: both[which] for name, both in last.items()} or None


def _shown(mean: float, sigma: float) -> tuple[str, str]:
    if sigma == float("inf"):
        return "not known", ""
    digits = decimals(sigma)
    return f"{mean + 0.0:.{digits}f}", f"{sigma:.{digits}f}"
