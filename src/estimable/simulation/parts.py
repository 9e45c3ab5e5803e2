"""Where the parts of a long computation are worked out, and where they are kept: here or on a cluster, in a folder or not."""

import hashlib
import os
import pickle
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from types import CodeType
from typing import Any
from zipfile import BadZipFile

import jax
import numpy as np

from .. import checks
from ..errors import EstimableError

PATIENCE = 10  # [s] for a scheduler to answer


def fingerprint(*things: Any) -> str:
    """A name made of the numbers, fixed settings and functions of things: equal things have equal names in every process."""
    return hashlib.sha256("|".join(_words(thing) for thing in things).encode()).hexdigest()[:20]


def _words(thing: Any) -> str:
    if isinstance(thing, str | int | float | bytes | type(None)):
        return repr(thing)
    if hasattr(thing, "__code__"):
        code, held = thing.__code__, [cell.cell_contents for cell in thing.__closure__ or ()]
        return f"{_code_words(code)}{[_words(value) for value in (*held, *(thing.__defaults__ or ()))]}"
    leaves, structure = jax.tree_util.tree_flatten(thing)
    if leaves == [thing]:
        return _of_leaf(thing)
    return f"{structure}{[_of_leaf(leaf) for leaf in leaves]}"


def _code_words(code: CodeType) -> str:
    """What a function does: its instructions, names and constants, and not where it was written."""
    constants = [_code_words(c) if hasattr(c, "co_code") else repr(c) for c in code.co_consts]
    return f"{code.co_code.hex()}{code.co_names}{constants}"


def _of_leaf(leaf: Any) -> str:
    if isinstance(leaf, np.ndarray | np.generic | jax.Array):
        array = np.asarray(leaf)
        return f"{array.shape}{array.dtype}{hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest()}"
    if hasattr(leaf, "__code__"):
        return _words(leaf)
    return f"{type(leaf).__qualname__}{hashlib.sha256(pickle.dumps(leaf)).hexdigest()}"


class Folder:
    """Parts on the disk, {name: array} each; None keeps none. A part is written whole or not at all."""

    def __init__(self, path: str | Path | None):
        self.path = None if path is None else Path(path)
        if self.path is None:
            return
        try:
            self.path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            checks.refuse(f"`folder` must be a folder that can be written. Got {str(path)!r}: {error.strerror}.")

    def read(self, name: str) -> dict[str, np.ndarray] | None:
        """A part that is there and whole."""
        if self.path is None:
            return None
        with suppress(OSError, ValueError, BadZipFile), np.load(self.path / f"{name}.npz", allow_pickle=False) as file:
            return dict(file)
        return None

    def write(self, name: str, part: dict[str, np.ndarray]) -> None:
        """Keep a part."""
        if self.path is None:
            return
        draft = self.path / f".{name}.{os.getpid()}.npz"
        np.savez(draft, allow_pickle=False, **part)
        draft.replace(self.path / f"{name}.npz")


def worked_out(function: Callable, calls: Iterable[tuple], scheduler: str | None) -> Iterator[tuple[int, Any]]:
    """(number of the call, what the function gave), as they are ready: here one by one, or on the cluster of a scheduler."""
    if scheduler is None:
        yield from ((i, function(*call)) for i, call in enumerate(calls))
        return
    yield from _on_cluster(function, list(calls), scheduler)


def _on_cluster(function: Callable, calls: list[tuple], scheduler: str) -> Iterator[tuple[int, Any]]:
    try:
        from distributed import CancelledError, Client, KilledWorker, as_completed
    except ImportError:
        checks.refuse("a cluster needs Dask: pip install 'estimable[cluster]'.")
    try:
        client = Client(scheduler, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError) as error:
        checks.refuse(
            f"`scheduler`: no Dask scheduler answers at {scheduler!r} ({type(error).__name__}). Start one (dask scheduler) and "
            'workers (dask worker), and give its address, as "tcp://10.0.0.1:8786"; without `scheduler` this machine does it.'
        )
    with client:
        places = {client.submit(function, *call, pure=False): i for i, call in enumerate(calls)}
        try:
            for future in as_completed(list(places), loop=client.loop):
                yield places[future], future.result()
        except (OSError, KilledWorker, CancelledError) as error:
            raise EstimableError(
                f"the cluster at {scheduler} ended before the work was done ({type(error).__name__}). Parts that were finished "
                "are in `folder`, where one was given: call again to go on."
            ) from error
        finally:
            client.cancel(list(places))
