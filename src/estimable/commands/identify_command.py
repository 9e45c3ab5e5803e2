"""`estimable identify`: a model from a record with gaps."""

from pathlib import Path
from typing import Annotated, Any

import typer

from . import compare_report, identify_report, options, show
from .identify_files import Asked, destinations
from .record_options import reads_a_record

METHOD_HELP = "One method instead of a comparison: output-error-ml, subspace, ..."
HELD_OUT_HELP = "Rank the methods on this other record, and fit them to the whole of RECORD. May be repeated."
FEEDBACK_HELP = "What to do about a closed loop: tested, accepted (run every method) or closed (the record is one)."
LEVEL_HELP = "What is subtracted first: mean, trend or none. Default: mean; none with --method."
Method = Annotated[str | None, typer.Option("--method", metavar="NAME", help=METHOD_HELP, show_default=False)]
SPLIT_HELP = "Fit to this fraction of the record, compare on the rest."
Split = Annotated[float, typer.Option("--split", metavar="FRACTION", help=SPLIT_HELP)]
HeldOut = Annotated[
    list[Path] | None, typer.Option("--held-out", metavar="RECORD", help=HELD_OUT_HELP, show_default=False)
]
Feedback = Annotated[str, typer.Option("--feedback", metavar="WHAT", help=FEEDBACK_HELP)]
Outputs = Annotated[
    list[str] | None,
    typer.Option(
        "--output", "--outputs", metavar="NAME", help="A measured column (y). May be repeated.", show_default=False
    ),
]
Inputs = Annotated[
    list[str] | None,
    typer.Option(
        "--input", "--inputs", metavar="NAME", help="An input column (u). May be repeated.", show_default=False
    ),
]


Order = Annotated[
    int | None,
    typer.Option("--order", metavar="N", help="The order, instead of the recommended one.", show_default=False),
]
Level = Annotated[str | None, typer.Option("--level", metavar="WHAT", help=LEVEL_HELP, show_default=False)]
ModelOut = Annotated[
    Path | None,
    typer.Option(
        "--out",
        metavar="PATH",
        help="Write the model to this .toml file. Default: RECORD-model.toml.",
        show_default=False,
    ),
]
PageOut = Annotated[
    Path | None,
    typer.Option(
        "--report",
        metavar="PATH",
        help="Write the page to this .html file. Default: RECORD-report.html.",
        show_default=False,
    ),
]


@reads_a_record
def identify(
    record: options.Record,
    method: Method = None,
    output: Outputs = None,
    input: Inputs = None,
    settings: options.Set = None,
    order: Order = None,
    level: Level = None,
    split: Split = 0.5,
    held_out: HeldOut = None,
    feedback: Feedback = "tested",
    out: ModelOut = None,
    report: PageOut = None,
    reading: Any = None,
    machine: options.Machine = False,
) -> None:
    """Identify a model from a record with gaps.

    Several methods are fitted to the first part of the record and ranked by simulating the rest. With --method or --set,
    one method is fitted to the whole record. The command writes a model file for estimate, gain and check, and a page with
    the fit to the held-out part, the choice of the order, residuals, poles and responses.

    Empty cells are lost outputs. --arrived names the column that shows which inputs arrived (default: the column arrived,
    if there is one). Orders are degrees, as in --set na=2 --set nb=1. Orders that are not given are chosen by BIC. Without
    noise_variance, a recursive method uses the noise variance of a maximum-likelihood fit.

    \b
    Example:
      estimable identify run.csv --input valve --output level --dt 0.1
      estimable identify run.csv --input valve --output level --dt 0.1 --order 3
      estimable identify flight1.csv --held-out flight2.csv --input elevator --output rate --dt 0.02
      estimable identify run.csv --method recursive-output-error
      estimable identify run.csv --input valve --output level --dt 0.1 --set na=2 --set nb=1
    """
    asked = Asked(
        record,
        output or ["y"],
        input or ["u"],
        reading,
        split,
        level,
        destinations(record, out, report),
        tuple(held_out or ()),
        feedback,
    )
    if method is None and not settings:
        with show.counted("Comparing methods") as progress:
            run = compare_report.compared(asked, order, progress)
        show.both("identify", machine, compare_report, run)
    else:
        method = method or "output-error-ml"
        with show.working(f"Running {method}"):
            run = identify_report.identified(asked, method, settings=settings or (), order=order)
        show.both("identify", machine, identify_report, run)
    if not machine:
        show.notes("", *run.record.notes, *run.written.notes())
