"""`estimable demo`: the gain of the packaged flight."""

from . import options, show
from .gain import present
from .run_filter import run_filter

NEXT = ("", "Your own flight:", "  estimable gain YOUR.csv --model YOUR.toml", "A model file to start from:")
STORY = "A simulated F-16 at Mach 0.9, 20,000 ft. At 4.5 s its elevator loses half its effectiveness.\n"


def demo(machine: options.Machine = False) -> None:
    """Estimate the gain of the example flight.

    The flight comes with estimable: an F-16 whose elevator loses half its effectiveness.

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
        show.notes(*NEXT, f"  {run.model_path}")
