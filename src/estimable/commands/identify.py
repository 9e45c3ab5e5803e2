"""`estimable identify`: a model from a record with gaps."""

from typing import Annotated

import typer

from . import compare_report, identify_report, options, show

METHOD_HELP = "One method instead of a comparison: output-error-ml or recursive-output-error."
Method = Annotated[str | None, typer.Option("--method", metavar="NAME", help=METHOD_HELP, show_default=False)]
Split = Annotated[float, typer.Option("--split", metavar="FRACTION", help="Compare on what comes after this fraction.")]
Outputs = Annotated[
    list[str] | None,
    typer.Option(
        "--output", "--outputs", metavar="NAME", help="A column measured (y). May be repeated.", show_default=False
    ),
]
Inputs = Annotated[
    list[str] | None,
    typer.Option(
        "--input", "--inputs", metavar="NAME", help="A column applied (u). May be repeated.", show_default=False
    ),
]


def identify(
    record: options.Record,
    method: Method = None,
    output: Outputs = None,
    input: Inputs = None,
    settings: options.Set = None,
    split: Split = 0.5,
    time: options.Time = None,
    dt: options.Step = None,
    lost: options.Lost = None,
    arrived: options.Arrived = None,
    machine: options.Machine = False,
) -> None:
    """Identify a model from a record with gaps.

    Several methods are fitted to the first part of the record, and ranked by simulating the rest. With --method or --set one
    is fitted to all of it.

    Empty cells are outputs that were lost; --arrived names the column that says which inputs arrived (default: arrived, where
    there is one). Orders are degrees: --set na=2 --set nb=1. Without them they are chosen by BIC; without
    noise_variance, the recursion takes that of a fit by maximum likelihood.

    \b
    Example:
      estimable identify run.csv --input valve --output level --dt 0.1
      estimable identify run.csv --method recursive-output-error
      estimable identify run.csv --input valve --output level --dt 0.1 --set na=2 --set nb=1
    """
    reading = {"time": time, "dt": dt, "lost": lost, "arrived": arrived}
    if method is None and not settings:
        _compare(record, output or ["y"], input or ["u"], split, reading, machine)
        return
    method = method or "output-error-ml"
    with show.working(f"Running {method}"):
        run = identify_report.identified(
            record, method, outputs=output or ["y"], inputs=input or ["u"], settings=settings or (), reading=reading
        )
    if machine:
        show.data("identify", identify_report.as_data(run))
    else:
        show.text(lambda _: identify_report.as_text(run))


def _compare(record, outputs: list[str], inputs: list[str], split: float, reading: dict, machine: bool) -> None:
    """Compare the methods on the record, and say which is best."""
    with show.working("Comparing methods") as shown:
        progress = None if shown is None else lambda name: shown.update(f"Comparing methods: {name}")
        run = compare_report.compared(
            record, outputs=outputs, inputs=inputs, split=split, reading=reading, progress=progress
        )
    if machine:
        show.data("identify", compare_report.as_data(run))
    else:
        show.text(lambda _: compare_report.as_text(run))
