"""The report of the gain of a record, as a page."""

from pathlib import Path
from typing import Any

from ..phrases import spread_of
from . import gain_table, gain_text, innovation_checks
from .gain_summary import GainAt, GainSummary
from .run_filter import FilterRun


def write_gain_report(
    run: FilterRun, summary: GainSummary, path: Path, *, story: tuple[str, ...], command: str
) -> None:
    """Write the page: findings, diagrams, checks, assumptions, and the `command` that makes the page again."""
    from ..report import report_of, write_report

    check = innovation_checks.innovation_check(run.judged)
    further = innovation_checks.also(run.assessment.trust.reasons[1:]) if run.assessment else ()
    report = report_of(
        run.result, record=run.record, algorithm=run.algorithm, prior=run.prior,
        title=f"The gain of {run.record_path.name}", lead=(*story, *gain_text.findings(run, summary, check), *further),
        facts=tuple(_facts(run, summary)), commands=(("From a terminal:", command), ("In Python:", script_of(run))),
        files=(run.record_path, run.model_path), judged=run.judged,
        detectable=run.assessment and run.assessment.detectable, tables=tuple(_tables(run, summary)),
        notes=run.assessment.notes if run.assessment else (),
    )  # fmt: skip
    write_report(report, path)


def _tables(run: FilterRun, summary: GainSummary) -> Any:
    """Several gains, one row each."""
    from ..report import Table

    if len(summary.names) > 1:
        rows = tuple(gain_table.cells(row) for row in gain_table.rows_of(run))
        yield Table("Each gain, with 2 sigma", gain_table.HEADINGS, rows)


def _facts(run: FilterRun, summary: GainSummary) -> Any:
    """The main numbers of one gain."""
    from ..report import Fact

    name, *others = summary.names
    if others:
        return
    lost = run.algorithm.innermost.gain_is_effectiveness
    for change in summary.changes:
        if change.onset_s is not None:
            yield Fact(
                f"{_of(change.gain)} changed at", f"{change.onset_s:.4g} s", f"detected at {change.detected_at_s:.4g} s"
            )
    for word, at in (("before", summary.before), ("after", summary.after)):
        yield Fact(f"{_of(name)} {word}", _spread(at), _when(at))
    if lost:
        gain, spread = float(summary.after.mean[0]), 2 * float(summary.after.sigma[0])
        yield Fact("Effectiveness lost", spread_of(100 * (1 - gain), 100 * spread) + " %", _when(summary.after))


def _of(name: str) -> str:
    return "Gain" if name == "gain" else name


def _spread(at: GainAt) -> str:
    return spread_of(float(at.mean[0]), 2 * float(at.sigma[0]))


def _when(at: GainAt) -> str:
    return f"at {at.time:.4g} s, 2 sigma"


def script_of(run: FilterRun) -> str:
    """The same run in Python."""
    reading = "".join(f",\n    {name}={value!r}" for name, value in run.reading.items() if value is not None)
    settings = "".join(f", {name}={value!r}" for name, value in run.settings.items())
    if run.assessment is None:
        steps = [f"algorithm = es.catalogue.build({run.filter!r}, file{settings})",
                 "result = es.estimate(algorithm, record, prior=file.prior)"]  # fmt: skip
    else:
        steps = ['algorithm = es.catalogue.build("unknown-gain", file, walk=0.0, forgetting=1.0)',
                 f"found = es.assess_gain(algorithm, record, prior=file.prior{settings})",
                 "print(found.sentence)", "result = found.result"]  # fmt: skip
    return "\n".join(
        [
            "import estimable as es",
            f"file = es.read_model({run.model_path.name!r})",
            "record = es.read_record(",
            f"    {run.record_path.name!r}, outputs=file.model.outputs, inputs=file.model.inputs{reading},",
            ")",
            *(("record = es.through_actuators(record, file.actuators)",) if run.commanded else ()),
            *steps,
            "result.plot().show()",
        ]
    )
