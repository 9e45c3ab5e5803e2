"""What a wrong argument was probably meant to be, and the characters that no name may have."""

import unicodedata
from typing import TypeAlias

Shape: TypeAlias = tuple[int, ...]
DIRECTIONS = "\u200e\u200f\u061c" + "".join(map(chr, (*range(0x202A, 0x202F), *range(0x2066, 0x206A))))


def is_hidden(character: str) -> bool:
    """Whether it is a control character other than a tab, a mark of the direction of writing, or half of a surrogate pair."""
    control = unicodedata.category(character) in ("Cs", "Cc") and character != "\t"
    return control or character in DIRECTIONS


def remedy_of(name: str, shape: Shape, axes: list[str], wanted: tuple[int | None, ...], core: Shape) -> str:
    """A likely correction of an array of a wrong shape, or an empty string."""

    def fits(sizes: Shape) -> bool:
        same = len({g for a, g in zip(axes, sizes, strict=False) if axes.count(a) > 1}) <= 1
        return len(sizes) == len(axes) and same and all(w in (None, g) for w, g in zip(wanted, sizes, strict=True))

    if len(core) == 2 and 0 not in core and fits(core[::-1]):
        return f" Did you mean `{f'np.swapaxes({name}, 1, 2)' if len(shape) == 3 else f'{name}.T'}`?"
    if len(core) == 1 and len(axes) == 2 and axes[0] == axes[1] and 0 not in core and fits(core * 2):
        return f" Did you mean `np.diag({name})`?"
    if len(axes) == 1 and len(core) == 2 and 1 in core and fits((max(core),)):
        return f" Did you mean `np.ravel({name})`?"
    if len(core) >= len(axes):
        return ""
    return (
        " A list is needed, as in [1.0].",
        " A matrix is needed: write nested lists, as in [[1.0]].",
        " A stack of matrices is needed: write nested lists, as in [[[1.0]]].",
    )[len(axes) - 1]
