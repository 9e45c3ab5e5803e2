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
        faults.add(f"{option} must end in {suffix}. Got {checks.short(str(path))}.")
    elif os.path.isdir(path):  # False for a name that is too long, at which Path.is_dir raises
        faults.add(f"{option} {path} is a folder.")
    elif not os.path.isdir(folder):
        faults.add(f"{option} {path}: there is no folder {folder}.")
    elif not os.access(path if os.path.exists(path) else folder, os.W_OK):
        faults.add(f"{option} {path} is not writable: give another path.")
    elif record is not None and os.path.exists(path) and os.path.exists(record) and path.samefile(record):
        faults.add(f"{option} {path} is the input file itself: give another name.")
    faults.finish()
