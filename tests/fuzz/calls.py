"""One wrong call, repeated exactly by its seed, and its outcome."""

import contextlib
import io
import random
import signal
import tempfile
import traceback
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from estimable import EstimableError

from .baselines import Baseline
from .odd import odd

SECONDS = 10  # most time that a call may take
LONGEST = 600  # characters of a message


class Hang(BaseException):
    """A call that does not end."""


class Outcome(NamedTuple):
    """The outcome of a call: "answer", "refused", or a fault, with its message."""

    kind: str
    words: str
    changed: tuple[str, ...] = ()

    @property
    def is_fault(self) -> bool:
        """Whether it is neither an answer nor an `EstimableError`."""
        return self.kind not in ("answer", "refused")


def run(baseline: Baseline, seed: int) -> Outcome:
    """The baseline with one or two of its arguments changed."""
    rng = random.Random(f"{baseline.name} {seed}")
    given = dict(baseline.arguments)
    names = [*given, *baseline.optional]
    changed = tuple(rng.sample(names, min(len(names), rng.choice([1, 1, 1, 2])))) if names else ()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name in changed:
            given[name] = odd(rng, given.get(name))
    return called(baseline, given)._replace(changed=changed)


def called(baseline: Baseline, given: dict[str, Any]) -> Outcome:
    """The outcome of a call, in a new folder, for the files of calls that are right by chance."""

    def call() -> Outcome:
        with contextlib.redirect_stdout(io.StringIO()):
            baseline.function(**given)
        return Outcome("answer", "")

    with tempfile.TemporaryDirectory() as folder:
        return limited(call, Path(folder))


def limited(call: Callable[[], Outcome], folder: Path) -> Outcome:
    """The outcome of a call in a folder, ended after `SECONDS`."""
    signal.signal(signal.SIGALRM, _hang)
    signal.setitimer(signal.ITIMER_REAL, SECONDS, 1.0)  # again, where a callback from C drops the exception
    try:
        with contextlib.chdir(folder), warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            return call()
    except EstimableError as error:
        return Outcome("refused" if len(str(error)) <= LONGEST else "long", str(error))
    except Hang:
        return Outcome("hang", f"after {SECONDS} s")
    except RecursionError as error:
        return Outcome("raw", repr(error))
    except Exception as error:
        frames = [f"{f.filename.rpartition('/')[2]}:{f.lineno}" for f in traceback.extract_tb(error.__traceback__)[-4:]]
        return Outcome("raw", f"{type(error).__name__}: {str(error)[:200]} ({' '.join(frames)})")
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)


def _hang(*_: Any) -> None:
    raise Hang
