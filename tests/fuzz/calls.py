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
from .second_way import second_ways

SECONDS = 10  # most time that a call may take
SECOND = 60  # and that its second ways may take, which compile more
LONGEST = 600  # characters of a message


class Hang(BaseException):
    """A call that does not end."""


class Outcome(NamedTuple):
    """The outcome of a call: "answer", "refused", or a fault, with its message; `ways`: the second ways to its answer."""

    kind: str
    words: str
    changed: tuple[str, ...] = ()
    ways: tuple[str, ...] = ()

    @property
    def is_fault(self) -> bool:
        """Whether it is neither an answer nor an `EstimableError`."""
        return self.kind not in ("answer", "refused")


def run(baseline: Baseline, seed: int, *, check: bool = False) -> Outcome:
    """The baseline with one or two of its arguments changed; `check`: its answer is checked in a second way."""
    rng = random.Random(f"{baseline.name} {seed}")
    given = dict(baseline.arguments)
    names = [*given, *baseline.optional]
    changed = tuple(rng.sample(names, min(len(names), rng.choice([1, 1, 1, 2])))) if names else ()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name in changed:
            given[name] = odd(rng, given.get(name))
    return called(baseline, given, check=check)._replace(changed=changed)


def called(baseline: Baseline, given: dict[str, Any], *, check: bool = False) -> Outcome:
    """The outcome of a call, in a new folder, for the files of calls that are right by chance."""
    answers: list[Any] = []

    def call() -> Outcome:
        with contextlib.redirect_stdout(io.StringIO()):
            answers.append(baseline.function(**given))
        return Outcome("answer", "")

    def again() -> Outcome:
        with contextlib.redirect_stdout(io.StringIO()):
            ways, faults = second_ways(baseline.name, baseline.function, given, answers[0])
        return Outcome("nonsense" if faults else "answer", "; ".join(faults), ways=tuple(ways))

    with tempfile.TemporaryDirectory() as folder:
        outcome = limited(call, Path(folder), SECONDS)
        return limited(again, Path(folder), SECOND) if check and outcome.kind == "answer" else outcome


def limited(call: Callable[[], Outcome], folder: Path, seconds: float | None = None) -> Outcome:
    """The outcome of a call in a folder, ended after some seconds."""
    seconds = SECONDS if seconds is None else seconds
    signal.signal(signal.SIGALRM, _hang)
    signal.setitimer(signal.ITIMER_REAL, seconds, 1.0)  # again, where a callback from C drops the exception
    try:
        with contextlib.chdir(folder), warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            return call()
    except EstimableError as error:
        return Outcome("refused" if len(str(error)) <= LONGEST else "long", str(error))
    except Hang:
        return Outcome("hang", f"after {seconds:g} s")
    except RecursionError as error:
        return Outcome("raw", repr(error))
    except Exception as error:
        frames = [f"{f.filename.rpartition('/')[2]}:{f.lineno}" for f in traceback.extract_tb(error.__traceback__)[-4:]]
        return Outcome("raw", f"{type(error).__name__}: {str(error)[:200]} ({' '.join(frames)})")
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)


def _hang(*_: Any) -> None:
    raise Hang
