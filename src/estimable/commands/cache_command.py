"""`estimable cache`: where compiled steps are stored, and how to delete them."""

from typing import Annotated

import typer

from . import options, show

Where = Annotated[bool, typer.Option("--where", help="Print only the folder.")]
Clear = Annotated[bool, typer.Option("--clear", help="Delete every entry.")]


def cache(where: Where = False, clear: Clear = False, machine: options.Machine = False) -> None:
    """Show or delete the machine code stored on the disk.

    The folder is the one in ESTIMABLE_CACHE, by default estimable in the user's cache. With ESTIMABLE_CACHE=off nothing is
    stored on the disk. The folder is used only if no other user can write to it.

    \b
    Example:
      estimable cache --where
      estimable cache --clear
    """
    from .. import cache_folder

    place, count = cache_folder.clear() if clear else (cache_folder.folder(), 0)
    left = [] if place is None else cache_folder.entries(place)
    bytes_left = sum(size for _, size, _ in left)
    if machine:
        show.data("cache", {"outcome": {"code": 0, "sentence": ""}, "folder": place and str(place), "entries": len(left),
                            "bytes": bytes_left, "deleted": count})  # fmt: skip
        return
    if place is None:
        show.text(lambda _: ["There is no cache: the machine code is compiled again in each process."])
        return
    size = f"{len(left):,} entries, {bytes_left / 2**20:.1f} MiB"
    done = f"{count:,} entries deleted." if clear else f"{size} (at most {cache_folder.MOST // 2**20} MiB)."
    show.text(lambda _: [str(place)] if where and not clear else [str(place), done])
