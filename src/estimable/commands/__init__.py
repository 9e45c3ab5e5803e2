"""The command line `estimable`, with one file for each command.

A command reads its options, calls one function, and prints. Data go to stdout (JSON with `--json`), notes to stderr.
Exit codes: 0 for success; 2 for a wrong call, file or option; 1 for any other `EstimableError`.
"""

import sys
from io import TextIOWrapper

import typer

from . import options, show
from .cache_command import cache
from .check_command import check
from .demo_command import demo
from .edge import Edge
from .estimate_command import estimate
from .gain_command import gain
from .identify_command import identify
from .reproduce_command import reproduce
from .simulate_command import simulate
from .tune_command import tune

app = typer.Typer(
    name="estimable", cls=Edge, add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["--help", "-h"]},
)  # fmt: skip


@app.callback(invoke_without_command=True)
def estimable(
    context: typer.Context,
    version: options.Version = False,
    machine: options.Machine = False,
) -> None:
    """Estimation when part of the loop is unknown, such as the effect of an actuator.

    \b
    Example:
      estimable demo
      estimable gain flight.csv --model aircraft.toml
    """
    if context.invoked_subcommand is None:
        show.front_page(context, version, machine)


app.command("demo")(demo)
app.command("gain")(gain)
app.command("estimate")(estimate)
app.command("check")(check)
app.command("identify")(identify)
app.command("tune")(tune)
app.command("simulate")(simulate)
app.command("reproduce")(reproduce)
app.command("cache")(cache)


def main() -> None:
    """Run the command line of this process."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="replace")  # print names that the terminal cannot show with "?"
    app()
