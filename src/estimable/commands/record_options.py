"""The options with which commands read a record: declared once, and handed to a command as one dictionary."""

import inspect
import shlex
from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from typing import Any

from .. import checks
from . import options

READING = {  # argument of `read_record`: (its parameter of a command, its type)
    "time": ("time", options.Time),
    "dt": ("dt", options.Step),
    "time_unit": ("time_unit", options.TimeUnit),
    "time_format": ("time_format", options.TimeFormat),
    "zone": ("zone", options.Zone),
    "repeated": ("repeated", options.Repeated),
    "grid": ("grid", options.Grid),
    "start": ("start", options.Start),
    "stop": ("stop", options.Stop),
    "max_gap": ("max_gap", options.MaxGap),
    "delay": ("delay", options.Delay),
    "offset": ("offset", options.ClockOffset),
    "hold": ("hold", options.Hold),
    "lost": ("lost", options.Lost),
    "arrived": ("arrived", options.Arrived),
    "na_values": ("na", options.Na),
}

SECONDS = ("delay", "offset")  # arguments {name: seconds}


def reads_a_record(command: Callable[..., None]) -> Callable[..., None]:
    """Replace the parameter `reading` of a command by the options of `READING`."""
    signature = inspect.signature(command)
    given = [
        inspect.Parameter(name, inspect.Parameter.POSITIONAL_OR_KEYWORD, default=None, annotation=kind)
        for name, kind in READING.values()
    ]
    parameters = []
    for parameter in signature.parameters.values():
        parameters += given if parameter.name == "reading" else [parameter]

    @wraps(command)
    def run(**values: Any) -> None:
        given = {argument: values.pop(name) for argument, (name, _) in READING.items()}
        reading = {argument: None if value == [] else value for argument, value in given.items()}
        reading |= {name: _seconds_of(name, texts) for name in SECONDS if (texts := reading[name]) is not None}
        command(reading=reading, **values)

    del run.__wrapped__  # type: ignore[attr-defined]  Typer would read its signature
    run.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return run


def _seconds_of(option: str, texts: Sequence[str]) -> dict[str, float]:
    """{name: seconds} of texts NAME=SECONDS."""
    faults, found = checks.Faults(), {}
    for text in texts:
        name, _, seconds = text.rpartition("=")
        try:
            found[name] = float(seconds)
        except ValueError:
            name = ""
        if not name:
            faults.add(f"--{option} needs NAME=SECONDS, as in --{option} gps=0.2. Got {text!r}.")
    faults.finish()
    return found


def as_words(reading: Mapping[str, Any]) -> list[str]:
    """The options on a command line.

    >>> as_words({"time": "t s", "time_unit": None, "max_gap": 0.5, "na_values": [-1.0, -2.0]})
    ['--time', "'t s'", '--max-gap', '0.5', '--na', '-1.0', '--na', '-2.0']
    """
    words = []
    for argument, value in reading.items():
        option = f"--{READING[argument][0].replace('_', '-')}"
        each = [f"{name}={seconds}" for name, seconds in value.items()] if isinstance(value, Mapping) else value
        for one in each if isinstance(each, list) else [each]:
            words += [] if one is None else [option, shlex.quote(str(one))]
    return words
