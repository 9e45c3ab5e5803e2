"""`estimable identify`: a model from a record with gaps."""

from typing import Annotated

import typer

from . import identify_report, options, show

Method = Annotated[str, typer.Option("--method", metavar="NAME", help="recursive-output-error or output-error-ml.")]
Outputs = Annotated[
    list[str] | None,
    typer.Option("--output", metavar="NAME", help="A column measured (y). May be repeated.", show_default=False),
]
Inputs = Annotated[
    list[str] | None,
    typer.Option("--input", metavar="NAME", help="A column applied (u). May be repeated.", show_default=False),
]


def identify(
    record: options.Record,
    method: Method = "output-error-ml",
    output: Outputs = None,
    input: Inputs = None,
    settings: options.Set = None,
    time: options.Time = None,
    dt: options.Step = None,
    lost: options.Lost = None,
    arrived: options.Arrived = None,
    machine: options.Machine = False,
) -> None:
    """Identify an output-error model from a record in which packets are missing.

    Empty cells are outputs that were lost; --arrived names the column that says which inputs arrived (default: arrived, where
    there is one). Orders are degrees: --set na=2 --set nb=1. Without them they are chosen by BIC; without
    noise_variance, the recursion takes that of a fit by maximum likelihood.

    \b
    Example:
      estimable identify run.csv --method recursive-output-error
      estimable identify run.csv --input valve --output level --dt 0.1 --set na=2 --set nb=1
    """
    reading = {"time": time, "dt": dt, "lost": lost, "arrived": arrived}
    with show.working(f"Running {method}"):
        run = identify_report.identified(
            record, method, outputs=output or ["y"], inputs=input or ["u"], settings=settings or (), reading=reading
        )
    if machine:
        show.data("identify", identify_report.as_data(run))
    else:
        show.text(lambda _: identify_report.as_text(run))
