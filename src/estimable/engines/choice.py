"""Which engine runs a record."""

import logging
from typing import Any

import jax

from .. import checks
from . import xla
from .straight_line import UnsupportedError

ENGINES = ("auto", "native", "xla")
log = logging.getLogger("estimable.engines")
_told: set[str] = set()


def scan(engine: str, algorithm: Any, prior: Any, samples: Any, intervals: Any, **options: Any) -> tuple[str, xla.Run]:
    """Run `algorithm` over one record; the name of the engine that ran, and what it left.

    "auto" takes machine code where the step can be written out and the processor is the default device, else XLA, and says
    why once, at debug level. Raises `InputError` where "native" was asked for and cannot run the step.
    """
    return _choose(engine, "scan", xla.scan, algorithm, prior, samples, intervals, **options)


def scan_bank(
    engine: str, algorithm: Any, prior: Any, samples: Any, intervals: Any, **options: Any
) -> tuple[str, xla.Run]:
    """Many runs; `axes` says which of (algorithm, rows, prior) have a leading batch axis. See `scan`."""
    return _choose(engine, "scan_bank", xla.scan_bank, algorithm, prior, samples, intervals, **options)


def _choose(
    engine: str, verb: str, by_xla: Any, algorithm: Any, *arguments: Any, **options: Any
) -> tuple[str, xla.Run]:
    if engine == "native" or (engine == "auto" and jax.default_backend() == "cpu"):
        from . import native

        try:
            return "native", getattr(native, verb)(algorithm, *arguments, **options)
        except UnsupportedError as reason:
            if engine == "native":
                checks.refuse(
                    f'engine = "native" cannot run {type(algorithm).__name__} here: {reason}. Use "auto" or "xla".'
                )
            if str(reason) not in _told:
                _told.add(str(reason))
                log.debug("XLA runs %s: %s", type(algorithm).__name__, reason)
    return "xla", by_xla(algorithm, *arguments, **options)
