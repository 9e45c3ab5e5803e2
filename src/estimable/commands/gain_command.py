"""`estimable gain`: how much of an input's effect is left."""

from pathlib import Path
from typing import Any

from .. import checks
from . import gain_text, options, show
from .destination import check_destination
from .gain_report import write_gain_report
from .gain_summary import gain_summary
from .record_options import reads_a_record
from .run_filter import FilterRun, run_filter


@reads_a_record
def gain(
    record: options.Record,
    model: options.Model,
    name: options.GainFilter = None,
    report: options.Report = None,
    settings: options.Set = None,
    reading: Any = None,
    machine: options.Machine = False,
) -> None:
    """Find how much of an input's effect is left.

    The model file describes the plant and, in its section [gain], the prior of the gain. The gain is estimated together
    with the state, sample by sample. The report shows each change of the gain, its mean over the 2 s before the first
    change (without a change: the 2 s before one third of the record), and its mean over the last 2 s.

    \b
    Example:
      estimable gain flight.csv --model aircraft.toml --report report.html
      estimable gain flight.csv --model aircraft.toml --filter unknown-gain --set walk=0.05 --json
    """
    check_destination("--report", report, ".html", record=record)
    with show.working("Estimating the gain"):
        run = run_filter(name, record, model, settings=settings or (), reading=reading)
    again = gain_text.command_of(run, "gain", settings or (), reading)
    present("gain", run, machine, report, command=f"{again} --report report.html")
    if not machine:
        show.notes(*run.record.notes, *gain_text.next_steps(run, settings or (), reading))


def present(
    command_name: str, run: FilterRun, machine: bool, report: Path | None, *, command: str, story: tuple[str, ...] = ()
) -> None:
    """Print the gain of a run and write it as a page to the file `report`; `command` makes that page again."""
    if run.result.gain is None:
        checks.refuse(f"{run.filter} does not estimate a gain: leave --filter out.")
    summary = gain_summary(run.result)
    if report is not None:
        write_gain_report(run, summary, report, story=story, command=command)
    if machine:
        written = None if report is None else str(report)
        show.data(command_name, {**gain_text.as_data(run, summary), "report": written})
    else:
        show.text(lambda console: [*story, *([""] if story else []), *gain_text.as_text(run, summary, console)])
    if report is not None and not machine:
        show.notes("", f"Wrote {report}: open it in a browser.")
