"""`estimable demo`: the gain of the packaged flight."""

from pathlib import Path

from . import options, show
from .destination import check_destination
from .gain_command import present
from .run_filter import run_gain

NEXT = ("", "Your own flight:", "  estimable gain YOUR.csv --model YOUR.toml", "A model file to start from:")
STORY = "A simulated F-16 at Mach 0.9: at 4.5 s its elevator loses half its effect."


def demo(report: options.Report = Path("report.html"), machine: options.Machine = False) -> None:
    """Estimate the gain of the example flight.

    The flight comes with estimable: an F-16 whose elevator loses half its effectiveness. The result is also written to an
    interactive page, report.html.

    \b
    Example:
      estimable demo
      estimable demo --json
    """
    from ..packaged import path

    check_destination("--report", report, ".html")
    with show.working("Estimating the gain"):
        run = run_gain(path("f16-flight.csv"), path("f16-model.toml"))
    present("demo", run, machine, report, command="estimable demo", story=(STORY,))
    if not machine:
        show.notes(*NEXT, f"  {run.model_path}")
