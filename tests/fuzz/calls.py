"""One wrong call, made again from its seed, and what became of it."""

import contextlib
import io
import random
import signal
import tempfile
import traceback
import warnings
from typing import Any, NamedTuple

import numpy as np

from estimable import EstimableError

from .baselines import Baseline
from .odd import odd

SECONDS = 10  # that a call may take
LONGEST = 600  # characters of a message


class Hang(BaseException):
    """A call that does not end."""


class Outcome(NamedTuple):
    """What became of a call: "answer", "refused", or a fault, with its words."""

    kind: str
    words: str
    changed: tuple[str, ...] = ()


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
    """The outcome of a call."""
    signal.signal(signal.SIGALRM, _hang)
    signal.setitimer(signal.ITIMER_REAL, SECONDS)
    try:
        with (
            tempfile.TemporaryDirectory() as folder,  # for the files of calls that are right by chance
            contextlib.chdir(folder),
            warnings.catch_warnings(),
            np.errstate(all="ignore"),
            contextlib.redirect_stdout(io.StringIO()),
        ):
            warnings.simplefilter("ignore")
            baseline.function(**given)
    except EstimableError as error:
        kind = "refused" if len(str(error)) <= LONGEST else "long"
        return Outcome(kind, str(error))
    except Hang:
        return Outcome("hang", f"after {SECONDS} s")
    except RecursionError as error:
        return Outcome("raw", repr(error))
    except Exception as error:
        frames = [f"{f.filename.rpartition('/')[2]}:{f.lineno}" for f in traceback.extract_tb(error.__traceback__)[-4:]]
        return Outcome("raw", f"{type(error).__name__}: {str(error)[:200]} ({' '.join(frames)})")
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
    return Outcome("answer", "")


def _hang(*_: Any) -> None:
    raise Hang
