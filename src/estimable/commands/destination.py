"""Files that a command writes, checked before anything runs."""

import os
from pathlib import Path

from .. import checks


def check_destination(option: str, path: Path | None, suffix: str, *, record: Path | None = None) -> None:
    """Refuse a file that cannot be written, or that would overwrite the input file `record`."""
    if path is None:
        return
    faults, folder = checks.Faults(), path.absolute().parent
    if path.suffix.lower() != suffix:
        faults.add(f"{option} must end in {suffix}. Got {str(path)!r}.")
    elif path.is_dir():
        faults.add(f"{option} {path} is a folder.")
    elif not folder.is_dir():
        faults.add(f"{option} {path}: there is no folder {folder}.")
    elif not os.access(path if path.exists() else folder, os.W_OK):
        faults.add(f"{option} {path} is not writable: give another path.")
    elif record is not None and path.exists() and record.exists() and path.samefile(record):
        faults.add(f"{option} {path} is the input file itself: give another name.")
    faults.finish()
