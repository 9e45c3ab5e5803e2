"""Numbers as people read them."""

import math

MOST_DECIMALS = 9


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


def counted(number: int, thing: str) -> str:
    """A number and its noun, in the plural if need be.

    >>> counted(1, "sample"), counted(1201, "sample")
    ('1 sample', '1,201 samples')
    """
    return f"{number:,} {thing}{'' if number == 1 else 's'}"
