"""Write a file whole, or not at all."""

import errno
import os
import secrets
import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

from . import checks


def write(path: str | os.PathLike[str], fill: Callable[[BinaryIO], Any]) -> None:
    """Write the file `path` with `fill(stream)`. Until the new file is on the disk, an older one of that name stays.

    `fill` writes a draft in the same folder, which then takes the name, with the permissions of the older file. A link stays
    a link to the file that it names; a device or a pipe is written directly.

    Raises `InputError` with the reason where that fails; no draft is left.
    """
    if not isinstance(path, str | os.PathLike) or "\0" in str(path):
        checks.refuse(f"`path` must be the name of a file. Got {checks.short(path)}.")
    target = Path(os.path.realpath(path))
    try:
        if target.is_dir():
            raise IsADirectoryError(errno.EISDIR, "it is a folder")
        if target.exists() and not target.is_file():
            with target.open("wb") as stream:
                fill(stream)
        else:
            _replace(target, fill)
    except OSError as error:
        checks.refuse(f"{path} could not be written: {error.strerror or error}.")


def _replace(target: Path, fill: Callable[[BinaryIO], Any]) -> None:
    older = target.exists()
    if older and not os.access(target, os.W_OK):
        raise PermissionError(errno.EACCES, "the file is read-only")
    draft = target.with_name(f".{secrets.token_hex(8)}.draft")
    try:
        with draft.open("xb") as stream:
            fill(stream)
            stream.flush()
            os.fsync(stream.fileno())
        if older:
            shutil.copymode(target, draft)
        draft.replace(target)
    except BaseException:
        with suppress(OSError):
            draft.unlink()
        raise
