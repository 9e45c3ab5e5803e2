"""Write a file completely, or not at all."""

import errno
import os
import secrets
import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

from . import checks


def write(
    path: str | os.PathLike[str], fill: Callable[[BinaryIO], Any], *, private: bool = False, option: str = ""
) -> None:
    """Write the file `path` with `fill(stream)`. An older file of that name stays until the new one is on the disk.

    `fill` writes a draft in the same folder, which is then renamed, with the permissions of the older file. A link is
    preserved; a device or a pipe is written directly. `private`: only this user can read the new file.
    `option`: the option of the command line that gave the path.

    Raises `InputError` with the reason on failure; no draft is left.
    """
    if not isinstance(path, str | os.PathLike) or "\0" in str(path):
        checks.refuse(f"`path` must be the name of a file. Got {checks.short(path)}.")
    try:
        target = Path(os.path.realpath(path))
        if target.is_dir():
            raise IsADirectoryError(errno.EISDIR, "it is a folder")
        if target.exists() and not target.is_file():
            with target.open("wb") as stream:
                fill(stream)
        else:
            _replace(target, fill, private)
    except OSError as error:
        checks.refuse(f"{option} {path} could not be written: {error.strerror or error}.".lstrip())
    except UnicodeError:
        checks.refuse(f"{str(path)!a} could not be written: it holds characters that are not allowed in a file name.")


def _replace(target: Path, fill: Callable[[BinaryIO], Any], private: bool) -> None:
    older = target.exists() and not private
    if older and not os.access(target, os.W_OK):
        raise PermissionError(errno.EACCES, "the file is read-only")
    draft = target.with_name(f".{secrets.token_hex(8)}.draft")
    try:
        with os.fdopen(
            os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600 if private else 0o666), "wb"
        ) as stream:
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
