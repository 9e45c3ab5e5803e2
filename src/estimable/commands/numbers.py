"""Counts as people read them."""


def counted(number: int, thing: str) -> str:
    """A number and its noun, in the plural if need be.

    >>> counted(1, "sample"), counted(1201, "sample")
    ('1 sample', '1,201 samples')
    """
    return f"{number:,} {thing}{'' if number == 1 else 's'}"
