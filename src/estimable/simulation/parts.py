"""The parts of a long computation: computed here or on a cluster, and stored in a folder or not."""

import logging
import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from .. import checks
from ..writing import write
from .cluster import on_cluster

Part = dict[str, np.ndarray]
log = logging.getLogger("estimable.simulation")


class Folder:
    """Parts on the disk, {name: array} each; None stores none. A part is written completely or not at all."""

    def __init__(self, path: str | Path | None):
        if path is not None and not isinstance(path, str | os.PathLike):
            checks.refuse(f"`folder` must be the name of a folder. Got {checks.short(path)}.")
        self.path = None if path is None else Path(path)
        if self.path is None:
            return
        try:
            self.path.mkdir(parents=True, exist_ok=True)
        except (OSError, ValueError) as error:  # ValueError: a character that no name may hold
            reason = error.strerror if isinstance(error, OSError) else "a character that is not allowed in a name"
            checks.refuse(f"`folder` must be a writable folder. Got {checks.short(str(path))}: {reason}.")

    def read(self, name: str, runs: int) -> Part | None:
        """A stored, complete part with this number of runs. A damaged one, or one of another computation, logs a warning."""
        if self.path is None:
            return None
        file = self.path / f"{name}.npz"
        if not os.path.lexists(file):
            return None
        with (
            suppress(Exception),
            file.open("rb") as stream,
            np.load(stream, allow_pickle=False) as held,
        ):  # any error of a damaged archive
            part = dict(held)
            if str(part.pop("name")) == name and _is_whole(part, runs):
                return part
        log.warning("%s is damaged, or of another computation: its runs are computed again.", file)
        return None

    def write(self, name: str, part: Part) -> None:
        """Store a part; until it is on the disk, an older one remains. Raises `InputError`."""
        if self.path is not None:
            write(self.path / f"{name}.npz", lambda stream: np.savez(stream, allow_pickle=False, name=name, **part))


def _is_whole(part: Part, runs: int) -> bool:
    values = [array for name, array in part.items() if name.startswith("value ")]
    ended = part["failed"].dtype == bool and part["failed"].shape == part["sentences"].shape == (runs,)
    return ended and part["engine"].shape == () and all(len(array) == runs and array.dtype == float for array in values)


def worked_out(function: Callable, calls: Iterable[tuple], scheduler: str | None) -> Iterator[tuple[int, Any]]:
    """(number of the call, result), as they are ready: here one by one, or on the cluster of a scheduler."""
    if scheduler is None:
        yield from ((i, function(*call)) for i, call in enumerate(calls))
        return
    yield from on_cluster(function, list(calls), scheduler)
