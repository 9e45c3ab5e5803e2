"""Every table and figure of the sources, recomputed: the published value next to ours.

One file (or folder) for each source, with its `ENTRIES`; `estimable reproduce` lists and runs them.
"""

from .. import checks
from . import bass, falling_body, fang, sillence
from .entries import DRAWS, Reproduced, ReproducedRow, Reproduction, drawn

ENTRIES: tuple[Reproduction, ...] = sillence.ENTRIES + fang.ENTRIES + bass.ENTRIES + falling_body.ENTRIES

__all__ = ["DRAWS", "ENTRIES", "Reproduced", "ReproducedRow", "Reproduction", "drawn", "entry", "reproduce"]


def entry(name: str) -> Reproduction:
    """The entry with a name; the `InputError` for an unknown name suggests the nearest one.

    >>> entry("sillence-table-2").title
    'Poles of the loop under the PI law'
    """
    names = [known.name for known in ENTRIES]
    if name not in names:
        near = checks.suggestion(name, names)
        checks.refuse(f"there is no table or figure {name!r}. `estimable reproduce` lists all of them.{near}")
    return ENTRIES[names.index(name)]


def reproduce(name: str, *, draws: int = DRAWS) -> Reproduced:
    """Recompute one table or figure, with `draws` draws of its random numbers.

    Raises `InputError` for an unknown table or figure, or one that is not reproduced; the message gives the reason.

    >>> reproduce("sillence-table-3").rows[0].published
    -3.0691
    """
    found, faults = entry(name), checks.Faults()
    faults.whole("draws", draws, 1)
    if found.compute is None:
        faults.add(f"{name} is not reproduced: {found.reason}.")
    faults.finish()
    assert found.compute is not None
    return found.compute(draws)
