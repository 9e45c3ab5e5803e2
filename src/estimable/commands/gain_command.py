"""`estimable gain`: how much of an input's effect is left."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from .. import checks
from . import gain_text, options, show
from .destination import check_destination
from .gain_report import write_gain_report
from .gain_summary import gain_summary
from .record_options import reads_a_record
from .run_filter import FilterRun, has_unknown_gain, run_filter, run_gain


@reads_a_record
def gain(
    record: options.Record,
    model: options.Model,
    name: options.GainFilter = None,
    report: options.Report = None,
    settings: options.Set = None,
    reading: Any = None,
    healthy: options.Healthy = None,
    no_offset: options.NoOffset = False,
    as_given: options.AsGiven = False,
    detectable: options.Detectable = False,
    machine: options.Machine = False,
) -> None:
    """Find how much of an input's effect is left.

    The model file describes the plant and, in its section [gain], the prior of the gain. The gain is estimated together
    with the state, sample by sample. The noise is fitted to the part before any change, offsets are estimated, and errors
    of 10 % in the model count in the interval (--as-given: none of this). The report begins with whether to believe it.

    \b
    Example:
      estimable gain flight.csv --model aircraft.toml --report report.html
      estimable gain flight.csv --model aircraft.toml --filter unknown-gain --set walk=0.05 --json
    """
    check_destination("--report", report, ".html", record=record)
    with show.working("Estimating the gain"):
        run = _run(name, record, model, settings or (), reading, _span(healthy), not no_offset, as_given)
    if detectable and (run.assessment is None or run.assessment.detectable is None):
        checks.refuse(
            "--detectable needs the whole chain, and a record with times that is not too short: leave --filter, --set and "
            "--as-given out."
        )
    again = gain_text.command_of(run, "gain", settings or (), reading)
    present("gain", run, machine, report, command=f"{again} --report report.html")
    if detectable and not machine:
        show.text(lambda _: gain_text.detectable(run))
    if not machine:
        show.notes(*run.record.notes, *gain_text.next_steps(run, settings or (), reading))


def _run(
    name: str | None, record: Path, model: Path, settings: Iterable[str], reading: dict[str, Any],
    healthy: tuple[float, float] | None, offset: bool, as_given: bool,
) -> FilterRun:  # fmt: skip
    """The whole chain, unless a filter or settings are given, the run is as given, or the prior knows the gain exactly."""
    from ..models.files import read_model

    file = read_model(model) if name is None and not settings and not as_given else None
    if file is not None and has_unknown_gain(file):
        return run_gain(record, model, reading=reading, healthy=healthy, offset=offset, file=file)
    if healthy is not None or not offset:
        checks.refuse("--healthy and --no-offset prepare the model: leave --filter, --set and --as-given out.")
    return run_filter(name, record, model, settings=settings, reading=reading, file=file)


def _span(text: str | None) -> tuple[float, float] | None:
    """The seconds of `--healthy FROM:TO`."""
    if text is None:
        return None
    try:
        first, last = (float(part) for part in text.split(":"))
    except ValueError:
        checks.refuse(f"--healthy needs the first and last second, as in --healthy 0:8. Got {text!r}.")
    return first, last


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
