"""`estimable demo`: the gain of the packaged flight."""

from . import options, show
from .gain import present
from .run_filter import run_filter

STORY = "A simulated F-16 at Mach 0.9, 20,000 ft. At 4.5 s its elevator loses half its effectiveness.\n"


def demo(machine: options.Machine = False) -> None:
    """Estimate the loop gain of the example flight that comes with estimable.

    \b
    Example:
      estimable demo
      estimable demo --json
    """
    from ..packaged import path

    with show.working("Estimating the gain"):
        run = run_filter("unknown-gain", path("f16-flight.csv"), path("f16-model.toml"))
    if not machine:
        show.text(lambda _: [STORY])
    present("demo", run, machine)
    if not machine:
        show.notes("", "Your own flight:", "  estimable gain YOUR.csv --model YOUR.toml", f"A model file to start from:\n  {run.model_path}")
