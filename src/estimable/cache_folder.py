"""The folder of the cache: whose it must be before anything in it is loaded, and how large it may become.

Machine code is loaded from it, so whoever writes there decides what runs. It is used only where no other user can write.
"""

import logging
import os
import stat
import time
from contextlib import suppress
from pathlib import Path

from .writing import write as write_file

MOST = 500 * 2**20  # bytes: the oldest entries are deleted above it
LEFT = 0.8  # of them, so that not every entry deletes another
OTHERS = stat.S_IWGRP | stat.S_IWOTH
OFF = "off"
log = logging.getLogger("estimable.cache")
_said: set[str] = set()
_tidied: set[Path] = set()


def folder() -> Path | None:
    """The folder, which may not exist yet; None where there is none that can be trusted, which is logged once."""
    named = os.environ.get("ESTIMABLE_CACHE")
    if named == OFF:
        return None
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    place = Path(named) if named else Path(home, "estimable")
    reason = "its path is not absolute" if not place.is_absolute() else untrusted(place)
    if reason is None:
        return place
    _say(f"The cache {place} is not used: {reason}. Machine code is compiled again in each process.")
    return None


def untrusted(place: Path) -> str | None:
    """Why another user could write in a folder; None where no other could."""
    if not hasattr(os, "getuid"):
        return None
    for path in {*place.parents, *Path(os.path.realpath(place)).parents}:
        with suppress(FileNotFoundError):
            if reason := _open_to_others(path, os.lstat(path)):
                return reason
    try:
        found = os.lstat(place)
    except FileNotFoundError:
        return None
    except OSError as error:
        return str(error.strerror)
    if not stat.S_ISDIR(found.st_mode):
        return "it is not a folder"
    if found.st_uid != os.getuid():
        return "it belongs to another user"
    return f"other users may write in it (mode {stat.S_IMODE(found.st_mode):o})" if found.st_mode & OTHERS else None


def _open_to_others(path: Path, found: os.stat_result) -> str | None:
    """Why another user could exchange what lies in a folder above the cache."""
    if found.st_uid not in (0, os.getuid()):
        return f"{path} belongs to another user"
    shared = found.st_mode & OTHERS and not found.st_mode & stat.S_ISVTX
    return f"other users may write in {path}" if shared and stat.S_ISDIR(found.st_mode) else None


def read(name: str) -> bytes | None:
    """An entry; None where there is none, or where it is a link, another user's, or open to others."""
    place = folder()
    if place is None:
        return None
    try:
        descriptor = os.open(place / name, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0))
    except OSError:
        return None
    with open(descriptor, "rb") as stream:
        found = os.fstat(descriptor)
        if not stat.S_ISREG(found.st_mode) or (hasattr(os, "getuid") and _anothers(found)):
            return None
        with suppress(OSError):
            os.utime(descriptor, ns=(time.time_ns(), found.st_mtime_ns))  # its use: others are deleted before it
        return stream.read()


def _anothers(found: os.stat_result) -> bool:
    return found.st_uid != os.getuid() or bool(found.st_mode & OTHERS)


def write(name: str, content: bytes) -> None:
    """Write an entry, whole or not at all; where that fails, there is none."""
    place = folder()
    if place is None:
        return
    try:
        for missing in reversed([path for path in (place, *place.parents) if not path.exists()]):
            missing.mkdir(mode=0o700, exist_ok=True)
        if place not in _tidied:
            _tidied.add(place)
            tidy(place)
        write_file(place / name, lambda stream: stream.write(content), private=True)
    except (OSError, ValueError):
        return


def entries(place: Path) -> list[tuple[float, int, Path]]:
    """(when it was last used, bytes, path) of each file, the oldest first."""
    found = []
    with suppress(OSError):
        for entry in os.scandir(place):
            with suppress(OSError):
                if entry.is_file(follow_symlinks=False):
                    about = entry.stat(follow_symlinks=False)
                    found.append((about.st_atime, about.st_size, Path(entry.path)))
    return sorted(found)


def tidy(place: Path, most: int = MOST) -> None:
    """Delete the entries that were used least lately, where there are more than `most` bytes."""
    found = entries(place)
    total = sum(size for _, size, _ in found)
    if total <= most:
        return
    for _, size, path in found:
        if total <= LEFT * most:
            return
        with suppress(OSError):
            path.unlink()
            total -= size


def clear() -> tuple[Path | None, int]:
    """Delete every entry; the folder, and how many entries there were."""
    place = folder()
    found = [] if place is None else entries(place)
    for _, _, path in found:
        with suppress(OSError):
            path.unlink()
    return place, len(found)


def _say(sentence: str) -> None:
    if sentence not in _said:
        _said.add(sentence)
        log.warning(sentence)
