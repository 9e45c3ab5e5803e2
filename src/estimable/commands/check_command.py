"""`estimable check`: what can be estimated with a model, before any data."""

from . import options, show


def check(
    model: options.CheckedModel,
    dt: options.CheckStep = None,
    horizon: options.Horizon = None,
    record: options.Measured = None,
    machine: options.Machine = False,
) -> None:
    """Show what can be estimated with a model, before any data.

    The command answers these questions. Which directions of the state do the outputs reveal, and by how much do they reduce
    the variance of each state? Which directions are unobservable or unreachable, and are those stable? How many samples may
    be lost? With --record also: how accurately do the inputs of the record determine the gain?

    The verdicts on a stable model are for its steady state. Those on an unstable model are for a horizon, which starts from
    the prior in the file.

    \b
    Example:
      estimable check aircraft.toml
      estimable check aircraft.toml --dt 0.01 --json
      estimable check aircraft.toml --record flight.csv
    """
    from . import check_report

    with show.working("Checking the model"):
        found = check_report.checked(model, dt=dt, horizon=horizon, record=record)
    if machine:
        show.data("check", check_report.as_data(found))
    else:
        show.text(lambda _: check_report.as_text(found))
        show.notes(*check_report.next_steps(found))
