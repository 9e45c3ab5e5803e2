"""`estimable check`: what can be estimated with a model, before any data."""

from . import options, show


def check(
    model: options.CheckedModel,
    dt: options.CheckStep = None,
    horizon: options.Horizon = None,
    record: options.Measured = None,
    require: options.Require = None,
    without: options.Without = None,
    select: options.Select = None,
    strict: options.Strict = False,
    machine: options.Machine = False,
) -> None:
    """Show what can be estimated with a model, before any data.

    The command answers these questions. Which directions of the state do the outputs reveal, and by how much do they reduce
    the variance of each state? Which directions are unobservable or unreachable, and are those stable? How many samples may
    be lost? With --record also: how accurately do the inputs of the record determine the gain? With --require: is each
    state known to this sigma, from when on, and what would help?

    The verdicts on a stable model are for its steady state. Those on an unstable model are for a horizon, which starts from
    the prior in the file.

    \b
    Example:
      estimable check aircraft.toml
      estimable check aircraft.toml --dt 0.01 --json
      estimable check aircraft.toml --record flight.csv
      estimable check aircraft.toml --dt 0.01 --require q=0.002 --strict
    """
    from . import check_report, requirement_report

    with show.working("Checking the model"):
        found = check_report.checked(model, dt=dt, horizon=horizon, record=record)
        answer = None
        if require or without is not None or select is not None or strict:
            given = {"require": require or (), "horizon": horizon, "without": without, "select": select}
            answer = requirement_report.required(found.file, found.model, **given)
    if machine:
        show.data("check", check_report.as_data(found) | ({} if answer is None else requirement_report.as_data(answer)))
    else:
        first = [] if answer is None else requirement_report.as_text(answer)
        show.text(lambda _: [*first, *check_report.as_text(found)])
        show.notes(*check_report.next_steps(found))
    if strict and answer is not None and not answer.found.met:
        import typer

        raise typer.Exit(1)
