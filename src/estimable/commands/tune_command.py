"""`estimable tune`: how fast a loop should be."""

from typing import Annotated

import typer

from . import options, show, tune_report
from .destination import check_destination

WEIGHT_HELP = "The weight of a criterion, such as rho=1. May be repeated. Default: rho=1 and control=1."
FILTER_HELP = "kalman: use the Kalman filter of the model's Q and R, and tune only the control."
DESIGNS_HELP = "Number of designs to compare."
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

    One parameter, eta, determines how fast the loop is. A design is computed for each of many values of eta. The designs are
    compared by several criteria: the unmodelled terms that the loop tolerates, the effect of noise, of a constant force and
    of a harmonic force, and the cost of the control. The design with the best weighted composite of the criteria is chosen.

    \b
    Example:
      estimable tune aircraft.toml --dt 0.01 --report tuning.html
      estimable tune aircraft.toml --dt 0.01 --weight rho=1 --weight control=2 --json
    """
    check_destination("--report", report, ".html", record=model)
    with show.working("Judging designs"):
        found = tune_report.tuned(model, dt=dt, weights=weight or (), filter=filter, designs=designs)
    if report is not None:
        tune_report.write(found, report)
    if machine:
        show.data("tune", tune_report.as_data(found, report))
    else:
        show.text(lambda _: tune_report.as_text(found))
        show.notes(*tune_report.next_steps(found, report))
