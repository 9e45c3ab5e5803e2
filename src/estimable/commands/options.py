"""The options that commands share: each with its type and a sentence of help."""

from pathlib import Path
from typing import Annotated

import typer


def _at_either_end(context: typer.Context, value: bool) -> bool:
    """`estimable --json gain ...` is `estimable gain ... --json`."""
    return value or bool(context.find_root().params.get("machine"))


Record = Annotated[
    Path, typer.Argument(metavar="RECORD", help="The measured record: .csv, .txt, .tsv, .mat or .parquet.", show_default=False)
]
Model = Annotated[
    Path, typer.Option("--model", metavar="PATH", help="The model file, TOML or Python: model, prior and gain.", show_default=False)
]
Filter = Annotated[
    str, typer.Option("--filter", metavar="NAME", help="The filter to run: kalman, unknown-gain, ...", show_default=False)
]
Set = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="NAME=VALUE", help="A setting of the filter, as walk=0.02. May be repeated.", show_default=False),
]
Time = Annotated[
    str | None, typer.Option("--time", metavar="NAME", help="The column of seconds, instead of the model file's.", show_default=False)
]
Step = Annotated[
    float | None,
    typer.Option("--dt", metavar="SECONDS", help="The step of a record without a time column.", show_default=False),
]
Hold = Annotated[
    str | None,
    typer.Option("--hold", metavar="HOW", help="How the input moves between samples: zero_order or first_order.", show_default=False),
]
Lost = Annotated[
    str | None,
    typer.Option("--lost", metavar="WHAT", help="What the actuator does when a packet is lost: zero or hold.", show_default=False),
]
Arrived = Annotated[
    list[str] | None,
    typer.Option(
        "--arrived", metavar="NAME", show_default=False,
        help="A column that says whether the input arrived (1) or not (0). Repeat it for one an input.",
    ),
]  # fmt: skip
Out = Annotated[
    Path | None,
    typer.Option("--out", metavar="PATH", help="Write every sample's estimate to this .csv file.", show_default=False),
]
Machine = Annotated[
    bool, typer.Option("--json", help="Write JSON to stdout, for machines.", callback=_at_either_end, show_default=False)
]
Version = Annotated[bool, typer.Option("--version", help="Show the version and stop.", show_default=False)]
