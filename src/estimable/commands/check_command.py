"""`estimable check`: what a model lets be known, before any data."""

from . import check_report, options, show


def check(
    model: options.CheckedModel,
    dt: options.CheckStep = None,
    horizon: options.Horizon = None,
    record: options.Measured = None,
    machine: options.Machine = False,
) -> None:
    """Say what can be known with a model, before any data.

    Which directions of the state do the outputs reveal, and by how much does each state's variance shrink? What do
    they not show, what do the inputs not move, and does it die out? A stable model is judged in steady state, an
    unstable one over a horizon, from the prior in the file. How many samples may be lost, and, with a record, how well
    can its inputs let the gain be known?

    \b
    Example:
      estimable check aircraft.toml
      estimable check aircraft.toml --dt 0.01 --json
      estimable check aircraft.toml --record flight.csv
    """
    with show.working("Checking the model"):
        found = check_report.checked(model, dt=dt, horizon=horizon, record=record)
    if machine:
        show.data("check", check_report.as_data(found))
    else:
        show.text(lambda _: check_report.as_text(found))
        show.notes(*check_report.next_steps(found))
