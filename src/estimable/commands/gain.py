"""`estimable gain`: how much of the input's effect is left."""

from . import gain_text, options, show
from .gain_summary import gain_summary
from .run_filter import Run, run_filter


def gain(
    record: options.Record,
    model: options.Model,
    settings: options.Set = None,
    time: options.Time = None,
    dt: options.Step = None,
    hold: options.Hold = None,
    lost: options.Lost = None,
    arrived: options.Arrived = None,
    machine: options.Machine = False,
) -> None:
    """Find how much of an input's effect is left.

    The model file says how the plant moves and, in its section [gain], what is believed of the gain. The gain is
    estimated together with the state, sample by sample. Compared are the 2 s up to one third of the record, and its
    last 2 s.

    \b
    Example:
      estimable gain flight.csv --model aircraft.toml
      estimable gain flight.csv --model aircraft.toml --set walk=0.05 --json
    """
    reading = {"time": time, "dt": dt, "hold": hold, "lost": lost, "arrived": arrived}
    with show.working("Estimating the gain"):
        run = run_filter("unknown-gain", record, model, settings=settings or (), reading=reading)
    present("gain", run, machine)
    if not machine:
        show.notes(*gain_text.next_steps(run, settings or (), reading))


def present(command: str, run: Run, machine: bool) -> None:
    """The gain of a run on stdout."""
    summary = gain_summary(run.result)
    if machine:
        show.data(command, gain_text.as_data(run, summary))
    else:
        show.text(lambda console: gain_text.as_text(run, summary, console))
