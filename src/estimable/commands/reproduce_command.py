"""`estimable reproduce`: the tables and figures of the sources, recomputed."""

from pathlib import Path
from typing import Annotated

import typer

from . import options, show
from .destination import check_destination

Name = Annotated[
    str | None,
    typer.Argument(metavar="NAME", help="The table or figure. Without it all are listed.", show_default=False),
]
Draws = Annotated[int, typer.Option("--draws", metavar="N", help="Number of random draws.")]
Figure = Annotated[
    Path | None, typer.Option("--figure", metavar="PATH", help="Write the figure to this .html file.", show_default=False)
]  # fmt: skip


def reproduce(name: Name = None, draws: Draws = 200, figure: Figure = None, machine: options.Machine = False) -> None:
    """Recompute a table or figure of the sources.

    Each published number is shown next to the recomputed one: the mean and 1 sigma over the draws. Without NAME all tables
    and figures are listed, including those that are not reproduced and the reason.

    \b
    Example:
      estimable reproduce
      estimable reproduce sillence-table-2 --figure poles.html
    """
    from .. import reproductions
    from . import reproduce_report

    if name is None:
        reproduce_report.list_all(machine)
        return
    check_destination("--figure", figure, ".html")
    found = reproductions.entry(name)
    result = reproductions.reproduce(name, draws=draws)
    written = None if figure is None else reproduce_report.write_figure(found, result, figure)
    if machine:
        show.data("reproduce", reproduce_report.as_data(found, result, figure))
    else:
        show.text(lambda _: reproduce_report.as_text(found, result))
    if written is not None:
        show.notes(written)
