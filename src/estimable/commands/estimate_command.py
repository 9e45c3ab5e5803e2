"""`estimable estimate`: the states of a record, with any filter."""

import shlex
from typing import Any

from . import estimate_report, options, show
from .destination import check_destination
from .gain_text import command_of
from .record_options import reads_a_record
from .run_filter import run_filter


@reads_a_record
def estimate(
    record: options.Record,
    model: options.Model,
    name: options.Filter,
    unknown: options.Unknown = None,
    settings: options.Set = None,
    smooth: options.Smooth = False,
    out: options.Out = None,
    report: options.Report = None,
    reading: Any = None,
    machine: options.Machine = False,
) -> None:
    """Estimate the states of a record.

    The command runs a filter over the record, and shows the last estimate of each state. --out writes the estimates of all
    samples. --report writes a page with the outputs as measured and as estimated, the states, and whether they can be trusted.

    \b
    Example:
      estimable estimate flight.csv --model aircraft.toml --filter kalman
      estimable estimate flight.csv --model aircraft.toml --filter kalman --smooth --out states.csv --report states.html
      estimable estimate flight.csv --model aircraft.toml --filter unknown-gain --set walk=0.05 --out gain.csv
      estimable estimate flight.csv --model aircraft.toml --filter unknown-input --unknown elevator
    """
    check_destination("--out", out, ".csv", record=record)
    check_destination("--report", report, ".html", record=record)
    with show.working(f"Running {name}"):
        run = run_filter(
            name, record, model, settings=settings or (), unknown=unknown or (), reading=reading, smoothing=smooth
        )
    written = [] if out is None else [estimate_report.write_table(run, out)]
    if report is not None:
        again = command_of(run, "estimate", settings or (), reading)
        again += "".join(f" --unknown {shlex.quote(one)}" for one in unknown or ())
        written.append(estimate_report.write_page(run, report, f"{again}{' --smooth' if smooth else ''}"))
    if machine:
        show.data("estimate", estimate_report.as_data(run, out, report))
    else:
        show.text(lambda _: estimate_report.as_text(run))
        show.notes(*run.record.notes, *written)
