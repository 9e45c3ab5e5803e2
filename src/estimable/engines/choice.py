"""Which engine runs a record."""

import logging
from importlib import import_module
from typing import Any

import jax

from .. import checks
from . import xla
from .program.straight_line import UnsupportedError

ENGINES = ("auto", "native", "xla")
log = logging.getLogger("estimable.engines")
_told: set[tuple[str, str]] = set()


def check(engine: str, faults: checks.Faults) -> None:
    """`engine` is one."""
    faults.choice("engine", engine, ENGINES)


def scan(engine: str, algorithm: Any, prior: Any, samples: Any, intervals: Any, **options: Any) -> tuple[str, xla.Run]:
    """Run `algorithm` over one record; the name of the engine that ran, and what it left.

    "auto" takes machine code where the step can be written out and the processor is the default device, else XLA, and says
    why once, at debug level. Raises `InputError` where the engine that was asked for cannot run the step.
    """
    return _first_able(engine, "scan", algorithm, prior, samples, intervals, **options)


def scan_bank(
    engine: str, algorithm: Any, prior: Any, samples: Any, intervals: Any, **options: Any
) -> tuple[str, xla.Run]:
    """Many runs; `axes` says which of (algorithm, rows, prior) have a leading batch axis. See `scan`."""
    return _first_able(engine, "scan_bank", algorithm, prior, samples, intervals, **options)


def _first_able(engine: str, verb: str, algorithm: Any, *arguments: Any, **options: Any) -> tuple[str, xla.Run]:
    """The first of the engines that can run the step, and what it left."""
    automatic = ("native", "xla") if jax.default_backend() == "cpu" else ("xla",)
    engines = automatic if engine == "auto" else (engine,)
    name, reason = type(algorithm).__name__, ""
    for engine in engines:
        run = getattr(import_module(f"{__package__}.{engine}"), verb)
        try:
            return engine, run(algorithm, *arguments, **options)
        except UnsupportedError as why:
            reason = str(why)
        pass_over(engine, name, reason)
    checks.refuse(f'engine = "{engines[-1]}" cannot run {name} here: {reason}. Use "auto" or "xla".')


def pass_over(engine: str, name: str, reason: str) -> None:
    """Say once, at debug level, why an engine does not run an algorithm."""
    if (engine, reason) not in _told:
        _told.add((engine, reason))
        log.debug('engine = "%s" does not run %s: %s', engine, name, reason)
