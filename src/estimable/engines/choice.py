"""The choice of the engine for a record."""

import logging
from importlib import import_module
from typing import Any

import jax

from .. import checks
from ..annotations import Tree
from ..errors import EstimableError
from . import xla
from .program.primitives import UnsupportedError
from .step import Samples, Stepping

ENGINES = ("auto", "native", "xla")
log = logging.getLogger("estimable.engines")
_said: set[tuple[str, str]] = set()


def check(engine: str, faults: checks.Faults) -> None:
    """Check that `engine` names an engine."""
    faults.choice("engine", engine, ENGINES)


def scan(
    engine: str, algorithm: Stepping, prior: Tree, samples: Samples, intervals: Tree, **options: Any
) -> tuple[str, xla.Run]:
    """Run `algorithm` over one record. Returns the name of the engine and its run.

    "auto" uses machine code where the step can be lowered and the processor is the default device, else XLA. It logs the reason
    once: at debug level, or as a warning where the engine failed. Raises `InputError` where the requested engine cannot run the
    step.
    """
    return _first_able(engine, "scan", algorithm, prior, samples, intervals, **options)


def scan_bank(
    engine: str, algorithm: Stepping, prior: Tree, samples: Samples, intervals: Tree, **options: Any
) -> tuple[str, xla.Run]:
    """Many runs; `axes` says which of (algorithm, rows, prior) have a leading batch axis. See `scan`."""
    return _first_able(engine, "scan_bank", algorithm, prior, samples, intervals, **options)


def scan_in_blocks(
    engine: str, algorithm: Stepping, prior: Tree, samples: Samples, intervals: Tree, **options: Any
) -> tuple[str, xla.Run]:
    """A few runs of many rows; `use(outputs, first row)` takes the outputs of each block of rows. See `scan`."""
    return _first_able(engine, "scan_in_blocks", algorithm, prior, samples, intervals, **options)


def _first_able(engine: str, verb: str, algorithm: Stepping, *arguments: Any, **options: Any) -> tuple[str, xla.Run]:
    """The name and the run of the first engine that can run the step."""
    automatic = ("native", "xla") if jax.default_backend() == "cpu" else ("xla",)
    engines = automatic if engine == "auto" else (engine,)
    name, reason = type(algorithm).__name__, ""
    for engine in engines:
        run = getattr(import_module(f"{__package__}.{engine}"), verb)
        if engine == "xla":
            return engine, run(algorithm, *arguments, **options)
        try:
            return engine, run(algorithm, *arguments, **options)
        except EstimableError:
            raise
        except Exception as why:
            reason = reason_of(why)
            if engine != engines[-1]:
                pass_over(engine, name, why)
    checks.refuse(f'engine = "{engines[-1]}" cannot run {name} here: {reason}. Use "auto" or "xla".')


def reason_of(why: Exception) -> str:
    """Why an engine does not run a step, in one line: its own reason, or the kind of a failure."""
    line = str(why).strip().partition("\n")[0].rstrip(".")
    return line if isinstance(why, UnsupportedError) else f"{type(why).__name__}: {line}"


def pass_over(engine: str, name: str, why: Exception) -> None:
    """Log once why an engine does not run an algorithm: a refusal at debug level, a failure as a warning."""
    reason = reason_of(why)
    if (engine, reason) in _said:
        return
    _said.add((engine, reason))
    if isinstance(why, UnsupportedError):
        log.debug('engine = "%s" does not run %s: %s', engine, name, reason)
    else:
        log.warning('engine = "%s" failed on %s (%s). The next engine is tried.', engine, name, reason)
