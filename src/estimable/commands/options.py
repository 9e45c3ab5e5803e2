"""The options that several commands share, each with its type and help."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

Callback = Callable[[typer.Context, bool], bool]


def _option(name: str, metavar: str | None, help: str, callback: Callback | None = None) -> Any:
    return typer.Option(name, metavar=metavar, help=help, show_default=False, callback=callback)


def _at_either_end(context: typer.Context, value: bool) -> bool:
    """Accept `estimable --json gain ...` as `estimable gain ... --json`."""
    return value or bool(context.find_root().params.get("machine"))


CHECKED_MODEL_HELP = "The model file, TOML or Python."
CHECK_STEP_HELP = "The sampling step of a continuous model, instead of the one in its file."
HORIZON_HELP = "Give the verdicts for so many samples (for a continuous model: seconds)."
REQUIRE_HELP = "The sigma to which a state must be known, such as position=0.1. May be repeated."
WITHOUT_HELP = "Also show what is lost without this output."
SELECT_HELP = "Choose so many of the outputs: those that know best."
STRICT_HELP = "Exit with 1 where a requirement is not met."
RECORD_HELP = "The measured record: .csv, .txt, .tsv, .mat or .parquet."
MEASURED_HELP = "A record, to show how accurately its inputs determine the gain."
MODEL_HELP = "The model file, TOML or Python: model, prior and gain."
FILTER_HELP = "The filter to run: kalman, unknown-gain, ..."
GAIN_FILTER_HELP = "The filter of the gain, such as unknown-gain. Default: change-detection."
UNKNOWN_HELP = "An unmeasured input for unknown-input, instead of the model file's. May be repeated."
SET_HELP = "A setting, such as walk=0.02. May be repeated."
TIME_HELP = "The column with the times, instead of the one in the model file."
STEP_HELP = "The step between samples, instead of the model file's time column."
TIME_UNIT_HELP = "The unit of the times: s, ms, us, ns, min or h. Default: the rule that the column allows."
TIME_FORMAT_HELP = "How dates are written: day first, month first, or a format such as %d.%m.%Y %H:%M."
ZONE_HELP = "The time zone of dates without an offset, such as Europe/Paris."
REPEATED_HELP = "Which of several values at one instant counts: first or last."
GRID_HELP = "Place the samples on a grid of so many seconds."
START_HELP = "The first time of the record, in seconds."
STOP_HELP = "The last time of the record, in seconds."
MAX_GAP_HELP = "Nothing connects across a longer step, in seconds."
DELAY_HELP = "The stamps of a column are so many seconds late, such as gps=0.2. Needs --grid. May be repeated."
CLOCK_HELP = (
    "Seconds to add to the stamps of a column on another clock, such as gps=-12.5. Needs --grid. May be repeated."
)
HOLD_HELP = "How the input varies between samples: zero_order or first_order."
LOST_HELP = "What the actuator applies when a packet is lost: zero or hold."
ARRIVED_HELP = "A column that shows whether the input arrived (1) or not (0). Repeat it for several inputs."
NA_HELP = "A number that marks a missing value, such as -9999. May be repeated."
OUT_HELP = "Write the estimates of all samples to this .csv file."
SMOOTH_HELP = "Also estimate every sample from all samples, those after it too: columns and curves of the smoother."
REPORT_HELP = "Write an interactive report to this .html file."
HEALTHY_HELP = "Fit the noise to these seconds, such as 0:8. Default: up to the first change."
NO_OFFSET_HELP = "Do not estimate offsets of the state equations."
AS_GIVEN_HELP = "Use the model file as it is: no fitted noise, no offsets, no errors of the model."
DETECTABLE_HELP = "Print, second by second, the smallest loss that would have been detected."
JSON_HELP = "Write JSON to stdout."

Record = Annotated[Path, typer.Argument(metavar="RECORD", help=RECORD_HELP, show_default=False)]
Model = Annotated[Path, _option("--model", "PATH", MODEL_HELP)]
CheckedModel = Annotated[Path, typer.Argument(metavar="MODEL", help=CHECKED_MODEL_HELP, show_default=False)]
CheckStep = Annotated[float | None, _option("--dt", "SECONDS", CHECK_STEP_HELP)]
Horizon = Annotated[float | None, _option("--horizon", "LENGTH", HORIZON_HELP)]
Require = Annotated[list[str] | None, _option("--require", "NAME=SIGMA", REQUIRE_HELP)]
Without = Annotated[str | None, _option("--without", "OUTPUT", WITHOUT_HELP)]
Select = Annotated[int | None, _option("--select", "COUNT", SELECT_HELP)]
Strict = Annotated[bool, _option("--strict", None, STRICT_HELP)]
Measured = Annotated[Path | None, _option("--record", "PATH", MEASURED_HELP)]
Filter = Annotated[str, _option("--filter", "NAME", FILTER_HELP)]
GainFilter = Annotated[str | None, _option("--filter", "NAME", GAIN_FILTER_HELP)]
Unknown = Annotated[list[str] | None, _option("--unknown", "NAME", UNKNOWN_HELP)]
Set = Annotated[list[str] | None, _option("--set", "NAME=VALUE", SET_HELP)]
Time = Annotated[str | None, _option("--time", "NAME", TIME_HELP)]
Step = Annotated[float | None, _option("--dt", "SECONDS", STEP_HELP)]
TimeUnit = Annotated[str | None, _option("--time-unit", "UNIT", TIME_UNIT_HELP)]
TimeFormat = Annotated[str | None, _option("--time-format", "FORMAT", TIME_FORMAT_HELP)]
Zone = Annotated[str | None, _option("--zone", "NAME", ZONE_HELP)]
Repeated = Annotated[str | None, _option("--repeated", "WHICH", REPEATED_HELP)]
Grid = Annotated[float | None, _option("--grid", "SECONDS", GRID_HELP)]
Start = Annotated[float | None, _option("--start", "SECONDS", START_HELP)]
Stop = Annotated[float | None, _option("--stop", "SECONDS", STOP_HELP)]
MaxGap = Annotated[float | None, _option("--max-gap", "SECONDS", MAX_GAP_HELP)]
Delay = Annotated[list[str] | None, _option("--delay", "NAME=SECONDS", DELAY_HELP)]
ClockOffset = Annotated[list[str] | None, _option("--offset", "NAME=SECONDS", CLOCK_HELP)]
Hold = Annotated[str | None, _option("--hold", "HOW", HOLD_HELP)]
Lost = Annotated[str | None, _option("--lost", "WHAT", LOST_HELP)]
Arrived = Annotated[list[str] | None, _option("--arrived", "NAME", ARRIVED_HELP)]
Na = Annotated[list[float] | None, _option("--na", "NUMBER", NA_HELP)]
Out = Annotated[Path | None, _option("--out", "PATH", OUT_HELP)]
Smooth = Annotated[bool, _option("--smooth", None, SMOOTH_HELP)]
Report = Annotated[Path | None, _option("--report", "PATH", REPORT_HELP)]
Healthy = Annotated[str | None, _option("--healthy", "FROM:TO", HEALTHY_HELP)]
NoOffset = Annotated[bool, _option("--no-offset", None, NO_OFFSET_HELP)]
AsGiven = Annotated[bool, _option("--as-given", None, AS_GIVEN_HELP)]
Detectable = Annotated[bool, _option("--detectable", None, DETECTABLE_HELP)]
Machine = Annotated[bool, _option("--json", None, JSON_HELP, callback=_at_either_end)]
Version = Annotated[bool, _option("--version", None, "Print the version and exit.")]
