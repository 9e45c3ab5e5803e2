"""The last estimates of a record, for machines and for people."""

from pathlib import Path
from typing import Any

from .. import checks
from ..figures.bands import bands
from . import innovations, run_filter
from .gain_text import header
from .numbers import counted, decimals
from .run_filter import Run


def last_estimates(result: Any) -> dict[str, dict[str, tuple[float, float]]]:
    """{"state": {name: (mean, sigma)}, "gain": {...}} of the last row; sigma is infinite where nothing is known."""
    last: dict[str, dict[str, tuple[float, float]]] = {"state": {}, "gain": {}}
    for band in bands(result):
        if band.kind in last and band.sigma is not None:
            last[band.kind][band.name] = (float(band.middle[-1]), float(band.sigma[-1]))
    return last


def as_data(run: Run, out: Path | None) -> dict[str, Any]:
    """What `estimate` says to a machine."""
    result, last = run.result, last_estimates(run.result)
    return {
        **run_filter.as_data(run),
        **{key: _named(last[kind], 0) for key, kind in (("mean", "state"), ("gain", "gain"))},
        **{key: _named(last[kind], 1) for key, kind in (("mean_sigma", "state"), ("gain_sigma", "gain"))},
        "log_likelihood": result.log_likelihood,
        "nis": innovations.described(innovations.innovation_check(result)),
        "out": None if out is None else str(out),
    }


def as_text(run: Run) -> list[Any]:
    """What `estimate` says to people."""
    from rich import box
    from rich.table import Table

    when = "last sample" if run.result.t is None else f"last sample, t = {run.result.t[-1]:.6g} s"
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 2, 0, 0), show_edge=False)
    table.add_column(when)
    table.add_column("estimate", justify="right", style="bold")
    table.add_column("sigma", justify="right")
    for named in last_estimates(run.result).values():
        for name, (mean, sigma) in named.items():
            table.add_row(name, *_shown(mean, sigma))
    check = innovations.innovation_check(run.result)
    return [*header(run), "", table, f"Log-likelihood: {run.result.log_likelihood:.6g}.", innovations.sentence(check)]


def write_table(run: Run, out: Path) -> str:
    """Write every sample's estimate; the sentence that says so. Raises `InputError` where `out` cannot be written."""
    frame = run.result.to_pandas()
    try:
        frame.to_csv(out, index_label=frame.index.name or "sample")
    except OSError as error:
        checks.refuse(f"--out {out} could not be written: {error.strerror or error}.")
    return f"Wrote {counted(len(frame), 'row')} of {counted(len(frame.columns), 'column')} to {out}."


def _named(last: dict[str, tuple[float, float]], which: int) -> dict[str, float] | None:
    return {name: both[which] for name, both in last.items()} or None


def _shown(mean: float, sigma: float) -> tuple[str, str]:
    if sigma == float("inf"):
        return "not known", ""
    digits = decimals(sigma)
    return f"{mean + 0.0:.{digits}f}", f"{sigma:.{digits}f}"
