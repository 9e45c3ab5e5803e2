"""The arrays of an .npz file, each read only after its size is checked against the file."""

import math
from typing import IO
from zipfile import ZIP_DEFLATED, ZIP_STORED, ZipFile

import numpy as np

from .. import checks

KINDS = frozenset("biufcSUMm")  # dtype kinds: bools, numbers, strings and times; never objects
EXPANSION = 1032  # largest expansion of a byte by DEFLATE
READERS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}


def check_sizes(archive: ZipFile, size: int) -> None:
    """Refuse a file of `size` bytes whose entries claim more bytes than it can hold."""
    held = 0
    for entry in archive.infolist():
        held += entry.compress_size
        expansion = {ZIP_STORED: 1, ZIP_DEFLATED: EXPANSION}.get(entry.compress_type, 0)
        if entry.file_size > expansion * entry.compress_size or held > size:
            checks.refuse(
                f"its entry {checks.short(entry.filename)} claims {entry.file_size} bytes, more than the file holds."
            )


def read(archive: ZipFile, name: str) -> np.ndarray:
    """One array, whose declared shape must fill its entry exactly."""
    if f"{name}.npy" not in archive.namelist():
        checks.refuse(f"it has no entry {name!r}.")
    entry = archive.getinfo(f"{name}.npy")
    with archive.open(entry) as stream:
        shape, dtype = _declared(stream, name)
        if min(shape, default=0) < 0 or stream.tell() + math.prod(shape) * dtype.itemsize != entry.file_size:
            checks.refuse(f"its entry {name!r} has {entry.file_size} bytes, which its shape {shape} does not fill.")
    with archive.open(entry) as stream:
        return np.lib.format.read_array(stream, allow_pickle=False)


def _declared(stream: IO[bytes], name: str) -> tuple[tuple[int, ...], np.dtype]:
    """The shape and dtype in the header of an entry."""
    version = np.lib.format.read_magic(stream)
    if version not in READERS:
        checks.refuse(f"its entry {name!r} is an array of a format that `save` does not write.")
    shape, _, dtype = READERS[version](stream)
    if dtype.kind not in KINDS:
        checks.refuse(f"its entry {name!r} is an array of {dtype}, which `save` does not write.")
    return shape, dtype
