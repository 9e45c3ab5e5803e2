# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false, reportUnknownVariableType=false
"""Parts of sentences: lists, numbers, given values, likely corrections."""

import difflib
import math
from collections.abc import Iterable, Sequence
from typing import Any, TypeAlias

import numpy as np

Shape: TypeAlias = tuple[int, ...]

LISTED = 40  # most names in a message
MOST_DECIMALS = 9  # of a number with its spread
LONGEST = 550  # characters of a message with several sentences; the first sentence is always complete


def limited(sentences: Sequence[str]) -> list[str]:
    """The sentences without repetition; of very many, the first ones and the number of the others.

    >>> limited(["no", "no", "yes"])
    ['no', 'yes']
    """
    different = list(dict.fromkeys(sentences))
    ends = np.cumsum([len(sentence) + 1 for sentence in different])
    fitting = max(int(np.sum(ends <= LONGEST)), 1)
    more = len(different) - fitting
    return different[:fitting] + (
        [f"There {'is' if more == 1 else 'are'} {counted(more, 'more fault')}."] if more else []
    )


def listed(names: Iterable[Any]) -> str:
    """Names, as a list in a sentence."""
    shown = [short(str(name) if isinstance(name, str) else name) for name in names]
    more = f" and {len(shown) - LISTED} more" if len(shown) > LISTED else ""
    return ", ".join(shown[:LISTED]) + more or "none"


def counted(count: int, noun: str) -> str:
    """'1 entry', '2 entries'."""
    plural = f"{noun[:-1]}ies" if noun.endswith("y") else f"{noun}s"
    return f"{count} {noun if count == 1 else plural}"


def suggestion(wrong: Any, options: Iterable[str]) -> str:
    """' Did you mean ...?' if one of the options is similar, else an empty string."""
    near = difflib.get_close_matches(wrong if isinstance(wrong, str) else short(wrong), list(options), n=1, cutoff=0.6)
    return f" Did you mean {near[0]!r}?" if near else ""


def short(value: Any) -> str:
    """A given value, in at most 60 characters."""
    try:
        text = (
            f"an array of shape {value.shape} and dtype {value.dtype}" if isinstance(value, np.ndarray) else repr(value)
        )
    except Exception:  # any exception of a user's class; integers of more than 4,300 digits have no text
        text = f"a value of the type {type(value).__name__}"
    text = " ".join(text.split())
    return text if len(text) <= 60 else text[:57] + "..."


def first_index(mask: np.ndarray) -> str:
    """Index of the first true entry, as a user writes it."""
    index = tuple(int(i) for i in np.argwhere(mask)[0])
    return str(index[0]) if len(index) == 1 else str(index)


def remedy(name: str, shape: Shape, axes: list[str], wanted: tuple[int | None, ...], core: Shape) -> str:
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


def decimals(spread: float) -> int:
    """Decimals that show two digits of a spread.

    >>> decimals(0.219), decimals(17.0), decimals(0.0)
    (2, 0, 4)
    """
    if spread == 0 or not math.isfinite(spread):
        return 4
    return min(max(1 - math.floor(math.log10(abs(spread))), 0), MOST_DECIMALS)


def spread_of(value: float, spread: float, *, unit: str = "", sign: str = "±") -> str:
    """A value and its spread, to the digits that the spread justifies; "not known" if the spread is infinite.

    >>> spread_of(0.4926, 0.219), spread_of(51.2, 22.4, unit=" %"), spread_of(1.0, math.inf)
    ('0.49 ± 0.22', '51 % ± 22 %', 'not known')
    """
    if not (math.isfinite(value) and math.isfinite(spread)):
        return "not known"
    digits = decimals(spread)
    return f"{value + 0.0:.{digits}f}{unit} {sign} {spread:.{digits}f}{unit}"
