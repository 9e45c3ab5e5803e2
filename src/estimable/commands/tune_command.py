"""`estimable tune`: how fast a loop should be made."""

from typing import Annotated

import typer

from . import options, show, tune_report
from .destination import check_destination

WEIGHT_HELP = "What a criterion counts in the choice, as rho=1. May be repeated; default rho=1 and control=1."
FILTER_HELP = "kalman: leave the filter that of the model's Q and R, and tune the control only."
DESIGNS_HELP = "How many designs are judged."
Weight = Annotated[
    list[str] | None, typer.Option("--weight", metavar="NAME=VALUE", help=WEIGHT_HELP, show_default=False)
]
Filter = Annotated[str | None, typer.Option("--filter", metavar="NAME", help=FILTER_HELP, show_default=False)]
Designs = Annotated[int, typer.Option("--designs", metavar="N", help=DESIGNS_HELP)]


def tune(
    model: options.CheckedModel,
    dt: options.CheckStep = None,
    weight: Weight = None,
    filter: Filter = None,
    designs: Designs = 200,
    report: options.Report = None,
    machine: options.Machine = False,
) -> None:
    """Tune the feedback and the filter of a model by robustness.

    One number makes the loop slow or fast. For each of many designs: what the loop bears that is not modelled, what noise, a
    constant and a harmonic force do to it, and what the control costs, all over its bandwidth. Chosen is where the
    weighted composite is best.

    \b
    Example:
      estimable tune aircraft.toml --dt 0.01 --report tuning.html
      estimable tune aircraft.toml --dt 0.01 --weight rho=1 --weight control=2 --json
    """
    check_destination("--report", report, ".html", kept=model)
    with show.working("Judging designs"):
        found = tune_report.tuned(model, dt=dt, weights=weight or (), filter=filter, designs=designs)
    if report is not None:
        tune_report.write(found, report)
    if machine:
        show.data("tune", tune_report.as_data(found, report))
    else:
        show.text(lambda _: tune_report.as_text(found))
        show.notes(*tune_report.next_steps(found, report))
